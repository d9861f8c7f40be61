"""Readings by chance alone: null data sets drawn from the floor, and what the whole bank makes of them.

A fleet beyond MAX_DRAWN_UNITS units is drawn as several copies of some of its units: what a set says is a sum over
units, and the sums of the copies are dealt in other orders, so that every set gets other chances from each copy. The
mean of a sum of c copies is then known to √(c / NULL_SETS) of its spread.

What a cause does may be added to every set: the same, then, of readings by that cause and chance alone.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice

import numpy as np

from station.diagnosis.candidates.projected_bank import ProjectedBank
from station.diagnosis.candidates.visit_scan import VisitColumns, passed_back
from station.diagnosis.linear.evidence import DataSets
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.linear.projection import DataColumns
from station.diagnosis.search.bounded_floor import BoundedFloor
from station.diagnosis.search.null_noise import NullNoise, noise_of_floor
from station.diagnosis.search.scoring import Scores, ScoringProblem
from station.diagnosis.search.walk_marginal import WalkMarginal, replicate_units
from station.domain.core.types import Array, Floats

#: Null data sets, and in how many floors drawn from the estimate's uncertainty: the more the better, but for copies of
#: units, which are dealt anew within one floor. Floors whose sets are judged at once.
NULL_SETS, NULL_FLOORS, COPIED_FLOORS, FLOORS_AT_ONCE = 1024, 64, 16, 16
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
    floors, at_once = (NULL_FLOORS, FLOORS_AT_ONCE) if copies == 1 else (COPIED_FLOORS, 1)
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


class SinglePrecisionBank:
    """A bank as a space sees it, in single precision, which is enough for chance."""

    def __init__(self, projected: ProjectedBank) -> None:
        assert projected.space is not None
        self.space = projected.space
        self.runs, self.basis = self.space.covariance.runs.single_precision(), self.space.basis.astype(np.float32)
        self.spectra = [f.spectrum.single_precision() for f in projected.found]
        self.axes = [f.axes for f in projected.found if f.axes is not None]
        dense = [x for x in self.axes if not isinstance(x, VisitColumns)]
        self.dense = np.concatenate(dense, axis=2) if dense else np.zeros((*self.space.data.shape, 0), np.float32)
        self.ends = np.cumsum([x.shape[2] for x in dense])[:-1]

    def scores(self, drawn: Sequence[NullNoise], orders: Array | None) -> tuple[Floats, Floats]:
        """Log evidence (n, candidates) and log-likelihood (n) without any, of noise that is whitened as the space
        does; orders (copies, n) of the sets."""
        data = np.concatenate([self.whitened(one) for one in drawn])
        sets = DataSets.of(self.space, data)
        total = sets.sum_over_copies(orders)
        found = []
        for s, product in zip(self.spectra, self._products(data.transpose(1, 0, 2)), strict=True):
            u = s.components(product.sum(1) if s.pattern == "shared" else product, sets)
            found.append(s.judged(_sum_over_copies(s.terms(u, sets), orders), total))
        return np.stack(found, axis=1) if found else np.zeros((len(data), 0)), total.fits

    def _products(self, data: Array) -> Iterator[Array]:
        """The products (n, U, K) of data (U, n, M) with the axes of each candidate."""
        dense = iter(np.split((data @ self.dense).transpose(1, 0, 2), self.ends, axis=2))
        scans = [x for x in self.axes if isinstance(x, VisitColumns)]
        back = passed_back(self.runs, data.swapaxes(1, 2), scans[0].columns.shape[2]) if scans else None
        for axes in self.axes:
            if isinstance(axes, VisitColumns) and back is not None:
                product = axes.products(back)
                yield np.moveaxis(product.reshape(len(product), -1, product.shape[-1]), -1, 0)
            else:
                yield next(dense)

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


def _sum_over_copies(terms: Array, orders: Array | None) -> Array:
    """Terms (n, …) summed over the copies, each in its own order."""
    return terms if orders is None else np.asarray(sum(terms[order] for order in orders))
