"""How certain a name is beside laws that nobody wrote."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.diagnosis.candidates.bank import Candidate, build_bank, candidates, cause_library
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.input_kernels import INPUT_WAVES
from station.diagnosis.candidates.nuisance import accept_candidate
from station.diagnosis.candidates.rival_laws import _within_groups, rival_laws
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.results.diagnose import _cause
from station.diagnosis.search import law_chance, null_simulation
from station.diagnosis.search.alarm import DRAWN_LEVEL
from station.diagnosis.search.certainty import as_certain_together
from station.diagnosis.search.finding import CauseFinding, depends_on
from station.diagnosis.search.form_check import (
    LAW_NATS,
    PRIOR_NATS,
    RivalLaws,
    _within_form_error,
    compare_laws,
    compare_laws_with_scatter,
    in_place_of,
)
from station.diagnosis.search.held_out_gain import HeldOutGain
from station.diagnosis.search.problem import FloorAllowance, initial_problem, refined
from station.diagnosis.search.rank import with_free_variance
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.walk_marginal import WalkMarginal
from station.domain.core.types import Array
from station.model.effects.bias_drift import BiasDrift
from station.model.effects.cubic import Cubic
from station.model.model_file import Model
from tests.blind.bench import WHITE, Hidden, World, hide
from tests.blind.hidden import KNOWN
from tests.blind.outside import OUTSIDE
from tests.blind.recipes import recipe

#: From here on a reader takes a name for certain.
CERTAIN = 0.9


def named(lead: float) -> float:
    """The probability of a cause that is alone in the library, where the best law is so many nats ahead."""
    floor = NoiseFloor(1e-4, 0.0, 0.0)
    finding = CauseFinding("cubic", None, floor, {"cubic": 20.0}, {"cubic": 1.0}, (), 12.0, 9.0)
    return RivalLaws(lead, ("input",)).judged(finding).probability["cubic"]


def test_a_name_that_a_law_fits_as_well_is_not_certain() -> None:
    assert named(0.0) < CERTAIN


def test_a_name_far_ahead_of_every_law_is_certain() -> None:
    assert named(-6.0) > 0.999
    assert named(-math.inf) == 1.0


def test_beside_a_stronger_cause_that_is_unlikely_a_weaker_one_is_not_certain() -> None:
    """What a cause of the wrong form leaves is as large as a weaker cause."""
    found = [found_at(200.0, 0.01), found_at(8.0, 0.999), found_at(300.0, 0.98)]
    assert [f.set_probability for f in as_certain_together(found, 0.0, 4.0)] == pytest.approx([0.01, 0.5, 0.98])


def test_no_cause_is_surer_than_a_stronger_one_beside_it() -> None:
    found = [found_at(12.0, 0.65), found_at(8.0, 0.999), found_at(5.0, 0.6)]
    assert [f.set_probability for f in as_certain_together(found, 0.0, 4.0)] == pytest.approx([0.65, 0.65, 0.6])


def test_a_cause_is_not_certain_beside_something_unknown_that_follows_what_it_does() -> None:
    """It may be the nearest part of one law of both; what follows something else says nothing about it, but that a
    scatter may hold a part of it."""
    rest = CauseFinding("time", None, NoiseFloor(1e-4, 0.0, 0.0), {}, {}, (), 0.0, 9.0, words=("time", "input"))
    cubic, drift = (
        replace(found_at(12.0, 0.99), accepted=replace(a, candidate=replace(a.candidate, effect=effect)))
        for effect in (Cubic.example(), BiasDrift.example())
        if (a := found_at(12.0, 0.99).accepted) is not None
    )
    scatter = replace(rest, name="repeatability", words=(), probability={"repeatability": 1.0})
    shares = [as_certain_together([one, rest], 9.0, 4.0)[0].set_probability for one in (cubic, drift, scatter)]
    assert all(share == pytest.approx(1 / (1 + math.exp(-PRIOR_NATS))) for share in shares)
    apart = replace(rest, words=("time",))
    assert as_certain_together([cubic, apart], 9.0, 4.0)[0].set_probability == pytest.approx(0.99)


def test_a_rest_that_chance_hardly_leaves_makes_a_name_less_certain() -> None:
    """What is as rare as p speaks for something more by 1 / (-e p ln p) at most; nothing of it is shown yet."""
    sure = found_at(9.0, 1.0)

    def over(statistic: float) -> float:
        return as_certain_together([sure], statistic, 4.0)[0].set_probability

    chance = DRAWN_LEVEL * 10
    odds = (-1 / (math.e * chance * math.log(chance)) - 1) * math.exp(-PRIOR_NATS)
    assert over(3.0) == pytest.approx(1 / (1 + odds))
    assert over(3.0) < CERTAIN < over(2.3) == 1.0
    assert over(3.99) == pytest.approx(0.5)
    # What alarms is told by its own name.
    assert over(9.0) == 1.0


def found_at(d: float, probability: float) -> CauseFinding:
    """A cause of some strength, half of whose probability is that of one that it cannot be told from."""
    floor, columns = NoiseFloor(1e-4, 0.0, 0.0), CauseColumns.of(np.ones((2, 3, 1)))
    candidate = Candidate("cubic", None, "common", "shared", np.zeros(2, np.int32), ("common",), columns)
    accepted = accept_candidate(candidate, np.ones(1, bool), 1.0)
    each = dict.fromkeys(("cubic", "quadratic"), probability / 2)
    return CauseFinding("cubic", accepted, floor, {}, each, ("quadratic",), d, 9.0)


@given(st.floats(-3.0, 1.99))
def test_a_cause_is_no_surer_than_its_gain(score: float) -> None:
    gain = HeldOutGain("visit", 1e-4, 1e-4, 0.0, 5.0 * score, 5.0)
    cause = _cause(found_at(8.0, 1.0), None, gain)
    assert cause.finding.set_probability == pytest.approx(NormalDist().cdf(score))
    assert _cause(found_at(8.0, 0.01), None, gain).finding.set_probability <= 0.01


def test_odds_fall_by_e_with_each_nat_that_a_law_gains() -> None:
    odds = [p / (1 - p) for p in (named(lead) for lead in (-2.0, -1.0, 0.0, 3.0))]
    assert odds[0] / odds[1] == pytest.approx(math.e)
    assert odds[2] / odds[3] == pytest.approx(math.exp(3.0))


@pytest.mark.parametrize(
    ("lead", "tied", "doubts"),
    [
        (1.0, 0.0, ()),  # three to two for the cause
        (2.0, 0.0, ("input",)),  # three to two against it
        (3.0, 0.0, ("input",)),  # a law follows the data far better
        (3.0, 50.0, ("input",)),
        (-math.inf, 0.0, ()),
    ],
)
def test_a_name_less_likely_than_not_says_on_what_the_rest_depends(
    lead: float, tied: float, doubts: tuple[str, ...]
) -> None:
    floor = NoiseFloor(1e-4, 0.0, 0.0)
    chances = {"cubic": 1 / (1 + tied), "quadratic": tied / (1 + tied)}
    finding = CauseFinding("cubic", None, floor, {"cubic": 20.0}, chances, ("quadratic",), 12.0, 9.0)
    laws = RivalLaws(lead, ("input",))
    assert laws.judged(finding).doubts == doubts


@pytest.mark.parametrize(("lead", "words"), [(-2.0, ()), (1.5, ()), (2.5, ("time", "input")), (5.0, ("time", "input"))])
def test_a_kernel_that_is_ahead_of_a_cause_has_its_word_said(lead: float, words: tuple[str, ...]) -> None:
    """Beforehand what nobody described is three nats less likely; what a cause cannot be told from speaks for it."""
    ahead = float(np.exp(lead - 3.0))
    chances = {name: p / (1.3 + ahead) for name, p in {"cubic": 0.3, "quadratic": 1.0, "time*input": ahead}.items()}
    finding = CauseFinding("cubic", None, NoiseFloor(1.0, 0.0, 0.0), {}, chances, ("quadratic",), 12.0, 9.0)
    assert finding.words_ahead == words


def _by_the_side_it_came_from(w: World, rng: np.random.Generator) -> tuple[Array, Array]:
    """A nest that stands otherwise after each position that it came from."""
    first = np.append(True, w.stop[1:] != w.stop[:-1])
    begun = w.visit[first] == 0
    came = np.where(begun, 0, np.roll(w.position[first], 1))
    turned = rng.normal(size=(w.position.max() + 1, 3))[came] * np.where(begun, 0.0, 1.5e-4)[:, None]
    return w.feel(nest=turned[w.stop]), np.zeros(3)


def _anyhow(w: World, rng: np.random.Generator) -> tuple[Array, Array]:
    """One that stands otherwise each time."""
    return w.feel(nest=1.5e-4 * rng.normal(size=(w.stop.max() + 1, 3))[w.stop]), np.zeros(3)


@pytest.mark.parametrize(("law", "words"), [(_by_the_side_it_came_from, ("order",)), (_anyhow, ())])
def test_scatter_that_is_alike_from_one_side_is_none(law: Hidden, words: tuple[str, ...]) -> None:
    table, _ = hide(recipe(), law, 44, units=2, d=25.0, floor=WHITE)
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    grown = with_free_variance(problem, "repeatability")
    laws = compare_laws_with_scatter(grown, "repeatability", problem.upper)
    assert laws.is_ahead == bool(words)
    assert not words or laws.words == words


@pytest.mark.parametrize("lead", [0.5, 1.6, 3.0, 4.4])
def test_a_lead_that_chance_often_brings_says_little(lead: float) -> None:
    """Never more than without its chance, the less the more often it comes, and never that a name is certain."""
    says = [RivalLaws(lead, ("input",), chance).nats for chance in (0.0, 1e-6, 0.002, 0.02, 0.1, 0.5, 1.0)]
    assert says[:2] == [lead, lead]
    assert says == sorted(says, reverse=True)
    assert says[-1] == pytest.approx(0.0, abs=1e-12)
    # One law that noise can just confuse with the cause is so far ahead with that chance: it keeps its lead.
    assert RivalLaws(lead, ("input",), NormalDist().cdf(-math.sqrt(2 * lead))).nats == pytest.approx(lead)


def test_a_cause_is_doubted_where_chance_does_not_bring_the_lead() -> None:
    floor = NoiseFloor(1e-4, 0.0, 0.0)
    finding = CauseFinding("cubic", None, floor, {"cubic": 20.0}, {"cubic": 1.0}, (), 12.0, 9.0)
    assert RivalLaws(3.0, ("input",), 0.005).judged(finding).doubts == ("input",)
    often = RivalLaws(3.0, ("input",), 0.1).judged(finding)
    assert not often.doubts
    assert often.probability["cubic"] < CERTAIN


@pytest.fixture(scope="module")
def cubic() -> tuple[ScoringProblem, ScoringProblem]:
    """A problem with a cubic that is there known, and without it."""
    table, _ = hide(recipe(1), KNOWN["cubic"], 7, units=2, d=11.0)
    bare = initial_problem(reduce_samples(recipe(1), table), FloorAllowance.of(recipe(1), Model()))
    (effect,) = (e for e in cause_library(recipe(1)) if e.id == "cubic")
    shapes = [c for c in candidates(effect, bare.view) if c.of == "unit"]
    now = score_bank(bare, [build_bank(shapes, bare.view.layout, moving=False)], bare.fit().floor)
    known = refined(bare.with_accepted([now.accept(shapes[0], bare.view)]))
    return known, known.without(0)


def test_sets_of_a_cause_and_chance_show_the_cause_as_the_readings_do(
    cubic: tuple[ScoringProblem, ScoringProblem],
) -> None:
    known, bare = cubic
    own = [known.accepted[0].candidate]
    like = WalkMarginal(
        score_bank(bare, [build_bank(own, bare.view.layout, moving=m) for m in (False, True)], known.fit().floor),
        (),
        (),
    )
    seen = like.evidence()["cubic"]
    signal = law_chance._signal(known, bare)
    for added, moves in ((signal, True), (None, False)):
        drawn = np.concatenate([s["cubic"] for s in null_simulation.scores(bare, known.fit(), like, 1, 256, added)])
        assert bool(np.mean(np.abs(drawn - seen) < 3 * np.std(drawn)) > 0.9) is moves


def test_the_further_a_law_is_ahead_the_rarer_by_chance(cubic: tuple[ScoringProblem, ScoringProblem]) -> None:
    known, bare = cubic
    floor, laws = known.fit().floor, list(rival_laws(bare.view, known.accepted[0].in_view(bare.view)))[::20]
    forms = [known.accepted[0].candidate]
    chances = [
        law_chance.chance_of_lead(known, bare, forms, laws, floor, lead) for lead in (-300.0, 1.5, LAW_NATS, 60.0)
    ]
    assert chances == sorted(chances, reverse=True)
    assert chances[0] == 1.0
    # The cause is there: what is called ahead of it hardly ever is.
    assert chances[2] < 0.02
    assert chances[3] == 0.0


def test_a_cause_is_compared_together_with_those_that_it_cannot_be_told_from(
    cubic: tuple[ScoringProblem, ScoringProblem],
) -> None:
    """In place of a cubic a size of the input is another form; with the cubic beside it no law is ahead."""
    known, _ = cubic
    other = in_place_of(known, 0, "asymmetry")
    assert other is not None
    floor = other.fit().floor
    alone, together = (compare_laws(other, 0, floor, alike).lead for alike in ((), ("cubic",)))
    assert alone > LAW_NATS
    assert together < 0.5 * alone


def _root_of_step(w: World, rng: np.random.Generator) -> tuple[Array, Array]:
    """What grows with the root of the step from the position before."""
    step = w.before - w.a
    return w.a, 1e-3 * rng.normal(size=3) * np.sign(step) * np.sqrt(np.abs(step))


@pytest.mark.parametrize(("hidden", "ahead"), [(_root_of_step, True), (KNOWN["hysteresis"], False)])
def test_laws_that_stand_still_are_weighed_beside_a_cause_that_moves_within_the_dwells(
    hidden: Hidden, ahead: bool
) -> None:
    """What moves is seen beside quiet contrasts, and would seem to explain twice as much: no law would be near it."""
    table, _ = hide(recipe(1), hidden, 5, units=1, d=25.0)
    bare = initial_problem(reduce_samples(recipe(1), table), FloorAllowance.of(recipe(1), Model()))
    (effect,) = (e for e in cause_library(recipe(1)) if e.id == "hysteresis")
    shapes = [c for c in candidates(effect, bare.view) if c.of == "unit"]
    now = score_bank(bare, [build_bank(shapes, bare.view.layout, moving=False)], bare.fit().floor)
    known = refined(bare.with_accepted([now.accept(shapes[0], bare.view)]))
    laws = compare_laws(known, 0, known.fit().floor, ("settling",))
    assert np.isfinite(laws.lead)
    assert laws.is_ahead is ahead
    assert not ahead or laws.words == ("order",)


def _late(w: World, rng: np.random.Generator) -> tuple[Array, Array]:
    """What comes on in the last part of each dwell."""
    return w.a, 1e-3 * rng.normal(size=3) * (w.away > 0.5)[:, None]


@pytest.mark.parametrize(("hidden", "ahead"), [(_late, True), (KNOWN["lever-arm"], False)])
def test_what_changes_within_the_dwells_is_compared_with_courses_that_do_not_die_away(
    hidden: Hidden, ahead: bool
) -> None:
    table, _ = hide(recipe(1), hidden, 5, units=2, d=25.0)
    bare = initial_problem(reduce_samples(recipe(1), table), FloorAllowance.of(recipe(1), Model()))
    (effect,) = (e for e in cause_library(recipe(1)) if e.id == "lever-arm")
    shapes = candidates(effect, bare.view)
    now = score_bank(bare, [build_bank(shapes, bare.view.layout, moving=True)], bare.fit().floor)
    best = now.candidates[int(now.readings().evidence[0].argmax())]
    known = refined(bare.with_accepted([now.accept(best, bare.view)]))
    laws = compare_laws(known, 0, known.fit().floor)
    assert laws.is_ahead is ahead
    assert not ahead or laws.words == ("dwell-phase",)


@pytest.mark.parametrize(("lead", "chance", "ahead"), [(6.0, 0.0, True), (6.0, 0.1, False), (4.0, 0.0, False)])
def test_a_law_is_ahead_only_where_chance_does_not_bring_it_there(lead: float, chance: float, ahead: bool) -> None:
    assert RivalLaws(lead, ("input",), chance).is_ahead is ahead


def test_a_name_that_a_kernel_outdoes_says_on_what_the_kernel_depends() -> None:
    floor = NoiseFloor(1e-4, 0.0, 0.0)
    evidence = {"cubic": 200.0, "time": 206.0}
    finding = CauseFinding("cubic", None, floor, evidence, {"cubic": 0.05, "time": 0.95}, (), 20.0, 9.0)
    laws = RivalLaws(-3.0, ("input",))
    assert laws.judged(finding).doubts == ("time",)


def test_kernels_that_explain_nothing_say_nothing() -> None:
    assert depends_on({"time": -0.3, "input": -0.5}) == ()
    assert depends_on({"time": 9.0, "input": 7.0, "order": -0.5}) == ("time", "input")


@given(st.lists(st.floats(0.1, 10.0), min_size=3, max_size=3))
def test_how_much_of_a_covariate_each_unit_has_is_no_law_of_coefficients_of_its_own(size: list[float]) -> None:
    """A unit that came later has another coefficient by chance, and a fleet's may happen to go with the time."""
    unit = np.repeat(np.arange(3), 4).astype(np.int32)
    columns = CauseColumns.of(np.ones((12, 3, 1)))
    cause = Candidate("quadratic", None, "unit", "own", unit, ("a", "b", "c"), columns)
    x = np.tile([1.0, 1.2, 1.4, 1.6], 3)
    alone, also = _within_groups(cause, x * np.array(size)[unit])
    assert alone == pytest.approx(_within_groups(cause, x)[0])
    assert np.bincount(unit, also) == pytest.approx(np.zeros(3), abs=1e-9)
    assert _within_groups(replace(cause, pattern="shared"), x)[1] is x


