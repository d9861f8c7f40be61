"""The bank under all the walks that a healthy floor may hold.

How much of a slow course is the floor's own random walk is hardly known from a few runs, and a slow cause is judged
very differently under a small and under a large one. The evidence of slow candidates is therefore averaged over the
walk, each size weighted by how well it explains the data with and without the candidate. Other candidates do not
notice, and are seen under the best floor only.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from station.diagnosis.candidates.bank import Bank, Candidate, build_bank
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.scoring import (
    ScoredBank,
    Scores,
    ScoringProblem,
    evidence_by_cause,
    score_bank,
    score_under_floors,
)
from station.diagnosis.search.unit_sample import FLOOR_UNITS, HOPELESS_NATS, sampled_units
from station.domain.core.types import Array, Floats

#: Walks tried, as parts of the largest allowed.
WALK_FRACTIONS = (0.0, 0.25, 0.5, 1.0)
#: A candidate is slow when the largest walk adds this share to the noise along it.
SLOW_SHARE = 0.3
#: Units that it takes to see which candidates are slow.
PROBE_UNITS = 2
#: Kernels with slow and fast directions: on the average they are not slow, yet they can follow a walk.
FLEXIBLE_KERNELS = ("time", "temperature", "unit", "time*temperature")


@dataclass(frozen=True, slots=True, eq=False)
class WalkMarginal:
    """best: the whole bank under the floor that fits best; sides: the slow candidates under each walk; slow: their
    places in `best.candidates`; hopeless: how many walks more were tried that a fleet speaks against so clearly that
    nothing of them is left in the average."""

    best: ScoredBank
    walk_stages: tuple[ScoredBank, ...]
    slow: tuple[int, ...]
    hopeless: int = 0

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All candidates."""
        return self.best.candidates

    @property
    def stages(self) -> tuple[ScoredBank, ...]:
        """All stages, the best one first."""
        return (self.best, *self.walk_stages)

    def evidence(self) -> dict[str, float]:
        """Log evidence of each cause for the readings."""
        return {name: float(e[0]) for name, e in self.scores([s.readings() for s in self.stages]).items()}

    def scores(self, scores: Sequence[Scores]) -> dict[str, Floats]:
        """Log evidence (n) of each cause, from the scores of each stage."""
        return evidence_by_cause(self.candidates, self.candidate_scores(scores))

    def candidate_scores(self, scores: Sequence[Scores]) -> Floats:
        """The same of each candidate (n, candidates)."""
        evidence = scores[0].evidence.copy()
        if self.slow:
            with_it, without = self._averaged(scores[1:])
            evidence[:, list(self.slow)] = with_it - without[:, self.walk_stages[0].space_index]
        return evidence

    def totals(self) -> Floats:
        """Log-likelihood of the readings with each candidate (candidates), averaged over amplitudes and walks."""
        total = self.best.readings().evidence[0] + self.without()
        if self.slow:
            total[list(self.slow)] = self._averaged([s.readings() for s in self.walk_stages])[0][0]
        return np.asarray(total)

    def without(self) -> Floats:
        """The same without any candidate, in the space of each candidate (candidates)."""
        return np.asarray(self.in_each_space()[self.best.space_index])

    def in_each_space(self) -> Floats:
        """The same without any candidate (spaces)."""
        return self._mean(np.stack([s.readings().fits[0] for s in self.walk_stages or (self.best,)], axis=-1))

    def _averaged(self, scores: Sequence[Scores]) -> tuple[Floats, Floats]:
        """Log-likelihood averaged over the walks: with each slow candidate (n, slow), without in each space (n, 2)."""
        fits = np.stack([s.fits for s in scores], axis=-1)
        found = np.stack([s.evidence for s in scores], axis=-1)
        return self._mean(fits[:, self.walk_stages[0].space_index] + found), self._mean(fits)

    def _mean(self, likelihood: Floats) -> Floats:
        """Log of the mean over all walks tried of likelihoods (…, stages), next to none of those without hope."""
        stages = likelihood.shape[-1]
        return np.asarray(log_mean_exp(likelihood) + np.log(stages / (stages + self.hopeless)))


def score_over_walks(problem: ScoringProblem, banks: Sequence[Bank], at: NoiseFloor) -> WalkMarginal:
    """The bank under a floor and its walks."""
    return marginalise_walks(problem, score_bank(problem, banks, at))


def marginalise_walks(problem: ScoringProblem, best: ScoredBank) -> WalkMarginal:
    """A stage with the walks beside it."""
    slow = slow_candidates(problem, [s.bank for s in best.projected], best.floor)
    if not slow:
        return WalkMarginal(best, (), ())
    floors = _walks(problem, best.floor)
    chosen_floors = _hopeful(problem, best, slow, floors)
    found = _score_slow_candidates(partial(score_under_floors, problem.setting), best, slow, chosen_floors)
    return replace(found, hopeless=len(floors) - len(chosen_floors))


