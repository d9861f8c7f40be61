"""A law that nobody wrote down is found again in its form, nothing is found in nothing, and the model carries it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.stats

from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.discovery import chance
from station.diagnosis.discovery.constant_scale import ConstantScale
from station.diagnosis.discovery.discover import FoundTerm, _group_terms, discover, is_series
from station.diagnosis.discovery.edged_waves import EdgedWave, best_edged_wave
from station.diagnosis.discovery.equivalent_terms import is_same_curve
from station.diagnosis.discovery.merge import TermPair
from station.diagnosis.discovery.order_selection import order_chance
from station.diagnosis.discovery.other_forms import another_form_says_as_much
from station.diagnosis.discovery.price import CONSTANT_NATS
from station.diagnosis.discovery.rest import MOST_FREE_GROUPS, _group_columns, is_noise, prior_chances, visit_noise
from station.diagnosis.discovery.scan import _directions, scanned_units
from station.diagnosis.discovery.term_fit import (
    TermFit,
    TermSpaces,
    _half_nat,
    accepted,
    fit_term,
    refine,
    rms_of,
    search_between,
)
from station.diagnosis.results.diagnose import Cause, Diagnosis, _with_formulas
from station.diagnosis.results.diagnosis_document import document
from station.diagnosis.results.estimate import joint_coefficients
from station.diagnosis.results.extend import extend_model
from station.diagnosis.results.hypotheses import Hypotheses, HypothesisTerm, _estimate
from station.diagnosis.results.imitators import simplest_explanation
from station.diagnosis.search.held_out_gain import HeldOutGain
from station.diagnosis.search.problem import FloorAllowance, initial_problem, refined
from station.model.formula.term import Term
from station.model.model_file import Model
from station.model.scene import Scene
from station.reporting.diagnosis.formula_curve import _curve, formula_curves
from tests.blind.bench import WHITE, Scaled, World, hide
from tests.blind.hidden import KNOWN
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe, six_faces


def law(w: World, rng: Scaled) -> tuple[Any, Any]:
    """z gains c · a_z² · (T − 25 °C)."""
    added = np.zeros_like(w.a)
    added[:, 2] = w.a[:, 2] ** 2 * (w.T - 25) * rng.amplitude(1e-4, (1,))[0]
    return w.a, added


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    table, _ = hide(recipe(), law, 7, d=32.0)  # type: ignore[arg-type]
    return diagnosis_of(recipe(), table)


@pytest.mark.parametrize("columns", [1, 2])
@pytest.mark.parametrize(("length", "rank"), [(1.0, 1), (1e-25, 1), (1e-39, 0), (0.0, 0)])
def test_columns_that_died_away_have_no_direction(columns: int, length: float, rank: int) -> None:
    """In single precision a column as short as 1e-39 is next to nothing, and one over it too large a number."""
    normal = length**2 * np.eye(columns)[None, None]
    turn, found = _directions(normal, np.full((1, 1), length**2), dof=100)
    assert found.tolist() == [rank * columns]
    assert np.isfinite(turn.astype(np.float32)).all()
    assert np.einsum("ufij,ufjk->ufik", turn * length, turn.swapaxes(-1, -2) * length) == pytest.approx(
        rank * np.eye(columns)[None, None]
    )


@pytest.mark.parametrize("scale", [0.0, 1e-160, 1.0, 1e200])
def test_the_rms_of_coefficients_of_any_size_is_a_number(scale: float) -> None:
    assert rms_of(scale * np.array([[3.0, -4.0]])) == pytest.approx(scale * 12.5**0.5)


def test_the_formula_of_a_law_outside_the_library_is_found(found: Diagnosis) -> None:
    hypotheses = document(found)["unknown"]["hypotheses"]
    assert found.verdict in ("unknown", "incomplete")
    formula = hypotheses[0]
    assert formula["formula"] == "reading_z += c · a_z² · (T − T₀)"
    assert formula["complete"] and formula["gain"]["accepted"]
    c, about = formula["parameters"]
    assert (c["unit"], c["axis"], c["of"], about["unit"]) == ("1/(g·degC)", "z", "common", "degC")
    assert abs(about["value"] - 25) < 4 * about["std"]


def test_its_curve_is_the_formula_over_its_covariate(found: Diagnosis) -> None:
    (curve,) = formula_curves(found)
    assert (curve.axis, curve.what, curve.group) == ("z", "a_z²", "")
    assert curve.course is not None
    line = np.polyfit(curve.course[0], curve.course[1], 1)
    c, about = document(found)["unknown"]["hypotheses"][0]["parameters"]
    np.testing.assert_allclose(line, [c["value"], -c["value"] * about["value"]], rtol=1e-6)
    np.testing.assert_allclose(curve.formula, curve.level * np.polyval(line, curve.at), atol=1e-9)


def test_of_two_temperatures_a_square_leads_before_a_corner_that_no_run_shows() -> None:
    def square(w: World, rng: Scaled) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        added[:, 2] = w.a[:, 0] * (w.T - 21) ** 2 * rng.amplitude(1e-4, (1,))[0]
        return w.a, added

    table, _ = hide(recipe(), square, 6, d=14.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    (term,) = discover(problem, None, 1, lambda *_: 3.2).terms
    assert term.fit.term.family == ("other", "temperature-squared")
    assert ("other", "temperature-kink") in [f.term.family for f in term.equivalent]


@pytest.mark.parametrize(
    ("modulator", "constants", "same"),
    [
        ("temperature", {"about_degC": 22.0}, False),
        ("temperature-kink", {"kink_degC": 24.0}, False),
        ("temperature-squared", {"about_degC": 22.0}, True),
        ("temperature", {"about_degC": -290.0}, True),
    ],
)
def test_laws_that_agree_at_two_temperatures_are_one_only_if_they_agree_between(
    modulator: str, constants: dict[str, float], same: bool
) -> None:
    """Of 10 K in all: the same number at each visit, but another one between."""
    scene = Scene(None, None, np.arange(4), np.arange(4.0), temperature_degC=np.array([22.0, 22.0, 32.0, 32.0]))  # type: ignore[arg-type]
    signal = np.array([[0.0, 0.0, 9.0, 9.0]])
    about = -299.0 if modulator == "temperature" and same else 22.0
    one, other = (
        TermFit(Term("other", name, ("z:x",), "common", tuple(fixed.items())), 0.5, 1, 1.0, 20.0, signal)
        for name, fixed in (("temperature-squared", {"about_degC": about}), (modulator, constants))
    )
    assert is_same_curve(one, other, scene) is same


@pytest.mark.parametrize("power", [3, 1])
def test_what_agrees_at_the_tilts_of_the_visits_and_differs_between_stays_in_the_set(power: int) -> None:
    """At tilts of 45° a dead band is as good as a cube, however long its tree; a straight line has no other name."""

    def of_own(w: World, rng: Scaled) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        added[:, 2] = w.a[:, 2] ** power * w.motor * rng.amplitude(1e-4, (1,))[0]
        return w.a, added

    table, _ = hide(recipe(), of_own, 38, d=24.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    (term,) = discover(problem, None, 1, lambda *_: 3.2).terms
    families = [f.term.family for f in term.spellings]
    assert families == ([("own-cubed", "motor"), ("own-dead-band", "motor")] if power == 3 else [("own", "motor")])


@pytest.mark.parametrize(
    ("fallen", "std"),
    [
        (lambda x: x**2 / 18, 3.0),
        (lambda x: np.where(x < 4.4, 0.0, 9.0), 4.4),
        (lambda x: 0.2 * (1 - np.exp(-x)), None),
    ],
)
def test_an_interval_ends_where_the_evidence_has_fallen(fallen: Any, std: float | None) -> None:
    """A parabola; level up to an edge, as a jump is between two visits; and nowhere."""
    assert _half_nat(fallen, 0.03) == (None if std is None else pytest.approx(std, rel=0.03))


def test_a_coefficient_is_no_better_known_than_what_it_goes_with() -> None:
    """Of a saturation far below what is felt only the product of both shows."""

    def switched(w: World, rng: Scaled) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        added[:, 2] = np.tanh(w.a[:, 2] / 0.3) * w.motor * rng.amplitude(1e-4, (1,))[0]
        return w.a, added

    table, _ = hide(recipe(), switched, 39, d=24.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    term = Term("own-saturation", "motor", ("z",), "common", (("bend_u", 0.05),))
    fit = fit_term(term, TermSpaces(problem, problem.fit().floor).of(term))
    known = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), rounds=2)
    estimate = _estimate(known, 0, FoundTerm("formula-1", fit, fit.score, ()), known.fit())
    assert 0.1 < estimate.form[0].std < 2
    assert float(estimate.std[0, 0]) > 0.5 * abs(float(estimate.value[0, 0]))


def test_coefficients_cover_by_the_noise_that_few_readings_tell() -> None:
    """Beside one unit's calibration in few poses the noise is an estimate: intervals are those of Student's t."""
    kind = six_faces("listed")
    table, _ = hide(kind, lambda w, rng: (w.a, 1e-3 * np.roll(np.abs(w.a), 1, axis=1)), 3, units=1)
    problem = initial_problem(reduce_samples(kind, table), FloorAllowance.of(kind, Model()))
    term = Term("other-size", "constant", ("x:z", "y:x", "z:y"))
    fit = fit_term(term, TermSpaces(problem, problem.fit().floor).of(term))
    known = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), rounds=2)
    found = _estimate(known, 0, FoundTerm("formula-1", fit, fit.score, ()), known.fit())
    dof = known.fit().space.dof
    assert dof < 18
    normal = joint_coefficients(known, known.accepted, known.fit())[0][1]
    wider = scipy.stats.t.ppf(0.975, dof) / scipy.stats.norm.ppf(0.975)
    assert found.std == pytest.approx(wider * normal)


def test_what_the_calibration_takes_up_is_no_part_of_a_curve() -> None:
    scene = Scene(recipe(), None, np.arange(2), np.arange(2.0), temperature_degC=np.array([20.0, 30.0]))  # type: ignore[arg-type]
    signal = np.array([[-4.0, 4.0]])
    one, other, felt = (
        TermFit(Term(name, "temperature", ("z",), "common", (("about_degC", about),)), 0.5, 1, 1.0, 20.0, signal)
        for name, about in (("own", 25.0), ("own", 90.0), ("own-squared", 90.0))
    )
    assert is_same_curve(one, other, scene)
    assert not is_same_curve(replace(one, term=replace(one.term, input="own-squared")), felt, scene)


def test_the_curve_of_what_dies_away_within_a_dwell_is_that_of_the_means() -> None:
    """What is over after a tenth of the dwell moves its mean, though in the middle of the dwell nothing is left."""

    def dies(w: World, rng: Scaled) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        added[:, 2] = w.a[:, 2] ** 2 * np.exp(-w.away / 0.08) * rng.amplitude(1e-2, (1,))[0]
        return w.a, added

    table, _ = hide(recipe(), dies, 5, d=60.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    term = Term("own-squared", "decay-since-arrival", ("z",), "common", (("time_constant_s", 0.08),))
    fit = fit_term(term, TermSpaces(problem, problem.fit().floor).of(term))
    with_it = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]))
    found = HypothesisTerm(FoundTerm("formula-1", fit, 0.0, ()), *[None] * 2)  # type: ignore[arg-type]
    curve = _curve(Hypotheses((found,), None, False, False, with_it, with_it.fit(), 0.0, ""), found)
    assert np.abs(curve.formula).max() == pytest.approx(0.1 * abs(with_it.accepted[0].coefficient[0, 0]), rel=0.5)


def test_the_model_carries_it_and_a_second_diagnosis_is_silent(found: Diagnosis) -> None:
    model = Model.model_validate(extend_model(Model(), found).document())
    assert [e.effect for e in model.effects] == ["formula-1"]
    assert model.effects[0].term is not None
    assert diagnosis_of(recipe(), found.table, model).verdict == "none"


def test_a_cause_that_nothing_held_out_confirms_goes_where_a_formula_is_found(found: Diagnosis) -> None:
    shadow = Cause(found.search_result.findings[0], None, HeldOutGain("visit", 1e-4, 1e-4, 0.0, 5.0, 4.0))
    assert not shadow.gain.accepted
    again = _with_formulas(replace(found, causes=(shadow,), hypotheses=None), [])
    assert again.hypotheses is not None and again.hypotheses.complete
    assert (again.causes, again.verdict) == ((), "unknown")


def test_another_spelling_of_its_law_takes_the_place_of_no_cause() -> None:
    """A prior as narrow as the coefficients costs half a nat each; a term, held loosely, is no likelier for that."""
    table, _ = hide(recipe(1), KNOWN["warm-up"], 4, units=6, d=40.0)
    d = diagnosis_of(recipe(1), table)
    paying = [cause.estimate.item for cause in d.causes if cause.estimate is not None]
    assert [item.candidate.name for item in paying] == ["warm-up"]
    found = simplest_explanation(d.search_result, d.last, paying, d.samples, whole=True, doubted=paying)
    assert [id(item) for item in found.causes] == [id(item) for item in paying]


def test_a_formula_that_takes_the_place_of_causes_says_on_what_the_rest_depends(found: Diagnosis) -> None:
    formula = found.hypotheses
    assert formula is not None and formula.covariates
    own, doubtful = formula.covariates, replace(formula, complete=False)
    assert doubtful.words_of_rest(()) == formula.words_of_rest(()) == formula.words_of_rest((own[0], "group")) == own
    assert doubtful.words_of_rest((own[0], "group")) == (own[0], "group")
    # A kernel and a formula that have no covariate in common: one of them is wrong, and nobody knows which.
    assert formula.words_of_rest(("group",)) == (*own, "group")
    assert doubtful.words_of_rest(("group",)) == ("group", *own)


def test_nothing_is_found_in_nothing_and_the_score_by_chance_is_that_of_the_whole_grammar() -> None:
    table, _ = hide(recipe(), None, 8, floor=WHITE)
    assert diagnosis_of(recipe(), table).hypotheses is None
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    scores: Sequence[float] = []

    def threshold_of(problem: Any, fitted: Any, scans: Any) -> float:
        nonlocal scores
        scores = chance.largest_scores(problem, fitted, scans, 3).tolist()
        for scan in scans:
            data = scan.space.residual[..., None] * np.array([1.0, -2.0])
            every = [value.max(axis=0) for _, value in scan.scores(data)]
            assert scan.largest_scores(data) == pytest.approx(np.max(every, axis=0), rel=1e-12)
        return chance.tail_quantile(np.asarray(scores))

    out = discover(problem, None, 3, threshold_of)
    assert not out.terms
    assert 0.001 < float(np.mean(np.array(scores) > out.threshold)) < 0.03


def test_a_wave_that_each_axis_feels_of_another_one_is_one_term_of_one_frequency() -> None:
    def wave(w: World, rng: Scaled) -> tuple[Any, Any]:
        size = rng.amplitude(1e-4, (1,))[0] * np.array([1, -1, 1.3, -1.3])[w.unit] * np.cos(0.27 * w.t + 1)
        return w.a, size[:, None] * w.a[:, [2, 0, 1]]

    table, _ = hide(recipe(), wave, 5, d=24.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    (found,) = discover(problem, None, 1, lambda *_: 4.0).terms
    term = found.fit.term
    assert term.family == ("other", "wave")
    assert {label.rpartition(":")[0] for label in term.axes} == {"x:z", "y:x", "z:y"}
    assert abs(dict(term.constants)["cycles_hz"] - 0.27 / (2 * np.pi)) < 0.0005


@pytest.mark.parametrize("one_law", [True, False])
def test_two_terms_are_one_law_where_the_second_may_be_of_the_first_ones_family(one_law: bool) -> None:
    def decays(w: World, rng: Scaled) -> tuple[Any, Any]:
        on_y, on_x = np.exp(-w.t / 12), np.exp(-w.t / 12) if one_law else w.motor
        added = np.stack([0.4 * w.a[:, 1] * on_x, w.a[:, 2] * on_y, np.zeros_like(w.t)], axis=1)
        return w.a, added * rng.amplitude(1e-4, (1,))[0]

    table, _ = hide(recipe(), decays, 5, d=40.0)  # type: ignore[arg-type]
    bare = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    spaces = TermSpaces(bare, bare.fit().floor)
    tau = (("time_constant_s", 11.0),)
    first = Term("other", "decay", ("y:z",), "common", tau)
    alike = Term("other", "decay", ("x:y",), "common", tau)
    second = (
        Term("other-cubed", "decay", ("x:y",), "common", tau)
        if one_law
        else replace(alike, modulator="motor", constants=())
    )
    one, two, other = (fit_term(t, spaces.of(t)) for t in (first, second, alike))
    both = refined(bare.with_accepted([accepted(f, bare.view, f"formula-{n}") for n, f in enumerate((one, two), 1)]))
    found = TermPair(both, 0, 1, (one,), (two, other)).as_one(())
    assert (found is not None) == one_law
    assert found is None or (found.term.family, found.term.axes) == (("other", "decay"), ("x:y", "y:z"))
    assert TermPair(both, 0, 1, (one,), (two,)).as_one(()) is None


def test_single_readings_have_the_noise_of_the_floor_that_fits() -> None:
    """They scatter within no visit; a floor of nothing is none to whiten by."""
    table, _ = hide(recipe(1), law, 7, d=32.0)  # type: ignore[arg-type]
    reduced = replace(reduce_samples(recipe(1), table), sigma=0.0)
    problem = initial_problem(reduced, FloorAllowance.of(recipe(1), Model()))
    floor = visit_noise(problem)
    assert floor.noise == problem.fit().floor.noise > 0
    assert problem.space(floor, moving=False).rest > 0


def test_a_wave_that_only_follows_a_chirp_leaves_no_noise() -> None:
    def chirp(w: World, rng: Scaled, bent: float) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        added[:, 2] = w.a[:, 2] * np.cos(2 * np.pi * (0.05 * w.t + bent * w.t**2)) * rng.amplitude(1e-4, (1,))[0]
        return w.a, added

    waves = Term("own", "wave", ("z:cos", "z:sin"), "common", (("cycles_hz", 0.05),))
    quiet = []
    for bent in (0.0, 1e-4):
        table, _ = hide(recipe(), lambda w, rng, b=bent: chirp(w, rng, b), 31, d=16.0)  # type: ignore[misc]
        problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
        fit = fit_term(waves, TermSpaces(problem, problem.fit().floor).of(waves))
        quiet.append(is_noise(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), [waves]))
    assert quiet == [True, False]


@pytest.mark.parametrize("edges", [False, True])
def test_a_wave_that_only_follows_a_square_one_leaves_no_noise(edges: bool) -> None:
    """Of each unit and axis another size: only one curve for all of them shows what is left."""

    def wave(w: World, rng: Scaled) -> tuple[Any, Any]:
        course = np.sin(2 * np.pi * 0.05 * w.t + 0.4)
        shape = np.sign(course) if edges else course
        return w.a, rng.amplitude(1e-4, (4, 3))[w.unit] * w.a * shape[:, None]

    labels = tuple(f"{axis}:{part}" for axis in "xyz" for part in ("cos", "sin"))
    waves = Term("own", "wave", labels, "unit", (("cycles_hz", 0.05),))
    table, _ = hide(recipe(), wave, 33, d=16.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    fit = fit_term(waves, TermSpaces(problem, problem.fit().floor).of(waves))
    known = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), rounds=2)
    assert is_noise(known, [waves]) != edges


def test_what_changes_within_the_dwells_is_nothing_known_beforehand() -> None:
    table, _ = hide(recipe(), None, 36)
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    units, floor = scanned_units(problem, 4), problem.fit().floor
    still, moving = (units.setting.space(floor, moving=moving) for moving in (False, True))
    assert moving.dwell > 0
    assert [*prior_chances(units, moving)] == [*prior_chances(units, still)]


@pytest.mark.parametrize("hidden", [False, True])
def test_a_term_whose_size_goes_with_another_covariate_leaves_no_noise(hidden: bool) -> None:
    """Of three covariates a term holds two."""

    def turning(w: World, rng: Scaled) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        drive = 1 + 0.7 * (w.motor / w.motor.mean() - 1) if hidden else 1.0
        added[:, 0] = w.a[:, 1] * (w.T - 27) * drive * rng.amplitude(1e-4, (1,))[0]
        return w.a, added

    warm = Term("other", "temperature", ("x:y",), "common", (("about_degC", 27.0),))
    table, _ = hide(recipe(), turning, 35, d=16.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    fit = refine(warm, TermSpaces(problem, problem.fit().floor).of(warm))
    known = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), rounds=2)
    assert is_noise(known, [fit.term]) != hidden


@pytest.mark.parametrize(("above", "drift", "phase"), [(0.5, 0.17, 0.27), (0.3, -0.41, 0.61), (None, 0.44, 0.98)])
def test_a_wave_with_edges_is_found_between_the_phases_of_the_grid(
    above: float | None, drift: float, phase: float
) -> None:
    table, _ = hide(recipe(), None, 37)
    view = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model())).view
    hidden = EdgedWave(above, drift, phase).values(0.08, view)
    alike = best_edged_wave(0.08, view, lambda x: float(x @ hidden) / float(np.linalg.norm(x) * np.linalg.norm(hidden)))
    assert alike > 0.99


@pytest.mark.parametrize("edges", [False, True])
@pytest.mark.parametrize("modulator", ["motor-squared", "wave"])
def test_a_curve_that_only_follows_edges_is_no_whole_law(modulator: str, edges: bool) -> None:
    """A threshold of the motors' drive, and a square wave of five visits a round."""

    def hidden(w: World, rng: Scaled) -> tuple[Any, Any]:
        added, angle = np.zeros_like(w.a), 2 * np.pi * 0.08 * w.t
        smooth, sharp = (w.motor**2, w.motor > 0.5) if modulator != "wave" else (np.sin(angle), np.sin(angle) > 0)
        added[:, 0] = (
            w.a[:, 1] * (2.0 * sharp - (modulator == "wave") if edges else smooth) * rng.amplitude(1e-4, (1,))[0]
        )
        return w.a, added

    wave = modulator == "wave"
    labels, constants = (("x:y:cos", "x:y:sin"), (("cycles_hz", 0.08),)) if wave else (("x:y",), ())
    curve = Term("other", modulator, labels, "common", constants)
    table, _ = hide(recipe(), hidden, 37, d=16.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    fit = refine(curve, TermSpaces(problem, problem.fit().floor).of(curve))
    known = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), rounds=2)
    assert another_form_says_as_much(known, [fit.term]) == edges


