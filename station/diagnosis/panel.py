"""The bank under all the walks that a healthy floor may hold.

How much of a slow course is the floor's own random walk is hardly known from a few runs, and a slow cause is judged
very differently under a small and under a large one. The evidence of slow candidates is therefore averaged over the
walk, each size weighted by how well it explains the data with and without the candidate. Other candidates do not
notice, and are seen under the best floor only.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.bank import Bank, Candidate
from station.diagnosis.evidence import Sets, log_mean
from station.diagnosis.floor import Floor
from station.diagnosis.stage import Problem, Stage, by_cause, stage
from station.domain.types import Floats

#: Walks tried, as parts of the largest allowed.
WALKS = (0.0, 0.25, 0.5, 1.0)
#: A candidate is slow when the largest walk adds this share to the noise along it.
SLOW = 0.3
#: Kernels with slow and fast directions: on the average they are not slow, yet they can follow a walk.
FLEXIBLE = ("time", "temperature", "unit")


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """best: the whole bank under the floor that fits best; sides: the slow candidates under each walk; slow: their
    places in `best.candidates`."""

    best: Stage
    sides: tuple[Stage, ...]
    slow: tuple[int, ...]

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All candidates."""
        return self.best.candidates

    @property
    def stages(self) -> tuple[Stage, ...]:
        """All stages, the best one first."""
        return (self.best, *self.sides)

    def readings(self) -> list[list[Sets]]:
        """The readings as the data set of each space of each stage."""
        return [s.readings() for s in self.stages]

    def scores(self, sets: Sequence[Sequence[Sets]]) -> dict[str, Floats]:
        """Log evidence (n) of each cause, for data sets of each space of each stage."""
        evidence = self.best.evidence(sets[0])
        if self.slow:
            with_it, without = self._averaged(sets[1:])
            evidence[:, list(self.slow)] = with_it - without[:, self._spaces(self.sides[0])]
        return by_cause(self.candidates, evidence)

    def totals(self) -> Floats:
        """Log-likelihood of the readings with each candidate (candidates), averaged over amplitudes and walks."""
        sets = self.readings()
        total = self.best.evidence(sets[0])[0] + self.without()
        if self.slow:
            total[list(self.slow)] = self._averaged(sets[1:])[0][0]
        return np.asarray(total)

    def without(self) -> Floats:
        """The same without any candidate, in the space of each candidate (candidates)."""
        if not self.sides:
            return np.asarray(self.best.fits(self.best.readings())[0][self._spaces(self.best)])
        sets = [s.readings() for s in self.sides]
        fits = np.stack([s.fits(d)[0] for s, d in zip(self.sides, sets, strict=True)], axis=-1)
        return np.asarray(log_mean(fits)[self._spaces(self.best)])

    def _averaged(self, sets: Sequence[Sequence[Sets]]) -> tuple[Floats, Floats]:
        """Log-likelihood averaged over the walks: with each slow candidate (n, slow), without in each space (n, 2)."""
        fits = np.stack([s.fits(d) for s, d in zip(self.sides, sets, strict=True)], axis=-1)
        found = np.stack([s.evidence(d) for s, d in zip(self.sides, sets, strict=True)], axis=-1)
        return np.asarray(log_mean(fits[:, self._spaces(self.sides[0])] + found)), np.asarray(log_mean(fits))

    @staticmethod
    def _spaces(of: Stage) -> NDArray[np.intp]:
        """Which space each candidate of a stage is seen in."""
        return np.repeat(np.arange(len(of.seen)), [len(s.spectra) for s in of.seen])


def panel(problem: Problem, banks: Sequence[Bank], at: Floor) -> Panel:
    """The bank under a floor and its walks."""
    return beside(problem, stage(problem, banks, at))


def beside(problem: Problem, best: Stage) -> Panel:
    """A stage with the walks beside it."""
    most = float(np.sqrt(problem.upper[2]))
    if not 0.0 < most < np.inf:
        return Panel(best, (), ())
    chosen = [_slow(problem, i, best, most) for i in range(len(best.seen))]
    if not any(len(c) for c in chosen):
        return Panel(best, (), ())
    banks = [s.bank.only(c) for s, c in zip(best.seen, chosen, strict=True)]
    start = np.cumsum([0, *(len(s.spectra) for s in best.seen)])
    slow = tuple(int(a + i) for a, c in zip(start[:-1], chosen, strict=True) for i in c)
    sides = tuple(stage(problem, banks, replace(best.floor, walk=part * most)) for part in WALKS)
    return Panel(best, sides, slow)


def _slow(problem: Problem, i: int, best: Stage, most: float) -> list[int]:
    """Places of the slow candidates in one of the banks of a stage."""
    seen = best.seen[i]
    covariance = seen.space.covariance
    walk = problem.structure.relative(covariance.inverse)[covariance.member, 2]
    U, R, m, _ = walk.shape
    axes = seen.axes[:, : R * m].reshape(U, R, m, -1)
    added = most**2 * np.einsum("urmk,urmk->k", axes, walk @ axes)
    length = np.maximum(np.einsum("umk,umk->k", seen.axes, seen.axes), 1e-300)
    share = [float(added[at].sum() / length[at].sum()) for at in seen.place]
    names = [c.name for c in seen.bank.candidates]
    return [j for j, (s, name) in enumerate(zip(share, names, strict=True)) if s > SLOW or name in FLEXIBLE]
