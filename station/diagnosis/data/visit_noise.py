"""How noisy each visit is: a drive that idles here and brakes there, an axis that shakes where gravity loads it.

Noise is taken from differences of neighbours, which slow motion does not reach.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from station.domain.core.medians import medians
from station.domain.core.types import Floats

MAD_PER_SIGMA = 0.6745
#: Variance of the logarithm of a noise's square by the median of n differences, times n; and by how much, in such
#: logarithms, an axis may be noisier than the others.
MEDIAN_LOG_VARIANCE, MAX_LOG_VARIANCE = 8.0, 3.0
#: The same by the mean of n squares, none above that of so many standard deviations.
MEAN_LOG_VARIANCE, FURTHEST = 4.0, 3.0
#: A visit is noisier by itself beyond so many standard errors, by chance one of thirty thousand; the visits differ
#: altogether where their logarithms spread by so many standard errors more than chance makes them.
NOISIER_BY, DIFFERENT_BY = 4.0, 4.0
#: Of codes so many standard deviations wide each visit shows another noise by where it lies between two of them.
COARSE = 1.5
#: Sizes that a tally tells apart: 1,024 of each power of 2, from 2⁻⁹⁶ to 2³².
SHARE_BITS, LEAST_SIZE, SIZES = 42, (1023 - 96) << 10, 128 << 10
#: Axes share noise from this correlation and so many standard errors on; the least share of it that is an axis' own.
LEAST_SHARED, SHARED_BY, LEAST_OWN = 0.1, 5.0, 0.05
#: The logarithm of a noise's square is sought between this and its negative, halving so often.
MOST_LOG, HALVINGS = 30.0, 40
#: Fewer differences of a visit show no noise of its own.
LEAST_DIFFERENCES = 8


def sample_noise(reading: Floats, visit: NDArray[np.intp]) -> Floats:
    """Noise of a sample (3) from differences of neighbours in a visit; 0 where they never differ."""
    return NoiseTally.of(reading, visit).sigma()


class NoiseTally:
    """The noise of a sample of visits that come some after others. Distances of neighbours are counted by their size,
    to a thousandth of it: memory does not follow how many there are, and sizes of a converter are as they come."""

    def __init__(self) -> None:
        self._counts, self._sums, self._squares = np.zeros((3, SIZES)), np.zeros((3, SIZES)), np.zeros(3)

    @staticmethod
    def of(reading: Floats, visit: NDArray[np.intp]) -> "NoiseTally":
        """Of readings (n, 3) of visits (n)."""
        tally, near = NoiseTally(), np.abs(_differences(reading, visit)[0])
        for axis in range(3):
            column = np.ascontiguousarray(near[:, axis])
            # Leading bits of a number are its size on a scale of equal shares.
            size = np.clip((column.view(np.int64) >> SHARE_BITS) - LEAST_SIZE, 0, SIZES - 1)
            tally._counts[axis] = np.bincount(size, minlength=SIZES)
            tally._sums[axis] = np.bincount(size, column, SIZES)
        tally._squares = np.sum(near**2, axis=0)
        return tally

    def add(self, more: "NoiseTally") -> None:
        """Takes more visits."""
        self._counts += more._counts
        self._sums += more._sums
        self._squares += more._squares

    def sigma(self) -> Floats:
        """Noise of a sample of all visits together (3), by the median of all distances, to a thousandth."""
        return np.array([_noise(*of) for of in zip(self._counts, self._sums, self._squares, strict=True)])


def _noise(counts: Floats, sums: Floats, squares: float) -> float:
    """Noise of a sample from how many distances of neighbours there are of each size, rising, and their sums."""
    there = np.flatnonzero(counts)
    if not len(there):
        return 0.0
    robust = _spread_median(sums[there] / counts[there], counts[there]) / MAD_PER_SIGMA
    return float((robust if robust > 0 else np.sqrt(squares / counts.sum())) / np.sqrt(2))


def _spread_median(size: Floats, count: Floats) -> float:
    """Median of sizes (k), rising, so many of each, each spread as far as half way to those beside it: a converter's
    codes stand for all that lies between them, and the median of codes jumps from one to the next. 0 where most do not
    differ at all."""
    between = (size[1:] + size[:-1]) / 2
    low, high = np.append(0.0, between), np.append(between, size[-1])
    up_to = np.cumsum(count)
    k = int(np.searchsorted(up_to, up_to[-1] / 2))
    if size[k] <= 0:
        return 0.0
    share = (up_to[-1] / 2 - (up_to[k] - count[k])) / count[k]
    return float(low[k] + share * (high[k] - low[k]))


def axis_noise(sigma: Floats, differences: int) -> Floats:
    """Noise of each axis (3) beside the rms of those that have any, from that of a sample; drawn to 1 as far as chance
    alone makes them differ (James and Stein), and no further apart than noise of one kind may be. An axis that never
    scatters, as the third of an inclinometer, has 1."""
    live = sigma > 0
    if live.sum() < 2 or differences < 1:
        return np.ones(3)
    logs = 2 * np.log(sigma[live])
    # One degree of freedom is the mean's.
    apart = logs - logs.mean()
    apart = share_beyond_chance(apart, MEDIAN_LOG_VARIANCE / differences, len(logs) - 1) * apart
    variance, found = np.exp(np.clip(apart, -MAX_LOG_VARIANCE, MAX_LOG_VARIANCE)), np.ones(3)
    found[live] = np.sqrt(variance / variance.mean())
    return found


def share_beyond_chance(logs: Floats, variance: float, free: int) -> float:
    """The share of logarithms (…), each known with a variance, so many of them free, that stays where they are drawn to
    0 as far as chance alone makes them differ (James and Stein)."""
    squares = float(np.sum(logs**2)) / variance
    return 1 - free / squares if squares > free else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class VisitDifferences:
    """Distances of neighbours in each visit (v), in noises of a sample: count (v) of them; square, middle (v, 3) mean
    square, none above FURTHEST, and median; product (v, 3) mean product of x and y, y and z, z and x; least (3) the
    smallest that is not 0; known: whether any axis scatters."""

    count: NDArray[np.intp]
    square: Floats
    middle: Floats
    product: Floats
    least: Floats
    known: bool

    @staticmethod
    def join(parts: "Sequence[VisitDifferences]", *, known: bool) -> "VisitDifferences":
        """Those of all parts, in their order; known: whether any axis scatters in any of them."""
        count = np.concatenate([p.count for p in parts])
        square, middle, product = (
            np.concatenate([getattr(p, n) for p in parts]) for n in ("square", "middle", "product")
        )
        return VisitDifferences(count, square, middle, product, np.min([p.least for p in parts], axis=0), known)

    def beside(self, ratio: Floats) -> "VisitDifferences":
        """The same in other noises of a sample, of which those that it is in are so many (3)."""
        both = ratio * np.roll(ratio, -1)
        square, product = self.square * ratio**2, self.product * both
        return replace(self, square=square, middle=self.middle * ratio, product=product, least=self.least * ratio)

    def correlation(self) -> Floats:
        """What the noise of two axes has in common (3, 3), as a correlation; the unit matrix where that is so little
        that it changes no chance, or no more than chance makes it."""
        found, weight = np.eye(3), self.count[:, None]
        square, product = (np.sum(x * weight, axis=0) for x in (self.square, self.product))
        if not self.known or np.any(square <= 0) or np.any(self.least > COARSE):
            return found
        shared = product / np.sqrt(square * np.roll(square, -1))
        # Each difference has half of its square in common with the next.
        error = np.sqrt(1.5 / max(int(self.count.sum()), 1))
        if np.abs(shared).max() > max(SHARED_BY * error, LEAST_SHARED):
            i = np.arange(3)
            found[i, (i + 1) % 3] = found[(i + 1) % 3, i] = shared
        # Of three that share nearly everything nothing is left of one.
        return found if np.linalg.eigvalsh(found)[0] > LEAST_OWN else np.eye(3)

    def excess_variance(self, unit: NDArray[Any]) -> Floats:
        """Noise's square of each visit and axis (v, 3) beside that of a sample; 1 where chance explains it. unit (v):
        whose the visits are.

        Where the units differ altogether, or the visits of each, they are drawn to the middle of all, and of the unit,
        as far as chance makes them differ (James and Stein); a visit that stands out by itself counts in full. What is
        quieter by itself keeps the common noise: what stands still for another reason shall not outweigh the rest.
        """
        if not self.known or not self.count.any():
            return np.ones(self.square.shape)
        there = (self.count[:, None] > 0) & (self.square > 0)
        logs = np.log(np.where(there, self.square, 1.0))
        logs = np.where(there, logs - _middle(logs, there), 0.0)
        logs = np.where(self.least > COARSE, 0.0, logs)
        error = np.sqrt(MEAN_LOG_VARIANCE / np.maximum(self.count, 1))[:, None]
        told = there & (self.count[:, None] >= LEAST_DIFFERENCES)
        level = _of_units(logs, unit, told, error)
        rest = np.where(told, logs - level, 0.0)
        shared = _share_of_all(np.clip(rest / error, -NOISIER_BY, NOISIER_BY))
        found = level + shared * rest
        found = np.where(rest / error > NOISIER_BY, logs, found)
        if shared > 0 or level.any():
            found = found + _by_the_median(found, self.count)
        return np.asarray(np.exp(np.maximum(found, -MAX_LOG_VARIANCE)))


def _of_units(logs: Floats, unit: NDArray[Any], told: NDArray[np.bool_], error: Floats) -> Floats:
    """The middle of each unit's logarithms (v, 3), where the units differ altogether; each (v, 1) has a standard
    error."""
    level, number = np.zeros_like(logs), np.unique(unit, return_inverse=True)[1]
    units = int(number.max(initial=-1)) + 1
    middle, score = np.zeros((2, units, 3))
    for u in range(units):
        own = number == u
        middle[u] = _middle(logs[own], told[own])
        each = error[own][told[own].any(axis=1)]
        # A median of so many is known as well as a mean of two thirds of them.
        score[u] = middle[u] / np.sqrt(np.mean(each**2) * 1.5 / len(each)) if len(each) else 0.0
    level = (_share_of_all(score) * middle)[number] if units > 1 else level
    return np.where(told, level, 0.0)


def _share_of_all(score: Floats) -> float:
    """The share of logarithms in standard errors (…) that stays, where they spread altogether by more than chance."""
    squares, size = float(np.sum(score**2)), max(score.size, 1)
    return 1 - size / squares if squares > size + DIFFERENT_BY * np.sqrt(2 * size) else 0.0


def visit_differences(reading: Floats, visit: NDArray[np.intp], sigma: Floats) -> VisitDifferences:
    """Of readings (n, 3) of visits (n) whose samples have the noise sigma (3).

    Means of squares, since a median of coarse readings jumps from code to code; outliers count as FURTHEST
    noises of a sample, or of a noisier visit.
    """
    visits = int(visit.max()) + 1 if len(visit) else 0
    near, of = _differences(reading, visit)
    known = bool(np.any(sigma > 0))
    signed = near / np.where(sigma > 0, sigma, 1.0)
    count = np.bincount(of, minlength=visits)
    ratio = np.abs(signed)
    middle = _medians(ratio, of, count)
    # Of a much noisier visit nearly all would be cut off at the bound of the others.
    noise = middle / MAD_PER_SIGMA / np.sqrt(2)
    noisier = noise > 1 + NOISIER_BY / 2 * np.sqrt(MEDIAN_LOG_VARIANCE / np.maximum(count, 1))[:, None]
    furthest = FURTHEST * np.where(noisier, noise, 1.0)[of]
    bounded = np.clip(signed / np.sqrt(2), -furthest, furthest)
    square, product = (
        np.stack([np.bincount(of, column, visits) for column in x.T], axis=1) / np.maximum(count, 1)[:, None]
        for x in (bounded**2, bounded * np.roll(bounded, -1, axis=1))
    )
    least = np.min(ratio, axis=0, initial=np.inf, where=ratio > 0)
    return VisitDifferences(count, square, middle, product, least, known)


def _medians(values: Floats, of: NDArray[np.intp], count: NDArray[np.intp]) -> Floats:
    """Medians (v, 3) of the values (n, 3) of each visit (n), 0 where it has none. Visits with as many values are gone
    through together."""
    if np.any(np.diff(of) < 0):
        values = values[np.argsort(of, kind="stable")]
    first = np.cumsum(count) - count
    found = np.zeros((len(count), values.shape[1]))
    for many in np.unique(count[count > 0]).tolist():
        visits = np.flatnonzero(count == many)
        found[visits] = medians(values.T[:, first[visits, None] + np.arange(many)]).T
    return found


def _differences(reading: Floats, visit: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
    """Steps (n, 3) from neighbour to neighbour in a visit, and the visit of each."""
    within = visit[1:] == visit[:-1]
    return np.diff(reading, axis=0)[within], visit[1:][within]


def _by_the_median(logs: Floats, count: NDArray[np.intp]) -> Floats:
    """By how much (3) the logarithms (v, 3) of the noise's square of visits of so many differences (v) are to be raised
    so that half of all differences are below the median of the noise of a sample, which is how that was found. Of two
    units, one far noisier, the middle visit is neither's."""
    low, high = np.full(3, -MOST_LOG), np.full(3, MOST_LOG)
    share = count / count.sum()
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        below = share @ special.erf(MAD_PER_SIGMA / np.sqrt(2) * np.exp(-(logs + middle) / 2))
        low, high = np.where(below > 0.5, middle, low), np.where(below > 0.5, high, middle)
    return np.asarray((low + high) / 2)


def _middle(logs: Floats, there: NDArray[np.bool_]) -> Floats:
    """Median (3) of each axis over the visits that have one; 0 where none has."""
    return np.array([np.median(x[t]) if t.any() else 0.0 for x, t in zip(logs.T, there.T, strict=True)])
