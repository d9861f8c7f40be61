"""The ranking of causes over all noise floors worth trying.

The floor that fits best when nothing new acts has swallowed a part of whatever does act. Each cause is therefore
judged under the floor that fits best with that cause: a profile of the likelihood over the floor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from station.diagnosis.candidates.bank import Bank, Candidate
from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.alarm import EXPLAINS_NATS
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem, evidence_by_cause, score_bank, score_in_noise
from station.diagnosis.search.unit_sample import FLOOR_UNITS, HOPELESS_NATS, UnitSample, sampled_units
from station.diagnosis.search.walk_marginal import WalkMarginal
from station.domain.core.types import Floats

#: What a free variance costs against a bounded one, in nats: its size could have been any in a range of e³.
OCCAM_NATS = 3.0
#: Causes that are a variance of the floor, and which.
FLOOR_VARIANCES = {"repeatability": 1, "bias-walk": 2}
#: What has less than this share of the leader's evidence is no rival under a floor that the leader asks for.
FAR_SHARE = 0.5
#: A floor is worth trying when it differs by more than this share from those tried.
FLOOR_TOLERANCE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class RankedCause:
    """One cause: log evidence over all its shapes, levels and floors; its best candidate, None for a cause that is
    a variance of the floor; and the stage where that stood best."""

    name: str
    evidence: float
    best: Candidate | None
    at: ScoredBank

    @property
    def numbers(self) -> int:
        """How many coefficients its best candidate has at the least, over all units; a variance has one."""
        if self.best is None:
            return 1
        return self.best.axes * (1 if self.best.pattern == "scan" else len(self.best.names))


def causes_of(ranks: Mapping[str, RankedCause]) -> list[RankedCause]:
    """The causes, without the kernels."""
    return [r for name, r in ranks.items() if name not in KERNEL_NAMES]


def leaders(ranks: Mapping[str, RankedCause]) -> tuple[RankedCause | None, RankedCause | None]:
    """The best cause and the best kernel."""
    causes, kernels = causes_of(ranks), [r for name, r in ranks.items() if name in KERNEL_NAMES]
    return max(causes, key=lambda r: r.evidence, default=None), max(kernels, key=lambda r: r.evidence, default=None)


def rank_causes(
    problem: ScoringProblem,
    banks: Sequence[Bank],
    first: WalkMarginal,
    words: Sequence[str],
    beside: Sequence[WalkMarginal] = (),
) -> dict[str, RankedCause]:
    """Every cause in the readings under the best of the floors visited, `first` the one without any of them. words: the
    kernels; beside: more floors without any of them.

    Without a cause the readings, too, have the best of these floors: what a floor gains by itself speaks for none. A
    floor whose scale, once free, would take its walk or its turns beyond what is allowed is none for them.
    """
    best: dict[str, RankedCause] = {}
    visited: list[WalkMarginal] = []
    now: WalkMarginal | None = first
    while now is not None and len(visited) < 6:
        visited.append(now)
        fair = [m for m in visited[1:] if _is_allowed(problem, m.best.floor, first.best.floor)]
        zero, best = np.max([marginal.in_each_space() for marginal in (first, *beside, *fair)], axis=0), {}
        for marginal in visited:
            keep_best(best, marginal, zero[marginal.best.space_index])
        now = _next_floor(problem, banks, best, visited, words)
    return best


def _is_allowed(problem: ScoringProblem, floor: NoiseFloor, first: NoiseFloor) -> bool:
    """Whether walk and turns of a floor are within their bounds still where its noise is that of the first one."""
    scaled = floor.variances[1:] * first.variances[0]
    return bool(np.all(scaled <= 1.01 * problem.upper[1:] * floor.variances[0]))


def keep_best(best: dict[str, RankedCause], now: WalkMarginal, zero: Floats) -> None:
    """Takes over what is more evident under the floor of `now`."""
    candidates, total = now.candidates, now.totals() - zero
    for name, value in evidence_by_cause(candidates, total[None]).items():
        if name not in best or value[0] > best[name].evidence:
            rows = [i for i, c in enumerate(candidates) if c.name == name]
            chosen = max(rows, key=lambda i: float(total[i]))
            best[name] = RankedCause(name, float(value[0]), candidates[chosen], now.best)


def _next_floor(
    problem: ScoringProblem,
    banks: Sequence[Bank],
    best: dict[str, RankedCause],
    visited: list[WalkMarginal],
    words: Sequence[str],
) -> WalkMarginal | None:
    """The bank under the floor of the leading cause, or else of the leading kernel, if that is a new one."""
    for kernel in (False, True):
        leader = max((r for r in best.values() if (r.name in words) == kernel), key=lambda r: r.evidence, default=None)
        if leader is None or leader.best is None or leader.evidence < 0 or not leader.at.shows(leader.best):
            continue
        with_it = problem.with_accepted((*problem.accepted, leader.at.accept(leader.best, problem.view)))
        found = with_it.fit(leader.at.floor).floor
        if all(_differ(found, m.best.floor) for m in visited):
            # With the leader known the walk is no longer in question: one floor is enough.
            first = visited[0].best
            if found.is_multiple_of(first.floor):
                return WalkMarginal(score_in_noise(problem, first, found), (), ())
            return WalkMarginal(score_bank(problem, _hopeful(problem, banks, found, visited, best), found), (), ())
    return None


def _hopeful(
    problem: ScoringProblem,
    banks: Sequence[Bank],
    at: NoiseFloor,
    visited: list[WalkMarginal],
    best: Mapping[str, RankedCause],
) -> Sequence[Bank]:
    """The causes of a fleet, with all their candidates, of which any may be better under a floor than under those that
    were visited, and then near the leader."""
    sample = sampled_units(problem.setting, FLOOR_UNITS)
    if sample is None:
        return banks
    floors = [*(m.best.floor for m in visited), at]
    empty = score_bank(problem, [bank.only([]) for bank in banks], at)
    fits = np.concatenate([s.readings().fits for s in (*(m.best for m in visited), empty)])
    lost = fits.max(0) - fits[-1]
    far, kept = _far_behind(sample, banks, best, at, lost), []
    for bank, without in zip(banks, fits.T, strict=True):
        near = bank.named({c.name for c in bank.candidates} - far)
        names = {c.name for c in near.candidates}
        if names and without.max() - without[-1] > HOPELESS_NATS:
            least = sample.behind(near.candidates, floors, without[:, None])[-1]
            pairs = zip(near.candidates, least, strict=True)
            # What hits few units may hit none of the sample.
            names = {c.name for c, nats in pairs if nats <= HOPELESS_NATS or c.pattern == "scan"}
        kept.append(near.named(names))
    return kept


def _far_behind(
    sample: UnitSample, banks: Sequence[Bank], best: Mapping[str, RankedCause], at: NoiseFloor, lost: Floats
) -> set[str]:
    """The causes that are far behind the leader under the floors that were visited, and in the sample under one more,
    too. lost (banks): by how many nats that is behind the best of those without any cause."""
    leader = max(best.values(), key=lambda r: r.evidence)
    most = min(FAR_SHARE * leader.evidence, leader.evidence - HOPELESS_NATS)
    far = {name for name, r in best.items() if r.evidence < most}
    if not far or leader.best is None:
        return set()
    rivals = [c for bank in banks for c in bank.candidates if c.name in far]
    (some,) = sample.scored([leader.best, *rivals], [at])
    evidence = some.readings().evidence[0]
    of_bank = np.array([[bank.moving for bank in banks].index(c.moving) for c in some.candidates])
    own = [c.name == leader.name for c in some.candidates]
    nats = sample.surely(evidence[own].max() - evidence) + lost[of_bank] - lost[of_bank[own][0]]
    # What hits few units may hit none of the sample, but under a floor that the leader asks for it doubles nothing.
    pairs = zip(some.candidates, nats, strict=True)
    return far - {c.name for c, behind in pairs if behind <= HOPELESS_NATS and c.pattern != "scan"}


def _differ(a: NoiseFloor, b: NoiseFloor) -> bool:
    return bool(
        np.any(np.abs(a.variances - b.variances) * _WEIGHT > FLOOR_TOLERANCE * (a.variances[0] + b.variances[0]))
    )


#: How much a variance counts beside white noise: a turn of 1 rad moves 1 g, a step of the walk adds up over a run.
_WEIGHT = np.array([1.0, 1.0, 10.0])


def with_free_variance(problem: ScoringProblem, name: str) -> ScoringProblem:
    """The problem with one variance of the floor let free beyond what is allowed."""
    upper = problem.upper.copy()
    upper[FLOOR_VARIANCES[name]] = np.inf
    return replace(problem, upper=upper)


def with_bounded_variance(problem: ScoringProblem, name: str, upper: Floats) -> ScoringProblem:
    """The problem with one variance of the floor held again within what is allowed, of `upper` (3)."""
    bounds = problem.upper.copy()
    bounds[FLOOR_VARIANCES[name]] = upper[FLOOR_VARIANCES[name]]
    return replace(problem, upper=bounds)


def floor_causes(problem: ScoringProblem, first: ScoredBank) -> dict[str, RankedCause]:
    """The causes that are variances of the floor, let free beyond what is allowed."""
    return {
        name: RankedCause(name, grown.gain - OCCAM_NATS, None, ScoredBank(grown.floor, first.projected))
        for name, i in FLOOR_VARIANCES.items()
        if (grown := problem.grown_floors.get(i)) is not None
    }


def variance_surprise(gain: float, dof: int) -> float:
    """−log₁₀ p of the nats that letting a variance free gains, where it is within its bound: half of χ²₁ (Self and
    Liang, J. Am. Stat. Assoc. 82 (1987) 605, case 5), or of F₁ of the residual degrees of freedom, by the bound of
    its tail that keeps the tail's end, which has no smallest number. What gains too little to be named surprises
    nobody."""
    if gain - OCCAM_NATS < EXPLAINS_NATS:
        return 0.0
    # With n degrees of freedom and y = e^(−2g/n) the tail is I_y(n/2, ½) ≤ y^(n/2) / (n/2 · B(n/2, ½) · √(1 − y)).
    half = 0.5 * dof
    nats = gain + np.log(half) + scipy.special.betaln(half, 0.5) + 0.5 * np.log(-np.expm1(-gain / half))
    return float((nats + np.log(2)) / np.log(10))
