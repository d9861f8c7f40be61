"""The spectrum of all dwells together, each weighted by the motors' drive: for tones far below the noise of a dwell.

A motor that keeps its speed keeps the phase of its tone from dwell to dwell. All samples are then one record with
gaps, whose spectrum is so much finer than a dwell's as the campaign is longer, and the tone's power adds up in one
line of it. Where the campaign is longer than one transform, stretches of it add up in power, and so do the records of
units that come some after others: none is held longer than its units. A record's samples are parted between the two
points of a grid next to them, and its background lies between the frequencies of the dwells' spectrum: what is found
here is only promising, and judged by `phase_agreement.py` at the samples' own times.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.phase_agreement import LEAST_DWELLS, chance
from station.domain.core.types import Floats

#: Points of the record for each sample period: of the fastest tone sin(.4π)²/(.4π)² = .57 is left, of the noise there
#: .63; a tone thus loses a tenth.
POINTS_PER_PERIOD = 1.25
#: Points of one transform at the most.
MAX_POINTS = 1 << 19
#: Lines that one tone may show: the gaps between dwells copy it, and it lies between two of them.
NEAR_LINES = 24
#: Chance, about, of any line in noise from which on it is looked at exactly.
PROMISING_LINES = 1e-2


class DwellRecord:
    """Weighted samples of some units on a grid of times, in stretches of one transform each."""

    def __init__(self, step_s: float, begin_s: float, end_s: float, points: Callable[[int], int]) -> None:
        """step_s of the grid; first and last sample; points: those of a stretch, by how many there are in all."""
        every = int((end_s - begin_s) / step_s) + 1
        self.step_s, self.begin_s, self.points = step_s, begin_s, points(every)
        self._stretches = -(-every // self.points)
        # Stretches are equally long, and so filled with dwells that all of them tell as much.
        self._length = min(self.points, _fast_length(-(-every // self._stretches)))
        # Of each stretch before which points its samples are, by which shares of a step, and their values.
        self._samples: dict[int, list[tuple[NDArray[np.intp], Floats, Floats]]] = {}
        self._weight, self._parted = np.zeros((2, self._stretches))

    def add(self, white: Floats, time_s: Floats, motor: Floats, live: NDArray[np.bool_]) -> None:
        """White samples (v, s, 3) at times (v, s), of which some are live (v, s), in dwells of a drive (v)."""
        weight = np.broadcast_to(motor[:, None], live.shape)[live]
        at = (time_s[live] - self.begin_s) / self.step_s
        place = np.floor(at)
        later, values = at - place, weight * white[live].T
        stretch, here = np.divmod(place.astype(np.intp), self._length)
        self._weight += np.bincount(stretch, weight**2, self._stretches)
        self._parted += np.bincount(stretch, weight**2 * later * (1 - later), self._stretches)
        for i in np.unique(stretch).tolist():
            mine = stretch == i
            self._samples.setdefault(i, []).append((here[mine], later[mine], values[:, mine]))

    @property
    def weight(self) -> Floats:
        """How much each stretch counts that is used."""
        return np.asarray(self._weight[self._weight > 0])

    @property
    def parted(self) -> Floats:
        """Of each of them the mean of w·(1 − w), by weight, of samples of which the share w is at the later point."""
        return np.asarray(self._parted[self._weight > 0] / self.weight)

    def stretches(self) -> Iterator[NDArray[np.float32]]:
        """The samples (3, points) of each stretch that is used, one at a time: all of them are mostly gaps."""
        for i in np.flatnonzero(self._weight > 0).tolist():
            here, later, values = (np.concatenate(parts, axis=-1) for parts in zip(*self._samples[i], strict=True))
            record, places = np.empty((3, self.points), np.float32), np.append(here, here + 1)
            for axis, column in enumerate(values):
                part = column * later
                record[axis] = np.bincount(places, np.append(column - part, part), self.points + 1)[:-1]
            yield record


class MatchedSpectrum:
    """Adds up how far dwells agree in each line, and finds the strongest."""

    def __init__(self, rate_hz: float, lowest_hz: float, *, in_parts: bool) -> None:
        """rate_hz of the samples; lowest_hz below which dwells are filtered; in_parts: whether more than one record is
        to come."""
        self.rate_hz, self.lowest_hz = rate_hz, lowest_hz
        self._points_of = _with_room if in_parts else _without_rest
        self._step_s, self._points, self._stretches = 1 / (POINTS_PER_PERIOD * rate_hz), 0, 0
        self._frequency: Floats = np.zeros(0)
        self._found: Floats = np.zeros(0)
        self._band = slice(0)

    def record(self, begin_s: float, end_s: float) -> DwellRecord:
        """For samples from one time to another; its lines are those of the first one that was made."""
        record = DwellRecord(self._step_s, begin_s, end_s, lambda every: self._points or self._points_of(every))
        if not self._points:
            self._points = record.points
            every = np.arange(self._points // 2 + 1) * self.resolution_hz
            band = np.flatnonzero((every > self.lowest_hz) & (every < 0.5 * self.rate_hz))
            self._band = slice(band[0], band[-1] + 1) if len(band) else slice(0)
            self._frequency = np.asarray(every[self._band], float)
            self._found = np.zeros(len(self._frequency))
        return record

    @property
    def resolution_hz(self) -> float:
        """From one line to the next."""
        return float(1 / (self._points * self._step_s))

    def add(self, record: DwellRecord, noise: Callable[[Floats], Sequence[Floats]], dwells: float) -> None:
        """A record of whole units. noise: of three axes the mean power (n) of a dwell of theirs around frequencies (n);
        dwells: how many count, by their weight."""
        if not len(self._frequency):
            return
        total, usual = float(record.weight.sum()), [1 / np.maximum(axis, 1e-300) for axis in noise(self._frequency)]
        turned = 2 * (1 - np.cos(2 * np.pi * self._step_s * self._frequency))
        stretches = zip(record.stretches(), record.weight.tolist(), record.parted.tolist(), strict=True)
        for samples, weight, parted in stretches:
            counted = dwells * weight / total
            if counted < LEAST_DWELLS:
                continue
            explained, beyond = weight * (counted - 1) * (1 - parted * turned), np.ones(len(turned))
            for axis, noisy in zip(samples, usual, strict=True):
                line = scipy.fft.rfft(axis)[self._band]
                # Beside the noise around it: what is in the line itself is too little known.
                beyond *= 1 + (line.real**2 + line.imag**2) * noisy / explained
            # `agreement` of R² = p/(p + 1 − 1/N), p being the power beside the noise, of three axes at once.
            self._found += (counted - 1) * np.log(beyond)
            self._stretches += 1

    def lines(self) -> tuple[Floats, float, float] | None:
        """Frequencies, Hz, of the strongest lines, among which a tone may be; by how many nats the dwells agree at the
        first, and how many lines there are; None where chance would show such a line."""
        if not self._stretches:
            return None
        best, tried = float(self._found.max()), float(len(self._found))
        if chance(best, 3.0 * self._stretches) * tried > PROMISING_LINES:
            return None
        return np.asarray(self._frequency[np.argsort(self._found)[-NEAR_LINES:]], float), best, tried


def _without_rest(every: int) -> int:
    """Points of a stretch where so many are cut into equal ones."""
    return _fast_length(-(-every // -(-every // MAX_POINTS)))


def _with_room(every: int) -> int:
    """The same where records to come may be longer than this one."""
    return min(_fast_length(2 * every), MAX_POINTS)


def _fast_length(points: int) -> int:
    """The next number of points that transforms are fast of."""
    return int(scipy.fft.next_fast_len(points, real=True))
