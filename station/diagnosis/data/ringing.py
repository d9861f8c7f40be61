"""Whether the fixture rings within the dwells, faster than the blocks of a dwell follow.

What a move leaves in the dwell after it is the regression of the samples at one place of the dwells on the last move.
There a wave that dies away is looked for, beyond what dies away without one; the best is judged by the dwells'
own projections on it: a share R² of N of them explained by the moves leaves −(N−1)·ln(1 − R²), exponential in noise of
any colour (`faults/phase_agreement.py`).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.phase_agreement import agreement, chance
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.effects.settling import Settling

#: Chance of any ringing in noise, at the most: neighbouring waves are counted as if they were none.
FALSE_RINGINGS = 5e-3
#: Chance, about, from which on one is looked at exactly.
PROMISING_RINGINGS = 0.05
#: Samples of a dwell, and dwells after a move, at the least.
LEAST_SAMPLES, LEAST_DWELLS = 16, 8
#: Neighbouring frequencies of which the best is looked at, in so many groups.
BANDS = 8
#: Frequencies that are tried, Hz, as far as the samples show them; waves that a time constant must hold.
FREQUENCIES_HZ, LEAST_WAVES = np.arange(2.0, 30.1, 0.25), 0.3
#: Share of the sample rate beyond which a wave is another's alias; longest stretch looked at, s, and its samples a
#: second, to which faster ones are averaged.
MOST_OF_RATE, LONGEST_S, ENOUGH_HZ = 0.45, 1.0, 100.0
#: Share of a wave that what dies away without one must leave.
LEAST_BEYOND = 0.2
#: Time constants tried, s: those of the bank.
TIME_CONSTANTS_S = Settling.forms[0].grid


@dataclass(frozen=True, slots=True)
class Ringing:
    """A wave that dies away after each move: frequency and time constant, about, and by how many nats it is beyond
    chance."""

    frequency_hz: float
    time_constant_s: float
    nats: float


@dataclass(frozen=True, slots=True, eq=False)
class MovedDwells:
    """Dwells that a move came before: samples (v, s, 3) from the first on, the move (v, 3) and the nest (v)."""

    samples: Floats
    move: Floats
    nest: NDArray[np.int32]

    @staticmethod
    def of(table: SampleTable, visit: NDArray[np.intp], samples: int, averaged: int) -> "MovedDwells":
        """Of a table whose samples are in visits (n), rising from 0: so many means of so many samples, of the dwells
        that have them."""
        first = np.flatnonzero(np.diff(visit, prepend=-1))
        length = np.diff(np.append(first, len(visit)))
        mean = np.add.reduceat(table.reading, first) / length[:, None]
        unit, run = table.unit.code[first], table.run[first]
        follows = np.append(False, (unit[1:] == unit[:-1]) & (run[1:] == run[:-1])) & (length >= samples * averaged)
        move = (np.roll(mean, 1, axis=0) - mean)[follows]
        rows = first[follows][:, None] + np.arange(samples * averaged)
        nest = table.labels["nest"].code[first] if "nest" in table.labels else np.zeros(len(first), np.int32)
        # What stands still would hide what moves in the digits of a large number.
        beyond = table.reading[rows] - mean[follows][:, None]
        return MovedDwells(beyond.reshape(len(rows), samples, averaged, 3).mean(axis=2), move, nest[follows])

    def agreement(self, wave: Floats) -> tuple[float, int]:
        """By how many nats the dwells' projections on a wave (s, 2) follow the moves, in all nests alike or in each on
        its own, and of how many terms."""
        projected = np.einsum("sk,vsi->vik", wave, self.samples)
        whole = self._follow(projected, np.ones(len(self.nest), bool)), 3
        nests = [self.nest == n for n in np.unique(self.nest)]
        if len(nests) < 2 or min(np.count_nonzero(n) for n in nests) < LEAST_DWELLS:
            return whole
        each = sum(self._follow(projected, n) for n in nests), 3 * len(nests)
        return min((whole, each), key=lambda found: chance(*found))

    def _follow(self, projected: Floats, of: NDArray[np.bool_]) -> float:
        size = np.maximum(np.sum(self.move[of] ** 2, axis=0), 1e-300)
        common = np.sum(np.einsum("vi,vik->ik", self.move[of], projected[of]) ** 2, axis=1) / size
        share = common / np.maximum(np.sum(projected[of] ** 2, axis=(0, 2)), 1e-300)
        return float(np.sum(agreement(share, float(np.count_nonzero(of)))))


class RingingSearch:
    """Adds up what the moves leave in the dwells of units, some units at a time."""

    def __init__(self, rate_hz: float, samples: int) -> None:
        """rate_hz of the samples, and how many of them a dwell has."""
        self.averaged = max(1, int(rate_hz // ENOUGH_HZ))
        self.samples = min(samples, round(LONGEST_S * rate_hz)) // self.averaged
        self.shapes, self.waves = _waves(self.samples, rate_hz / self.averaged)
        self._left, self._moved = np.zeros((self.samples, 3)), np.zeros(3)

    @staticmethod
    def of(recipe: Recipe, visit: NDArray[np.intp]) -> "RingingSearch | None":
        """For dwells as those of some samples in visits (n); None where they are too short, or no pose is known."""
        search = RingingSearch(recipe.device.rate_hz, int(np.median(np.bincount(visit))))
        return search if len(search.waves) and recipe.pose_known else None

    def add(self, table: SampleTable, visit: NDArray[np.intp]) -> MovedDwells:
        """Whole units of a table whose samples are in visits (n), rising from 0; their dwells."""
        dwells = MovedDwells.of(table, visit, self.samples, self.averaged)
        self._left += np.einsum("vi,vsi->si", dwells.move, dwells.samples)
        self._moved += np.sum(dwells.move**2, axis=0)
        return dwells

    def promising(self, sigma: Floats) -> NDArray[np.intp]:
        """The best wave at each of a few neighbouring frequencies, if noise sigma (3) of a sample hardly shows such."""
        left = self._left / np.maximum(sigma * np.sqrt(self._moved / self.averaged), 1e-300)
        found = 0.5 * np.sum(np.einsum("wsk,si->wki", self.waves, left) ** 2, axis=(1, 2))
        bands = np.array_split(np.arange(len(found)), BANDS)
        best = np.array([band[found[band].argmax()] for band in bands if len(band)], np.intp)
        rare = [chance(float(found[i]), 3.0) * len(found) < PROMISING_RINGINGS for i in best]
        return np.asarray(best[rare])

    def strongest(self, dwells: MovedDwells, sigma: Floats) -> Ringing | None:
        """The ringing on which all dwells agree, if noise hardly agrees on any."""
        found = [(self.shapes[i], *dwells.agreement(self.waves[i])) for i in self.promising(sigma)]
        if not found:
            return None
        shape, nats, terms = min(found, key=lambda one: chance(*one[1:]))
        # All waves were tried, in all nests alike and in each.
        tried = 2 * len(self.waves)
        if chance(nats, terms) * tried >= FALSE_RINGINGS:
            return None
        return Ringing(shape[0], shape[1], nats - float(np.log(tried)))


def find_ringing(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp], sigma: Floats) -> Ringing | None:
    """The ringing that the dwells of a table show, whose samples have the noise sigma (3); None where none is."""
    search = RingingSearch.of(recipe, visit)
    if search is None:
        return None
    dwells = search.add(table, visit)
    return search.strongest(dwells, sigma) if len(dwells.move) >= LEAST_DWELLS else None


@cache
def _waves(samples: int, rate_hz: float) -> tuple[list[tuple[float, float]], Floats]:
    """Frequency and time constant of every wave (w), and its cosine and sine (w, s, 2), orthonormal, without what a
    straight line and what dies away without a wave could be."""
    if samples < LEAST_SAMPLES:
        return [], np.zeros((0, samples, 2))
    t = np.arange(samples) / rate_hz
    still = np.stack([np.ones(samples), t, *(np.exp(-t / tau) for tau in TIME_CONSTANTS_S)], axis=1)
    u, size, _ = np.linalg.svd(still, full_matrices=False)
    plain = u[:, size > 1e-6 * size[0]]
    shapes = [
        (float(f), tau)
        for f in FREQUENCIES_HZ[MOST_OF_RATE * rate_hz > FREQUENCIES_HZ]
        for tau in TIME_CONSTANTS_S
        if f * tau >= LEAST_WAVES
    ]
    if not shapes:
        return [], np.zeros((0, samples, 2))
    f, tau = (np.array(column)[:, None] for column in zip(*shapes, strict=True))
    wave = np.exp(-t / tau) * np.exp(2j * np.pi * f * t)
    both = np.stack([wave.real, wave.imag], axis=2)
    beyond = both - np.einsum("sp,wpk->wsk", plain, np.einsum("sp,wsk->wpk", plain, both))
    kept = np.sum(beyond**2, axis=(1, 2)) > LEAST_BEYOND * np.sum(both**2, axis=(1, 2))
    return [s for s, k in zip(shapes, kept, strict=True) if k], np.linalg.qr(beyond[kept])[0]