@pytest.mark.parametrize("lagging", [False, True])
def test_a_rate_that_only_follows_a_temperature_that_lags_is_no_whole_law(lagging: bool) -> None:
    def hidden(w: World, rng: Scaled) -> tuple[Any, Any]:
        added, course = np.zeros_like(w.a), w.rate
        if lagging:
            begin = np.flatnonzero(np.diff(w.run + 100 * w.unit, prepend=-1))
            behind = w.T - w.T[begin[np.searchsorted(begin, np.arange(len(w.T)), side="right") - 1]]
            course = behind * w.t / w.t.max()
        added[:, 1] = w.a[:, 1] ** 2 * course * rng.amplitude(1e-2, (1,))[0]
        return w.a, added

    term = Term("own-squared", "temperature-rate", ("y",), "common")
    table, _ = hide(recipe(), hidden, 11, d=24.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    fit = fit_term(term, TermSpaces(problem, problem.fit().floor).of(term))
    known = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), rounds=2)
    assert another_form_says_as_much(known, [term]) == lagging


@pytest.mark.parametrize("any_number", [False, True])
def test_a_wave_of_each_position_that_only_follows_any_numbers_is_no_whole_law(any_number: bool) -> None:
    """Each position is seen three times; a wave of its own has two sizes for it."""

    def hidden(w: World, rng: Scaled) -> tuple[Any, Any]:
        added, occasion = np.zeros_like(w.a), w.position + 24 * w.run
        numbers = rng.amplitude(1e-4, (72,))[occasion]
        warmth = rng.amplitude(1e-4, (24,))[w.position] * (w.T - 25)
        added[:, 0] = numbers if any_number else warmth
        return w.a, added

    term = Term("one", "temperature", ("x",), "position", (("about_degC", 25.0),))
    if any_number:
        term = Term("one", "wave", ("x:cos", "x:sin"), "position", (("cycles_hz", 0.15),))
    table, _ = hide(recipe(), hidden, 6, d=24.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    fit = refine(term, TermSpaces(problem, problem.fit().floor).of(term))
    known = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), rounds=2)
    assert another_form_says_as_much(known, [fit.term]) == any_number


