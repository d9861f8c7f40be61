"""Where readings would be if a bit of the output were not stuck.

A bit stuck at 0 shifts what should have it down by its weight, one stuck at 1 what should not up. Above the noise whole
dwells are shifted, by nothing or by just that weight; by which is told by where the unit's offset and matrix put them:
of all ways to shift dwells that should feel alike that one is taken which leaves least, and then each dwell goes to
where it lies nearer. Near the noise each sample is shifted by chance, as likely as its dwell's mean makes it.
"""

from collections.abc import Callable, Collection
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import rows_of_units
from station.diagnosis.data.visit_noise import MAD_PER_SIGMA
from station.domain.core.types import Floats, SampleTable

#: Standard deviations of an offset and of what turns, both beside the stimulus, and of a matrix' entry, of new parts.
OFFSET_STD, TURN_STD, MATRIX_STD = 0.1, 1e-4, 0.03
#: Dwells that feel alike lie no further apart, beside the stimulus; so many kinds of them are shifted in all ways.
ALIKE, MOST_KINDS = 0.05, 7
#: Rounds in which each dwell goes to where it lies nearer, in which a dwell's samples say where its mean is, and in
#: which these means say where it should be.
DWELL_ROUNDS, SAMPLE_ROUNDS, LINE_ROUNDS = 12, 20, 3
#: Noises of a sample that a bit weighs if it moves a mean at all, and if samples lie on one side or the other.
LEAST_WEIGHT, APART = 1.0, 4.0
#: Noise of a sample, beside what the bit weighs, below which less tells nothing more.
LEAST_NOISE = 1e-3
#: Of the density at a dwell's mean, that of any sample far away; and twice the nats from which samples settle it.
STRAY_DENSITY, PLAIN = 1e-3, 16.0
#: Dwells that lie further, beside the weight, from where they should with and without it follow no pose that is known.
FOLLOWED = 0.35

#: Bits (place, what it always reads).
Bits = Collection[tuple[int, bool]]


