"""Readings by chance alone: null data sets drawn from the floor, and what the whole bank makes of them.

A fleet beyond MAX_DRAWN_UNITS units is drawn as several copies of some of its units: what a set says is a sum over
units, and the sums of the copies are dealt in other orders, so that every set gets other chances from each copy. The
mean of a sum of c copies is then known to √(c / NULL_SETS) of its spread.

What a cause does may be added to every set: the same, then, of readings by that cause and chance alone.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.projected_bank import CandidateFit, ProjectedBank
from station.diagnosis.candidates.visit_scan import VisitColumns, passed_back
from station.diagnosis.linear.evidence import DataSets, EigenSpectrum
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.linear.projection import DataColumns
from station.diagnosis.search.bounded_floor import BoundedFloor
from station.diagnosis.search.null_noise import NullNoise, noise_of_floor
from station.diagnosis.search.scoring import Scores, ScoringProblem
from station.diagnosis.search.walk_marginal import WalkMarginal, replicate_units
from station.domain.core.types import Array, Floats

#: Null data sets, and in how many floors drawn from the estimate's uncertainty: the more the better, but for copies of
#: units, which are dealt anew within one floor.
NULL_SETS, NULL_FLOORS, COPIED_FLOORS = 1024, 64, 16
#: Sets judged at once, of as many floors as it takes; and numbers, one for each set and amplitude of each candidate
#: that is judged together with others of its shape: a megabyte.
SETS_AT_ONCE, NUMBERS_AT_ONCE = 256, 1 << 18
#: The most units that are drawn one by one.
MAX_DRAWN_UNITS = 32


def scores(
    problem: ScoringProblem,
    fitted: FittedFloor,
    like: WalkMarginal,
    seed: int,
    sets: int = NULL_SETS,
    signal: DataColumns | None = None,
) -> Iterator[dict[str, Floats]]:
    """Log evidence (n) of each cause in null data sets, some sets after others; signal: one column that is added to
    every set."""
    rng = np.random.default_rng(seed)
    units = problem.view.grid.units
    copies = -(-units // MAX_DRAWN_UNITS)
    chosen = np.sort(rng.permutation(units)[: units // copies])
    every = [stage.bank for stage in like.best.projected]
    now = replicate_units(problem, every, like.best.floor, like.slow, chosen, copies)
    banks = [[SinglePrecisionBank(s) for s in stage.projected] for stage in now.stages]
    floors = NULL_FLOORS if copies == 1 else COPIED_FLOORS
    at_once = max(1, SETS_AT_ONCE * floors // sets) if copies == 1 else 1
    bounded = BoundedFloor.of(fitted, problem.upper) if copies == 1 and signal is None else None
    noise = noise_of_floor(problem, fitted, now, rng, floors, sets // floors, bounded)
    if signal is not None:
        dwell = any(s.space is not None and s.space.dwell for stage in now.stages for s in stage.projected)
        seen = (signal if dwell else DataColumns(signal.visit)).of_units(chosen)
        noise = map(partial(NullNoise.beside, signal=seen), noise)
    while drawn := list(islice(noise, at_once)):
        orders = copy_orders(len(drawn[0].noise), copies, rng) if copies > 1 else None
        scored = [[light.scores(drawn, orders) for light in stage] for stage in banks]
        yield now.scores(
            [
                Scores(np.concatenate([e for e, _ in stage], axis=1), np.stack([f for _, f in stage], axis=1))
                for stage in scored
            ]
        )


def copy_orders(sets: int, copies: int, rng: np.random.Generator) -> Array:
    """The order (copies, sets) in which each copy is dealt: shifted by another step, so that no set meets itself."""
    steps = rng.permutation(sets * -(-copies // sets))[:copies] % sets
    return np.asarray((np.arange(sets) + steps[:, None]) % sets)


class AlikeCandidates(NamedTuple):
    """Candidates of one shape in a bank: which, what they can show, and their axes, or how many columns of axes each of
    them has among those of the bank."""

    which: NDArray[np.intp]
    spectrum: EigenSpectrum
    axes: VisitColumns | int

    @staticmethod
    def of(found: Sequence[CandidateFit]) -> "list[AlikeCandidates]":
        """From what was found of each candidate of a bank."""
        alike: dict[int, list[int]] = {}
        for i, fit in enumerate(found):
            alike.setdefault(id(fit.alike), []).append(i)
        return [AlikeCandidates._of_some(np.array(which, np.intp), found) for which in alike.values()]

    @staticmethod
    def _of_some(which: NDArray[np.intp], found: Sequence[CandidateFit]) -> "AlikeCandidates":
        some = [found[i] for i in which]
        axes = some[0].axes
        assert axes is not None
        spectrum = some[0].alike.of(np.array([fit.place for fit in some], np.intp)).single_precision()
        return AlikeCandidates(which, spectrum, axes if isinstance(axes, VisitColumns) else axes.shape[2])


class SinglePrecisionBank:
    """A bank as a space sees it, in single precision, which is enough for chance."""

    def __init__(self, projected: ProjectedBank) -> None:
        assert projected.space is not None
        self.space, found = projected.space, projected.found
        self.runs, self.basis = self.space.covariance.runs.single_precision(), self.space.basis.astype(np.float32)
        self.alike, self._candidates = AlikeCandidates.of(found), len(found)
        dense = [found[i].axes for alike in self.alike if isinstance(alike.axes, int) for i in alike.which]
        self.dense = np.concatenate(dense, axis=2) if dense else np.zeros((*self.space.data.shape, 0), np.float32)

    def scores(self, drawn: Sequence[NullNoise], orders: Array | None) -> tuple[Floats, Floats]:
        """Log evidence (n, candidates) and log-likelihood (n) without any, of noise that is whitened as the space
        does; orders (copies, n) of the sets."""
        data = np.concatenate([self.whitened(one) for one in drawn])
        sets = DataSets.of(self.space, data)
        total = sets.sum_over_copies(orders)
        found = np.zeros((len(data), self._candidates))
        for alike, products in zip(self.alike, self._products(data.transpose(1, 0, 2)), strict=True):
            for some in _few_at_once(alike.spectrum, len(data)):
                can, product = alike.spectrum.of(some), products[some]
                u = can.components(product.sum(2) if can.pattern == "shared" else product, sets)
                found[:, alike.which[some]] = can.judged(_sum_over_copies(can.terms(u, sets), orders), total).T
        return found, total.fits

    def _products(self, data: Array) -> Iterator[Array]:
        """The products (b, n, U, K) of data (U, n, M) with the axes of candidates that are alike."""
        along, end = data @ self.dense, 0
        scans = [alike.axes for alike in self.alike if isinstance(alike.axes, VisitColumns)]
        back = passed_back(self.runs, data.swapaxes(1, 2), scans[0].columns.shape[2]) if scans else None
        for alike in self.alike:
            if isinstance(alike.axes, VisitColumns):
                assert back is not None
                product = alike.axes.products(back)
                yield np.moveaxis(product.reshape(len(product), -1, product.shape[-1]), -1, 0)[None]
            else:
                start, end = end, end + len(alike.which) * alike.axes
                mine = along[..., start:end].reshape(*along.shape[:2], -1, alike.axes)
                yield np.ascontiguousarray(mine.transpose(2, 1, 0, 3))

    def whitened(self, drawn: NullNoise) -> Array:
        """White noise (n, U, ·) of a true floor as the space whitens it."""
        noise, visits = drawn
        m, space, n = self.runs.rows, self.space, len(noise)
        U, R = self.runs.member.shape
        white = self.runs.whiten(visits)
        inside = noise[:, :, R * m : R * m + space.dwell]
        priors = noise[:, :, noise.shape[2] - (space.live.shape[1] - R * m - space.dwell) :]
        rows = np.concatenate([white.transpose(3, 0, 1, 2).reshape(n, U, R * m), inside, priors], axis=2)
        taken = (rows.transpose(1, 0, 2) @ self.basis) @ self.basis.transpose(0, 2, 1)
        return np.asarray(rows - taken.transpose(1, 0, 2))


def _few_at_once(alike: EigenSpectrum, sets: int) -> Iterator[slice]:
    """Some after others of what is alike, few enough for a processor's cache: each has a number for each set and
    amplitude, and where known columns stand beside it or groups are apart, for each of its coefficients."""
    each = sets * alike.rho.shape[-1]
    if alike.pattern != "shared" and (alike.pattern == "scan" or alike.cross.shape[-1]):
        each *= max(alike.m[0].size, 1)
    step = max(1, NUMBERS_AT_ONCE // max(each, 1))
    return (slice(first, first + step) for first in range(0, len(alike.m), step))


def _sum_over_copies(terms: Array, orders: Array | None) -> Array:
    """Terms (b, n, …) summed over the copies, each in its own order."""
    return terms if orders is None else np.asarray(sum(terms[:, order] for order in orders))
