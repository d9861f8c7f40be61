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
#: Two ringings are at least so far apart, Hz, and by this share of the other's inverse time constant: nearer ones are
#: one wave whose form is another. Rounds in which the one is looked for beside the other.
LEAST_APART_HZ, WIDTH, ROUNDS = 3.0, 0.3, 4
#: Waves beside which a second one is looked for first: multiples of so many Hz, with these time constants.
START_HZ, START_CONSTANTS_S = 2.0, (0.06, 0.12)
#: Neighbours of a wave, Hz and doublings of the time constant, and the share of a direction that is their own.
NEXT_HZ, NEXT_CONSTANT, LEAST_OWN = 0.5, 1.2, 0.01
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
        self._beside: dict[int, tuple[Floats, NDArray[np.intp]]] = {}
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

    def promising(self, sigma: Floats, beside: int | None = None) -> NDArray[np.intp]:
        """The best wave at each of a few neighbouring frequencies, if noise sigma (3) of a sample hardly shows such;
        beside: the place of a wave, of which they are to be none."""
        waves, places = self._waves_beside(beside)
        found = self._explained(waves, sigma)
        bands = np.array_split(np.arange(len(found)), BANDS)
        best = [band[found[band].argmax()] for band in bands if len(band)]
        rare = [i for i in best if chance(float(found[i]), 3.0) * len(found) < PROMISING_RINGINGS]
        return places[rare] if rare else np.zeros(0, np.intp)

    def strongest(self, dwells: MovedDwells, sigma: Floats) -> tuple[Ringing, ...]:
        """The ringing on which all dwells agree, if noise hardly agrees on any; two of them, the clearer first, if each
        is beside the other."""
        alone = self._strongest(dwells, sigma, None)
        if alone is None:
            return ()
        # The best wave for two lies between them, and each is found beside the other only near it.
        one: _Wave | None = None
        two = self._strongest(dwells, sigma, self._start(sigma))
        for _ in range(ROUNDS):
            before, one = one, None if two is None else self._strongest(dwells, sigma, two.place)
            two = None if one is None else self._strongest(dwells, sigma, one.place)
            if one is None or two is None:
                return (alone.ringing,)
            if before is not None and before.place == one.place:
                break
        found = [wave.ringing for wave in (one, two) if wave is not None]
        return tuple(sorted(found, key=lambda ringing: -ringing.nats))

    def _start(self, sigma: Floats) -> int:
        """The place, of some, of the wave that explains the most together with the best one beside it."""
        alone = self._explained(self.waves, sigma)
        some = [i for i, (f, tau) in enumerate(self.shapes) if f % START_HZ == 0 and tau in START_CONSTANTS_S]

        def together(place: int) -> float:
            beside = self._explained(self._waves_beside(place)[0], sigma)
            return float(alone[place] + beside.max(initial=0.0))

        return max(some, key=together, default=int(alone.argmax()))

    def _explained(self, waves: Floats, sigma: Floats) -> Floats:
        """Half the squares (w), in noises, of what the moves leave that waves (w, s, 2) explain."""
        noise = sigma * np.sqrt(self._moved / self.averaged)
        # An axis that always reads the same, or never moves, tells nothing.
        left = np.where(noise > 0, self._left / np.where(noise > 0, noise, 1.0), 0.0)
        return np.asarray(0.5 * np.sum(np.einsum("wsk,si->wki", waves, left) ** 2, axis=(1, 2)))

    def _strongest(self, dwells: MovedDwells, sigma: Floats, beside: int | None) -> "_Wave | None":
        waves, places = self._waves_beside(beside)
        promising = self.promising(sigma, beside)
        if not len(promising):
            return None
        found = [(int(i), *dwells.agreement(waves[np.searchsorted(places, i)])) for i in promising]
        place, nats, terms = min(found, key=lambda one: chance(*one[1:]))
        # All waves were tried, in all nests alike and in each.
        tried = 2 * len(self.waves)
        if chance(nats, terms) * tried >= FALSE_RINGINGS:
            return None
        return _Wave(place, Ringing(*self.shapes[place], nats - float(np.log(tried))))

    def _waves_beside(self, one: int | None) -> tuple[Floats, NDArray[np.intp]]:
        """The waves (w, s, 2) without what the one at a place could be, and the places of those that ring at a
        frequency of their own."""
        if one is None:
            return self.waves, np.arange(len(self.waves))
        if one not in self._beside:
            self._beside[one] = self._apart_from(one)
        return self._beside[one]

    def _apart_from(self, one: int) -> tuple[Floats, NDArray[np.intp]]:
        hz, constant_s = self.shapes[one]
        frequency, tau = np.array(self.shapes).T
        off = np.abs(frequency - hz)
        apart = np.flatnonzero(off > np.maximum(LEAST_APART_HZ, WIDTH / tau))
        # Its form is known as well as the waves tried stand apart, and is anything between its neighbours.
        alike = np.abs(np.log2(tau / constant_s)) < NEXT_CONSTANT
        near = np.concatenate(self.waves[alike & (off <= NEXT_HZ)], axis=1)
        u, size, _ = np.linalg.svd(near, full_matrices=False)
        known, others = u[:, size > LEAST_OWN * size[0]], self.waves[apart]
        left = others - np.einsum("sp,wpk->wsk", known, np.einsum("sp,wsk->wpk", known, others))
        kept = np.sum(left**2, axis=(1, 2)) > LEAST_BEYOND * 2
        return np.linalg.qr(left[kept])[0], apart[kept]


@dataclass(frozen=True, slots=True)
class _Wave:
    """The place of a wave among those tried, and its ringing."""

    place: int
    ringing: Ringing


def find_ringings(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp], sigma: Floats) -> tuple[Ringing, ...]:
    """The ringings that the dwells of a table show, whose samples have the noise sigma (3): none, one or two."""
    search = RingingSearch.of(recipe, visit)
    if search is None:
        return ()
    dwells = search.add(table, visit)
    return search.strongest(dwells, sigma) if len(dwells.move) >= LEAST_DWELLS else ()


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