@pytest.mark.parametrize("family", [("own-squared", "temperature"), ("own-squared", "decay"), ("own", "wave")])
def test_the_room_of_a_constant_is_the_mean_of_its_likelihood_over_its_range(family: tuple[str, str]) -> None:
    """By trapezia between the few values that were tried, against two hundred of them; a wave's frequency is narrow."""

    def hidden(w: World, rng: Scaled) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        felt = w.a[:, 2] ** (2 if family[0] == "own-squared" else 1)
        course = {"temperature": w.T - 24, "decay": np.exp(-w.t / 25), "wave": np.sin(0.4 * w.t)}[family[1]]
        added[:, 2] = felt * course * rng.amplitude(1e-4, (1,))[0]
        return w.a, added

    start = {"temperature": ("about_degC", 26.0), "decay": ("time_constant_s", 30.0), "wave": ("cycles_hz", 0.063)}
    axes = ("z:cos", "z:sin") if family[1] == "wave" else ("z",)
    term = Term(*family, axes, "common", (start[family[1]],))
    table, _ = hide(recipe(), hidden, 9, d=11.0)  # type: ignore[arg-type]
    problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    at = TermSpaces(problem, problem.fit().floor).of(term)
    fit = refine(term, at)
    ((field, best),) = fit.term.constants
    scale = ConstantScale.of(field, best, problem.view)
    reach = {"temperature": 1.0, "decay": 2.0, "wave": 0.01}[family[1]]
    x = np.linspace(scale.start - reach, scale.start + reach, 201)
    nats = np.array([fit_term(term.with_constants(**{field: scale.value(float(v))}), at).evidence for v in x])
    mean = float(np.trapezoid(np.exp(nats - fit.evidence) * scale.density(x), x))
    assert fit.room == pytest.approx(np.log(mean), abs=0.5)
    assert fit.odds == fit.score + CONSTANT_NATS + fit.room < fit.score


