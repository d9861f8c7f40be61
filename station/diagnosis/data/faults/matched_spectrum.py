"""The spectrum of all dwells together, each weighted by the motors' drive: for tones far below the noise of a dwell.

A motor that keeps its speed keeps the phase of its tone from dwell to dwell. All samples are then one record with
gaps, whose spectrum is so much finer than a dwell's as the campaign is longer, and the tone's power adds up in one
line of it. Where the campaign is longer than one transform, stretches of it add up in power. The record's samples are
placed on a grid, and its background lies between the frequencies of the dwells' spectrum: what is found here is only
promising, and judged by `phase_agreement.py` at the samples' own times.
"""

from collections.abc import Callable, Iterator

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.phase_agreement import LEAST_DWELLS, agreement, chance
from station.domain.core.types import Floats

#: Points of the record for each sample period: what a stamp is rounded by turns the fastest tone by ±.63 rad.
POINTS_PER_PERIOD = 2.5
#: Points of one transform at the most.
MAX_POINTS = 1 << 20
#: Lines that one tone may show: the gaps between dwells copy it, and it lies between two of them.
NEAR_LINES = 24
#: Chance, about, of any line in noise from which on it is looked at exactly.
PROMISING_LINES = 1e-3


class MatchedSpectrum:
    """Adds up weighted samples, and finds the strongest line."""

    def __init__(self, rate_hz: float, lowest_hz: float, origin_s: float, end_s: float) -> None:
        """rate_hz of the samples; lowest_hz below which dwells are filtered; first and last sample of the campaign."""
        self.rate_hz, self.lowest_hz, self.origin_s = rate_hz, lowest_hz, origin_s
        self.step_s = 1 / (POINTS_PER_PERIOD * rate_hz)
        points = int((end_s - origin_s) / self.step_s) + 1
        self.stretches = -(-points // MAX_POINTS)
        self.points = scipy.fft.next_fast_len(-(-points // self.stretches), real=True)
        # Of each stretch where its samples are, and their values.
        self._samples: dict[int, list[tuple[NDArray[np.int32], NDArray[np.float32]]]] = {}
        self._weight = np.zeros(self.stretches)

    def add(self, white: Floats, time_s: Floats, motor: Floats, live: NDArray[np.bool_]) -> None:
        """White samples (v, s, 3) at times (v, s), of which some are live (v, s), in dwells of a drive (v)."""
        weight = np.broadcast_to(motor[:, None], live.shape)[live]
        place = np.round((time_s[live] - self.origin_s) / self.step_s).astype(np.int64)
        place = np.clip(place, 0, self.stretches * self.points - 1)
        values = (weight[:, None] * white[live]).astype(np.float32)
        stretch, here = np.divmod(place, self.points)
        self._weight += np.bincount(stretch, weight**2, self.stretches)
        for i in np.unique(stretch).tolist():
            mine = stretch == i
            self._samples.setdefault(i, []).append((here[mine].astype(np.int32), values[mine]))

    @property
    def resolution_hz(self) -> float:
        """From one line to the next."""
        return float(1 / (self.points * self.step_s))

    def lines(self, noise: Callable[[Floats], Floats], dwells: float) -> tuple[Floats, float, float] | None:
        """Frequencies, Hz, of the strongest lines, among which a tone may be; by how many nats the dwells agree at the
        first, and how many lines there are; None where chance would show such a line. noise: mean power (n, 3) of a
        dwell at frequencies (n), a tone's own included; dwells: how many count, by their weight."""
        used = self._weight > 0
        frequency = np.arange(self.points // 2 + 1) * self.resolution_hz
        band = (frequency > self.lowest_hz) & (frequency < 0.5 * self.rate_hz)
        if not used.any() or not band.any():
            return None
        usual, found = np.maximum(noise(frequency[band]).T, 1e-300), np.zeros(np.count_nonzero(band))
        for record, weight in zip(self._records(used), self._weight[used], strict=True):
            share = np.abs(scipy.fft.rfft(record)[:, band]) ** 2 / (weight * usual)
            counted = max(dwells * weight / self._weight.sum(), LEAST_DWELLS)
            found += np.sum(agreement(share / counted, counted), axis=0)
        best, tried = float(found.max()), float(len(found))
        if chance(best, 3.0 * np.count_nonzero(used)) * tried > PROMISING_LINES:
            return None
        return np.asarray(frequency[band][np.argsort(found)[-NEAR_LINES:]], float), best, tried

    def _records(self, used: NDArray[np.bool_]) -> Iterator[NDArray[np.float32]]:
        """The samples (3, points) of each stretch that is used, one at a time: all of them are mostly gaps."""
        for i in np.flatnonzero(used).tolist():
            here, values = (np.concatenate(parts) for parts in zip(*self._samples[i], strict=True))
            yield np.stack([np.bincount(here, column, self.points) for column in values.T]).astype(np.float32)