def slow_candidates(problem: ScoringProblem, banks: Sequence[Bank], floor: NoiseFloor) -> tuple[int, ...]:
    """Places, among all candidates of some banks, of those that are judged over all walks; none where nothing walks."""
    most = float(np.sqrt(problem.upper[2]))
    if not 0.0 < most < np.inf:
        return ()
    chosen = [_slow_candidates(problem, bank, floor, most) for bank in banks]
    start = np.cumsum([0, *(len(bank.candidates) for bank in banks)])
    return tuple(int(a + i) for a, c in zip(start[:-1], chosen, strict=True) for i in c)


def replicate_units(
    problem: ScoringProblem, banks: Sequence[Bank], floor: NoiseFloor, slow: tuple[int, ...], chosen: Array, copies: int
) -> WalkMarginal:
    """A panel of the chosen units alone, as if there were so many times as many of them, with the axes. slow: see
    `slow_candidates`."""
    setting, visits = problem.setting.of_units(chosen)
    items = [c.select_visits(visits) for bank in banks for c in bank.candidates]
    panel = [build_bank(items, setting.layout, moving=bank.moving) for bank in banks]
    at = partial(score_under_floors, setting, copies=copies, axes=True)
    (best,) = at(panel, [floor])
    return _score_slow_candidates(at, best, slow, _walks(problem, floor)) if slow else WalkMarginal(best, (), ())


def _walks(problem: ScoringProblem, floor: NoiseFloor) -> list[NoiseFloor]:
    """A floor with each walk that is tried."""
    most = float(np.sqrt(problem.upper[2]))
    return [replace(floor, walk=part * most) for part in WALK_FRACTIONS]


def _score_slow_candidates(
    at: Callable[[Sequence[Bank], Sequence[NoiseFloor]], tuple[ScoredBank, ...]],
    best: ScoredBank,
    slow: tuple[int, ...],
    floors: Sequence[NoiseFloor],
) -> WalkMarginal:
    """The slow candidates under each of some walks beside the best floor."""
    same = best.only(slow)
    found = iter(
        at([s.bank for s in same.projected], others) if (others := [f for f in floors if f != best.floor]) else ()
    )
    return WalkMarginal(best, tuple(same if f == best.floor else next(found) for f in floors), slow)


def _hopeful(
    problem: ScoringProblem, best: ScoredBank, slow: tuple[int, ...], floors: list[NoiseFloor]
) -> list[NoiseFloor]:
    """The walks of which anything may be left in the average over all of them with any slow candidate."""
    sample = sampled_units(problem.setting, FLOOR_UNITS)
    if sample is None:
        return floors
    # What moves within the visits changes next to nothing of how likely a walk is without it.
    every = score_under_floors(problem.setting, [best.projected[0].bank.only([])], floors)
    without = np.array([s.readings().fits[0, :1] for s in every])
    if np.all(without.max() - without <= HOPELESS_NATS):
        return floors
    least = sample.behind([best.candidates[i] for i in slow], floors, without)
    return [f for f, nats in zip(floors, least.min(1), strict=True) if nats <= HOPELESS_NATS]


def _slow_candidates(problem: ScoringProblem, bank: Bank, floor: NoiseFloor, most: float) -> list[int]:
    """Places of the slow candidates in a bank: kernels that are by their name, the rest as its first units show."""
    flexible = [i for i, c in enumerate(bank.candidates) if c.name in FLEXIBLE_KERNELS]
    others = [i for i, c in enumerate(bank.candidates) if c.name not in FLEXIBLE_KERNELS]
    shares = _walk_shares(problem, bank.only(others), floor, most)
    return sorted([*flexible, *(i for i, share in zip(others, shares, strict=True) if share > SLOW_SHARE)])


def _walk_shares(problem: ScoringProblem, bank: Bank, floor: NoiseFloor, most: float) -> Floats:
    """What the largest walk adds to the noise along each candidate of a bank, as a share of that noise."""
    if not bank.made:
        return np.zeros(len(bank.candidates))
    layout = problem.view.layout
    units = next(layout.grid.parts(PROBE_UNITS))
    space = problem.setting.of_units(np.arange(units.stop))[0].space(floor, moving=bank.moving)
    columns, runs = space.project(bank.rows(layout, units)), space.covariance.runs
    U, R = runs.member.shape
    visits = columns[:, : R * runs.rows].reshape(U, R, runs.rows, -1)
    added = most**2 * problem.structure.walked(runs.transposed(visits), units)
    length = np.maximum(np.einsum("umk,umk->k", columns, columns), 1e-300)
    return np.array([added[at].sum() / max(float(length[at].sum()), 1e-300) for at in bank.place])