def test_the_chance_of_the_order_that_speaks_loudest_is_that_of_its_choice() -> None:
    along = np.random.default_rng(5).standard_normal((4000, 12))
    chances = np.array([order_chance(row) for row in along])
    for level in (0.02, 0.1, 0.3):
        # Five standard deviations of a share; of twelve orders instead of all, a little less often.
        spread = 5 * np.sqrt(level * (1 - level) / len(chances))
        assert level - spread - 0.1 * level < np.mean(chances < level) < level + spread
    assert order_chance(np.array([4.0, 0.0, 0.0])) < order_chance(np.array([0.0, 0.0, 4.0])) < 0.05


def test_a_constant_that_no_data_allow_on_half_of_its_range_is_sought_on_the_other() -> None:
    tried: dict[float, float] = {}

    def evidence(x: float) -> float:
        return tried.setdefault(x, -np.inf if x < 0.5 else -((x - 0.7) ** 2))

    search_between(0.0, 1.0, evidence)
    assert max(tried, key=lambda x: tried[x]) == pytest.approx(0.7, abs=0.05)


def test_terms_that_add_up_on_one_axis_are_a_series() -> None:
    one, two = (Term("own", "wave", ("z:cos",), "unit", (("cycles_hz", f),)) for f in (0.05, 0.09))
    assert is_series([one, two])
    assert is_series([one, Term("own-squared", "motor", ("y", "z"), "unit", ())])
    assert not is_series([one, Term("own", "wave", ("x:cos",), "unit", (("cycles_hz", 0.09),))])