def test_four_nats_say_much_beside_ten_and_nothing_beside_ten_thousand() -> None:
    """A form that is known to 3 % leaves a thousandth of its squares to laws that are a little nearer."""
    assert _within_form_error(10.0) - 10.0 < 0.02
    assert _within_form_error(10_000.0) - 10_000.0 > LAW_NATS
    assert _within_form_error(-5.0) == -5.0


def test_a_course_of_the_dwell_that_warms_in_each_unit_is_no_cause_of_the_nests() -> None:
    """Nests share what only resembles it, units do not."""
    table, _ = hide(recipe(), OUTSIDE["course of the dwell by temperature"][1], 31, d=11.0)
    bare = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    (effect,) = (e for e in cause_library(recipe()) if e.id == "lever-arm")
    shapes = [c for c in candidates(effect, bare.view) if c.of == "nest"]
    now = score_bank(bare, [build_bank(shapes, bare.view.layout, moving=True)], bare.fit().floor)
    best = now.candidates[int(now.readings().evidence[0].argmax())]
    known = refined(bare.with_accepted([now.accept(best, bare.view)]))
    laws = compare_laws(known, 0, known.fit().floor)
    assert laws.is_ahead
    assert set(laws.words) == {"dwell-phase", "temperature"}


@pytest.mark.parametrize("waves", np.linspace(1.3, 5.2, 14))
def test_a_wave_of_the_input_falls_between_no_two_kernels(waves: float) -> None:
    """Whatever its phase, one pair of cosine and sine follows more than half of it at 24 tilts by any angles."""
    rng = np.random.default_rng(5)
    a = np.cos(rng.uniform(0, np.pi, 24))
    for phase in (0.0, 0.8, 1.6, 2.4):
        hidden = np.sin(waves * np.pi * a + phase)
        known = np.stack([np.ones_like(a), a], axis=1)
        rest = hidden - known @ np.linalg.lstsq(known, hidden, rcond=None)[0]
        left = []
        for m in INPUT_WAVES:
            columns = np.column_stack([known, np.sin(m * np.pi * a), np.cos(m * np.pi * a)])
            left.append(np.sum((hidden - columns @ np.linalg.lstsq(columns, hidden, rcond=None)[0]) ** 2))
        assert min(left) < 0.5 * np.sum(rest**2)