class Dwells(NamedTuple):
    """Of one unit: samples (n, 3), the dwell of each (n), what a dwell should feel (v, 3), and the size of that."""

    reading: Floats
    where: NDArray[np.intp]
    true: Floats
    size: float

    def noise(self, axis: int, shift: float) -> float:
        """Noise of a sample of an axis, of which some are shifted: of what always reads the same hardly any."""
        step = np.diff(self.reading[:, axis])[self.where[1:] == self.where[:-1]]
        apart = np.abs(step - shift * np.round(step / shift))
        plain, folded = (float(np.median(x)) / MAD_PER_SIGMA / 2**0.5 if len(x) else 0.0 for x in (np.abs(step), apart))
        return max(folded if abs(shift) > APART * folded else plain, LEAST_NOISE * abs(shift))

    def mean(self, axis: int, shift: float) -> Floats:
        """Means (v) of an axis; where samples are parted in two, one part is laid on that with the median in it."""
        reading, count = self.reading[:, axis], np.bincount(self.where)
        order = np.lexsort([reading, self.where])
        middle = reading[order[np.cumsum(count) - count + count // 2]]
        off = reading - middle[self.where]
        if abs(shift) > APART * self.noise(axis, shift):
            off -= shift * np.round(off / shift)
        return np.asarray(middle + np.bincount(self.where, off) / count)

    def line(self, axis: int, shift: float) -> Callable[[Floats], tuple[Floats, float]]:
        """What gives, of means (v) of an axis, where the unit's offset and matrix put them (v), and what that leaves,
        in squares of their scatter."""
        true = self.true[:, axis]
        scatter = self.noise(axis, shift) / np.sqrt(np.bincount(self.where))
        std = np.maximum(np.hypot(scatter, TURN_STD * self.size), 1e-300)
        X = np.concatenate([np.ones((len(true), 1)), self.true], axis=1)
        prior = np.diag(1 / np.array([OFFSET_STD * self.size, *[MATRIX_STD] * 3]))
        A = np.concatenate([X / std[:, None], prior])
        solve = np.linalg.pinv(A)

        def fitted(mean: Floats) -> tuple[Floats, float]:
            b = np.concatenate([(mean - true) / std, np.zeros(4)])
            c = solve @ b
            return true + X @ c, float(np.sum((A @ c - b) ** 2))

        return fitted

    def shifted(self, axis: int, shift: float) -> tuple[Floats, float]:
        """Where the dwells of an axis should lie (v), some of which are shifted from there by -shift; and by how many
        nats that is likelier than that none is: offset and matrix at their best, the scatter as it is, less what the
        choice is worth."""
        mean, fitted, kind = self.mean(axis, shift), self.line(axis, shift), _kinds(self.true[:, axis], self.size)
        free = max(len(mean) - 4, 1)
        straight = fitted(np.bincount(self.where, self.reading[:, axis]) / np.bincount(self.where))[1]
        told = self._told_by_samples(axis, shift, mean)
        best, least, lowest = self.true[:, axis], np.inf, np.inf
        for some in product((0.0, shift), repeat=int(kind.max()) + 1):
            moved = np.where(np.abs(told) > PLAIN, shift * (told > 0), np.array(some)[kind])
            for _ in range(DWELL_ROUNDS):
                should, left = fitted(mean + moved)
                nearer = shift * (np.abs(mean + shift - should) < np.abs(mean - should))
                nearer = np.where(np.abs(told) > PLAIN, moved, nearer)
                if np.array_equal(nearer, moved):
                    break
                moved = nearer
            if (cost := left - float(np.sum(told * (moved != 0.0)))) < lowest:
                best, least, lowest = should, left, cost
        ratio = max(straight, free) / max(least, free)
        return best, 0.5 * free * float(np.log(ratio)) - (int(kind.max()) + 1) * float(np.log(2))

    def _told_by_samples(self, axis: int, shift: float, mean: Floats) -> Floats:
        """Twice the nats by which the samples of each dwell (v) say that it lies at its mean + shift, and not there:
        where an edge of the bit parts them, those on one side of it are shifted, and which side differs from edge to
        edge."""
        noise = self.noise(axis, shift)
        off = (self.reading[:, axis] - mean[self.where]) / noise
        place = np.array([-1.0, 0.0, 1.0])[:, None] * shift / noise
        beside, here, beyond = np.exp(-0.5 * (off - place) ** 2) + STRAY_DENSITY
        # Shifted, samples come from here or beyond; a dwell at its mean has them there or a shift below.
        at_mean, moved = np.log(beside + here), np.log(here + beyond)
        return np.asarray(2 * np.bincount(self.where, moved - at_mean))

    def share_shifted(self, axis: int, shift: float, noise: float) -> Floats:
        """How likely each sample (n) of an axis was shifted; 0 where the dwells follow no pose that is known."""
        mean, (should, _) = self.mean(axis, shift), self.shifted(axis, shift)
        off = np.minimum(np.abs(mean - should), np.abs(mean + shift - should))
        share = np.zeros(len(self.where))
        if np.sqrt(np.mean(off**2)) > FOLLOWED * abs(shift):
            return share
        fitted, reading, count = self.line(axis, shift), self.reading[:, axis], np.bincount(self.where)
        for _ in range(LINE_ROUNDS):
            mean = should
            for _ in range(SAMPLE_ROUNDS):
                off = reading - mean[self.where]
                share = 1 / (1 + np.exp(np.clip(((off + shift) ** 2 - off**2) / (2 * noise**2), -500, 500)))
                mean = np.bincount(self.where, reading + shift * share) / count
            should = fitted(mean)[0]
        return share


def _kinds(true: Floats, size: float) -> NDArray[np.intp]:
    """Which dwells (v) should feel alike on an axis, numbered from 0; of too many kinds the nearest are one."""
    order = np.argsort(true, kind="stable")
    gaps = np.diff(true[order])
    widest = np.sort(gaps[gaps > ALIKE * size])[::-1][: MOST_KINDS - 1]
    kind = np.zeros(len(true), np.intp)
    kind[order[1:]] = np.cumsum(gaps >= widest[-1]) if len(widest) else 0
    return kind


def dwells_of_unit(table: SampleTable, visit: NDArray[np.intp], true: Floats, unit: int) -> Dwells:
    """Those of a unit of a table whose samples are in visits (n), rising, which should feel true (v, 3)."""
    rows, size = rows_of_units(table.unit)[unit], float(np.linalg.norm(true, axis=1).max())
    first, last = int(visit[rows.start]), int(visit[rows.stop - 1])
    return Dwells(table.reading[rows], visit[rows] - first, true[first : last + 1], size)


def restored(dwells: Dwells, bits: Bits, lsb: float) -> Floats:
    """Samples (n, 3) of a unit some of whose bits are stuck as they would be without."""
    reading, code = dwells.reading.copy(), np.round(dwells.reading / lsb).astype(np.int64)
    rng = np.random.default_rng(0)
    for bit, high in bits:
        shift = lsb * 2.0**bit * (-1 if high else 1)
        for axis in range(reading.shape[1]):
            noise = max(dwells.noise(axis, shift), lsb)
            if np.any((code[:, axis] >> bit & 1) != high) or abs(shift) < LEAST_WEIGHT * noise:
                continue
            # One draw for each sample keeps the noise that there was.
            share = dwells.share_shifted(axis, shift, noise)
            reading[:, axis] += shift * (rng.random(len(share)) < share)
    return reading