def test_a_term_may_not_follow_a_law_by_bending_its_covariate() -> None:
    """The square of the rate of temperature is followed by the rate itself, as far as the thermometer may be off."""

    def rate(w: World, rng: Scaled, power: int) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        added[:, 1] = w.rate**power * rng.amplitude(1e-2, (1,))[0]
        return w.a, added

    term = Term("one", "temperature-rate", ("y",), "common")
    quiet = []
    for power in (1, 2):
        table, _ = hide(recipe(), lambda w, rng, p=power: rate(w, rng, p), 31, d=16.0)  # type: ignore[misc]
        problem = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
        fit = fit_term(term, TermSpaces(problem, problem.fit().floor).of(term))
        known = refined(problem.with_accepted([accepted(fit, problem.view, "formula-1")]), rounds=2)
        quiet.append(is_noise(known, [term]))
    assert quiet == [True, False]


@pytest.mark.parametrize(
    ("seed", "family"),
    [
        # A gain that goes with temperature leaves no alarm here; its probability against other laws is a quarter.
        (10, ("own-cubed", "temperature")),
        # Cross-axis and rotation leave something, and the formula alone says more than both.
        (5, ("other", "root-time")),
    ],
)
def test_a_formula_takes_the_place_of_causes_it_does_without(seed: int, family: tuple[str, str]) -> None:
    def hidden(w: World, rng: Scaled) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        shape = w.a[:, 0] ** 3 * (w.T - 30) if family[0] == "own-cubed" else w.a[:, 1] * np.sqrt(w.t)
        added[:, 0] = shape * rng.amplitude(1e-4, (1,))[0]
        return w.a, added

    table, _ = hide(recipe(), hidden, seed, floor=WHITE, d=16.0)  # type: ignore[arg-type]
    found = diagnosis_of(recipe(), table)
    assert (found.verdict, found.causes) == ("unknown", ())
    assert found.hypotheses is not None
    (term,) = found.hypotheses.terms
    assert family in {f.term.family for f in (term.found.fit, *term.found.equivalent)}


