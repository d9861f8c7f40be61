"""Whether a cause that was named has the form that the data have, or is only the nearest of the library to another law.

What is left of a law once its imitation is fitted is often too weak to alarm by itself. Each cause is therefore
compared, in the data without it, with laws of one coefficient an axis that no cause of the library follows: the same
evidence, each under the floor that fits best with it. Where one of them is clearly ahead the cause is not named for
certain: its form does not explain all.

The best of hundreds of laws is ahead by chance, too, the more often the more of them nearly follow the cause. How often
the cause and noise alone bring it as far is told by sets of such readings, drawn anew.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np
import scipy

from station.diagnosis.candidates.bank import (
    Bank,
    Candidate,
    build_bank,
    candidate_in_view,
    candidates,
    cause_library,
    is_testable,
)
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.order_kernels import came_from
from station.diagnosis.candidates.rival_laws import covariates_of_law, fading_laws, laws_within_dwells, rival_laws
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.bend import bend_nats
from station.diagnosis.search.extent import Extent, best_extent
from station.diagnosis.search.finding import CauseFinding
from station.diagnosis.search.law_chance import chance_of_lead
from station.diagnosis.search.problem import refined
from station.diagnosis.search.rank import OCCAM_NATS, RankedCause, rank_causes, with_bounded_variance
from station.diagnosis.search.returning_walk import nats_ahead
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.unit_sample import sampled_units
from station.diagnosis.search.walk_marginal import WalkMarginal
from station.domain.core.types import Floats
from station.model.effects.bias_walk import BiasWalk

#: A law must be so many nats ahead of a cause. Where the cause is true, two forms that noise can just confuse differ by
#: N(−δ²/2, δ²) nats, at worst beyond x in Φ(−√(2x)): once in 740 campaigns for each such law.
LAW_NATS = 4.5
#: Before the data a law that nobody wrote is less likely than the cause it resembles by this many nats, odds of 4.5 to
#: one. Where no data can part the two, a name is thus never certain (0.82).
PRIOR_NATS = 1.5
#: What it costs to choose one law out of all of them where no cause says which, nats.
CHOICE_NATS = 5.0
#: No cause follows its form to better than some 3 % of its size, which leaves this share of its squares, and so of its
#: nats, to other laws: in a fleet more than LAW_NATS.
FORM_SHARE = 1e-3
#: Laws so near to the best, nats, all say on what the rest depends.
NEAR_NATS = 2.0
#: Laws further behind the best than this, nats, are not tried under other floors.
PROMISING_NATS = 12.0
#: Units of each of two samples of a fleet in which laws that are far behind are seen first.
SAMPLE_UNITS = 16
#: Numbers in the courses of the laws looked at together, were there one of each law; and laws at the least.
COURSES_AT_ONCE, FEWEST_LAWS_AT_ONCE = 1 << 19, 16


@dataclass(frozen=True, slots=True)
class RivalLaws:
    """How many nats the best law is ahead of what was found, in its place, and the covariates of those near it; chance:
    how often it is as far ahead of a cause that is true, 0 where no set shows it, or none was drawn."""

    lead: float
    words: tuple[str, ...]
    chance: float = 0.0

    @property
    def is_ahead(self) -> bool:
        """Whether what was found has not the form of the data."""
        return self.nats > LAW_NATS

    @property
    def nats(self) -> float:
        """What the lead says for a law: no more than that of one law alone which is as rare (see LAW_NATS)."""
        if self.lead <= 0 or self.chance <= 0:
            return self.lead
        z = max(float(-scipy.special.ndtri(self.chance)), 0.0)
        return min(self.lead, 0.5 * z**2)

    def judged(self, finding: CauseFinding) -> CauseFinding:
        """The finding with its probability against these laws, too, and what speaks against an unlikely one."""
        judged = finding.beside(self.nats - PRIOR_NATS)
        doubts = self.words if self.lead > 0 else finding.covariates
        return replace(judged, doubts=doubts) if judged.is_unlikely else judged


def compare_laws(problem: ScoringProblem, i: int, floor: NoiseFloor, alike: Iterable[str] = ()) -> RivalLaws:
    """The laws in place of accepted cause i, or of those in its set, beside all others. floor: the one with all of them
    known."""
    bare = problem.without(i)
    known = [
        *_forms(problem.accepted[i].candidate, bare.view),
        *(c for name in alike for c in _shapes(name, bare.view)),
    ]
    laws: Iterable[Candidate] = rival_laws(bare.view, problem.accepted[i].in_view(bare.view))
    if (extent := best_extent(bare, known[:1], floor)) is not None:
        # What acts on one axis alone, or in one unit, is compared with the laws of that, too.
        known += [cut for form in known if (cut := extent.of(form)) is not None]
        laws = chain.from_iterable((law, *_cut(law, extent)) for law in laws)
    forms = [replace(c, name=f"cause/{k}") for k, c in enumerate(known)]
    promising = _promising(bare, forms, laws, floor)
    ranks = _ranked(bare, forms, promising, floor)
    own = [ranks.pop(c.name).evidence for c in forms if c.name in ranks]
    bend = bend_nats(problem, bare, problem.accepted[i], floor)
    found = _rivals(ranks, _within_form_error(max(own)) + bend) if own else RivalLaws(-np.inf, ())
    if 0 < found.lead <= PROMISING_NATS:
        found = replace(found, chance=chance_of_lead(problem, bare, forms, promising, floor, found.lead))
    coming = _coming_on(problem.accepted[i].candidate, bare, floor)
    found = max((found, *_fading(problem, i, floor), *coming), key=lambda laws: laws.lead)
    in_order = _follows_order(problem.accepted[i].candidate, bare.view)
    return replace(found, lead=max(found.lead, 0.0)) if in_order else found


def _cut(law: Candidate, extent: Extent) -> Iterator[Candidate]:
    """A law in an extent alone, where it can be cut so."""
    if (cut := extent.of(law)) is not None:
        yield replace(cut, name=f"{law.name}/cut")


def _within_form_error(nats: float) -> float:
    """How many of so many nats a cause would explain if its form were exact."""
    return nats + FORM_SHARE * max(nats, 0.0)


def _coming_on(cause: Candidate, bare: ScoringProblem, floor: NoiseFloor) -> Iterator[RivalLaws]:
    """What comes on within the dwells in place of a cause that stands still in them, both as the blocks show them."""
    found = laws_within_dwells(candidate_in_view(cause, bare.view), bare.view)
    ranks = _best_of(bare, found[:1], found[1:], floor) if found else {}
    if found and found[0].name in ranks:
        yield _rivals(ranks, ranks.pop(found[0].name).evidence + float(np.log(len(found) - 1)))


def _fading(problem: ScoringProblem, i: int, floor: NoiseFloor) -> Iterator[RivalLaws]:
    """What dies away over several visits in place of single ones that are wrong, or of jumps that stay: of all of them
    in one run together, as a jump and one back are a part of it each; and one that does so in every run."""
    begun = [list(fading_laws(cause, problem.view)) for cause in problem.accepted]
    leads = list[dict[str, float]]()
    for groups, (alone, *courses) in begun[i]:
        near = {
            j: [laws for _, laws in found if _in_one_run(laws[0], alone, problem.view)]
            for j, found in enumerate(begun)
            if j != i
        }
        every = [laws for some in near.values() for laws in some]
        courses += [replace(law, name=f"{law.name}/{k}") for k, laws in enumerate(every) for law in laws[1:]]
        bare = problem
        for j in sorted((i, *(j for j, some in near.items() if some)), reverse=True):
            bare = bare.without(j, groups if j == i else None)
        visit = np.concatenate([alone.visit, *(laws[0].visit for laws in every)], axis=2)
        ranks = _best_of(bare, [replace(alone, columns=CauseColumns.of(visit))], courses, floor)
        if alone.name in ranks:
            own = ranks.pop(alone.name).evidence
            yield _rivals(ranks, own + float(np.log(len(courses))))
            leads.append({law.name: ranks[law.name].evidence - own for law in courses if law.name in ranks})
    yield _in_every_run(leads)


def _in_every_run(leads: Sequence[Mapping[str, float]]) -> RivalLaws:
    """What dies away, or ends, alike in each of some runs, by how many nats it is ahead in each; one law of all."""
    alike = set[str]().union(*leads) if len(leads) > 1 else set()
    each = {name: sum(lead.get(name, -PROMISING_NATS) for lead in leads) for name in alike}
    if not each:
        return RivalLaws(-np.inf, ())
    best = max(each, key=lambda name: each[name])
    return RivalLaws(each[best] - float(np.log(len(each))), covariates_of_law(best))


def _in_one_run(law: Candidate, other: Candidate, view: ResidualView) -> bool:
    """Whether two laws act in a run that both share."""
    runs = view.scene.group("run")[0]
    one, two = (runs[np.any(x.visit != 0.0, axis=(1, 2))] for x in (law, other))
    return bool(np.intersect1d(one, two).size)


def _follows_order(accepted: Candidate, view: ResidualView) -> bool:
    """Whether each position stands at one place of every run's order: whatever changes in that order, by time or by
    what went before, then fits as well as an error of each position."""
    if accepted.of != "position":
        return False
    places = np.stack([accepted.code, view.scene.visits.visit])
    return bool(np.unique(places, axis=1).shape[1] == np.unique(accepted.code).size > 1)


def _forms(accepted: Candidate, view: ResidualView) -> list[Candidate]:
    """A cause as it was accepted, and at every shape and level that the bank has of it: what was accepted stands
    without the lengths and the errors of its covariates."""
    found = [candidate_in_view(accepted, view)]
    if accepted.effect is None or accepted.moving or accepted.pattern == "scan":
        return found
    return found + _shapes(accepted.name, view)


def _shapes(name: str, view: ResidualView) -> list[Candidate]:
    """A cause of the library at every shape and level, those apart that hit nobody knows which groups."""
    effects = [e for e in cause_library(view.scene.recipe) if e.id == name and is_testable(e, view)]
    return [c for e in effects for c in candidates(e, view) if c.pattern != "scan"]


def in_place_of(problem: ScoringProblem, i: int, name: str) -> ScoringProblem | None:
    """The problem with another cause, fitted, in place of accepted cause i; None where these data show none of its
    shapes."""
    bare, floor = problem.without(i), problem.fit().floor
    if not (shapes := _shapes(name, bare.view)):
        return None
    now = _under(bare, shapes, floor)[1].best
    best = now.candidates[int(now.readings().evidence[0].argmax())]
    if not now.shows(best):
        return None
    items = [*bare.accepted[:i], now.accept(best, bare.view), *bare.accepted[i:]]
    return refined(bare.with_accepted(items), rounds=2)


def compare_laws_with_kernel(problem: ScoringProblem, unknown: CauseFinding) -> RivalLaws:
    """The laws in place of the kernel that was found, which is wide and may follow what depends on something else, and
    is another in each nest."""
    laws = rival_laws(problem.view, level="nest")
    return _rivals(_best_of(problem, [], laws, unknown.floor), unknown.evidence[unknown.name])


def compare_laws_with_scatter(problem: ScoringProblem, name: str, upper: Floats) -> RivalLaws:
    """The laws in place of a variance of the floor that was let free beyond its bound, of upper (3); in place of a walk
    one that returns, too, and in that of single readings of a part moved by hand whatever it met on its way."""
    bounded = with_bounded_variance(problem, name, upper)
    scatter, law = problem.fit(), bounded.fit()
    gain = scatter.space.profile - law.space.profile - OCCAM_NATS
    # What comes to rest elsewhere from another side scatters as much, but is alike whenever it comes from there.
    sides = (replace(c, name=f"{c.name}/{i}") for i, c in enumerate(came_from(problem.view)))
    laws = chain(rival_laws(problem.view, level="run"), sides)
    found = _rivals(_best_of(bounded, [], laws, law.floor), gain + CHOICE_NATS)
    if name != BiasWalk.id:
        return found
    if _moved_freely(problem.view):
        return RivalLaws(np.inf, ("time",))
    returning = RivalLaws(nats_ahead(problem), ("time",))
    return max(found, returning, key=lambda laws: laws.lead)


def _moved_freely(view: ResidualView) -> bool:
    """Whether nobody knows the poses and no visit is more than one reading: a field that differs from place to place
    wanders from one to the next as a bias does."""
    return not view.scene.recipe.pose_known and bool(np.all(view.reduced.count.sum(1) <= 1))


def _rivals(laws: Mapping[str, RankedCause], evidence: float) -> RivalLaws:
    if not laws:
        return RivalLaws(-np.inf, ())
    top = max(r.evidence for r in laws.values())
    near = sorted((r for r in laws.values() if r.evidence > top - NEAR_NATS), key=lambda r: -r.evidence)
    words = tuple(dict.fromkeys(word for r in near for word in covariates_of_law(r.name)))
    return RivalLaws(top - evidence, words)


def _best_of(
    problem: ScoringProblem, causes: list[Candidate], laws: Iterable[Candidate], floor: NoiseFloor
) -> dict[str, RankedCause]:
    """The causes, and the laws that are near the best, each under the best of the floors that the leaders ask for."""
    return _ranked(problem, causes, _promising(problem, causes, laws, floor), floor)


def _ranked(
    problem: ScoringProblem, causes: list[Candidate], promising: list[Candidate], floor: NoiseFloor
) -> dict[str, RankedCause]:
    """The same of laws that are near the best."""
    if not promising:
        return {}
    names = {law.name for law in promising}
    banks, first = _under(problem, [*causes, *promising], floor)
    ranks = rank_causes(problem, banks, first, tuple(names), [*_as_they_are(problem, banks)])
    return {name: r for name, r in ranks.items() if r.best is not None}


def _promising(
    problem: ScoringProblem, causes: list[Candidate], laws: Iterable[Candidate], floor: NoiseFloor
) -> list[Candidate]:
    """The laws near the best of laws and causes. Of very many visits some laws at a time: each has courses of every
    visit, and hardly any is near."""
    totals, kept = dict[str, float](), list[Candidate]()
    following = iter(laws)
    at_once = max(FEWEST_LAWS_AT_ONCE, COURSES_AT_ONCE // max(len(problem.view.keep), 1))
    sampled = _SampledLaws(problem, floor)
    some = [*causes, *(found := list(islice(following, at_once)))]
    while some:
        if some := sampled.not_far_behind(some):
            banks, first = _under(problem, some, floor)
            without = np.max([m.in_each_space() for m in (first, *_as_they_are(problem, banks))], axis=0)
            values = first.totals() - without[first.best.space_index]
            totals |= {c.name: float(x) for c, x in zip(first.candidates, values, strict=True)}
        least = max(totals.values()) - PROMISING_NATS
        kept = [law for law in (*kept, *found) if totals.get(law.name, -np.inf) > least]
        some = found = list(islice(following, at_once))
    return kept


def _as_they_are(problem: ScoringProblem, banks: Sequence[Bank]) -> Iterator[WalkMarginal]:
    """The readings without any candidate under the floor that fits them best, where some candidates move within the
    visits and others do not: means that a floor with the cause finds far off weigh less beside quiet dwells, so that
    what moves would seem to explain twice as much."""
    if len(banks) > 1:
        yield WalkMarginal(score_bank(problem, [bank.only([]) for bank in banks], problem.fit().floor), (), ())


class _SampledLaws:
    """Laws and causes, some after others, as two samples of a fleet's units show them."""

    def __init__(self, problem: ScoringProblem, floor: NoiseFloor) -> None:
        samples = (sampled_units(problem.setting, SAMPLE_UNITS, which) for which in (0, 1))
        self._floor, self._samples = floor, [sample for sample in samples if sample is not None]
        self._best = [-np.inf for _ in self._samples]

    def not_far_behind(self, items: list[Candidate]) -> list[Candidate]:
        """Those of some more that are not so far behind the best in both samples that they cannot be near it in all
        units; a unit unlike all others is in one of the two at most."""
        near = set[str]() if self._samples else {c.name for c in items}
        for i, sample in enumerate(self._samples):
            (found,) = sample.scored(items, [self._floor])
            evidence = found.readings().evidence[0]
            self._best[i] = max(self._best[i], float(evidence.max()))
            far = sample.surely(self._best[i] - evidence) > PROMISING_NATS
            near |= {c.name for c, f in zip(found.candidates, far, strict=True) if not f}
        return [c for c in items if c.name in near]


def _under(problem: ScoringProblem, items: list[Candidate], floor: NoiseFloor) -> tuple[tuple[Bank, ...], WalkMarginal]:
    # Where nothing moves within the visits, what does is no space to look at.
    kinds = sorted({c.moving for c in items})
    banks = tuple(build_bank(items, problem.view.layout, moving=moving) for moving in kinds)
    return banks, WalkMarginal(score_bank(problem, banks, floor), (), ())