def test_a_decay_is_not_named_as_the_bumped_visits_that_follow_it() -> None:
    def decay(w: World, rng: Scaled) -> tuple[Any, Any]:
        added = np.zeros_like(w.a)
        fading = np.exp(-w.t / (0.08 * np.ptp(w.t)))
        added[:, 2] = w.a[:, 0] * w.a[:, 1] * fading * rng.amplitude(1e-2, (1,))[0]
        return w.a, added

    table, _ = hide(recipe(), decay, 3, d=16.0, floor=WHITE)  # type: ignore[arg-type]
    found = diagnosis_of(recipe(), table)
    assert found.verdict == "unknown" and found.hypotheses is not None
    assert [t.found.fit.term.family for t in found.hypotheses.terms] == [("others", "decay")]


def test_groups_of_more_than_can_repeat_are_no_pattern() -> None:
    visits = np.arange(MOST_FREE_GROUPS + 1)
    assert _group_columns(visits, np.ones((len(visits), 1))).shape == (len(visits), 0)
    assert _group_columns(visits // 2, np.ones((len(visits), 1))).sum(0).max() == 2


def test_groups_that_are_seen_less_than_twice_each_are_no_terms() -> None:
    table, _ = hide(recipe(), None, 8, floor=WHITE)
    once = table[(table.run == 0) & (table.unit.code == 0)].used()
    levels = []
    for samples in (table, once):
        problem = initial_problem(reduce_samples(recipe(), samples), FloorAllowance.of(recipe(), Model()))
        levels.append({term.of for term in _group_terms(problem)})
    assert "position" in levels[0] and "position" not in levels[1]
