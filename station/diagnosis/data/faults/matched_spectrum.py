"""The spectrum of all dwells together, each weighted by the motors' drive: for tones far below the noise of a dwell.

A motor that keeps its speed keeps the phase of its tone from dwell to dwell. All samples are then one record with
gaps, whose spectrum is so much finer than a dwell's as the campaign is longer, and the tone's power adds up in one
line of it. Where the campaign is longer than one transform, stretches of it add up in power.
"""

from collections.abc import Iterator

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: Points of the record for each sample period: what a stamp is rounded by turns the fastest tone by ±.63 rad.
POINTS_PER_PERIOD = 2.5
#: Points of one transform at the most.
MAX_POINTS = 1 << 20
#: Lines whose median is the background of each of them.
BACKGROUND_LINES = 512
#: Lines that one tone may show: the gaps between dwells copy it, and it lies between two of them.
NEAR_LINES = 24
#: Chance of any line in noise.
FALSE_LINES = 1e-3


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

    def lines(self) -> tuple[Floats, float] | None:
        """Frequencies, Hz, of the strongest lines, among which a tone is, and by how many nats it is beyond chance;
        None where none is."""
        used = self._weight > 0
        if not used.any():
            return None
        power = np.zeros(self.points // 2 + 1)
        for record, weight in zip(self._records(used), self._weight[used], strict=True):
            power += np.sum(np.abs(scipy.fft.rfft(record)) ** 2, axis=0) / weight
        frequency = np.arange(len(power)) * self.resolution_hz
        band = (frequency > self.lowest_hz) & (frequency < 0.5 * self.rate_hz)
        if np.count_nonzero(band) < BACKGROUND_LINES:
            return None
        found, shape = power[band], 3.0 * np.count_nonzero(used)
        usual = float(scipy.special.gammaincinv(shape, 0.5))
        background = _block_medians(found, len(found) // BACKGROUND_LINES)
        level = found / np.maximum(background, 1e-300) * usual
        best = int(level.argmax())
        tried = float(np.count_nonzero(band))
        chance = float(scipy.special.gammaincc(shape, level[best])) * tried
        if chance > FALSE_LINES:
            return None
        strongest = np.asarray(frequency[band][np.argsort(level)[-NEAR_LINES:]], float)
        return strongest, float(level[best] - usual - np.log(tried))

    def _records(self, used: NDArray[np.bool_]) -> Iterator[NDArray[np.float32]]:
        """The samples (3, points) of each stretch that is used, one at a time: all of them are mostly gaps."""
        for i in np.flatnonzero(used).tolist():
            here, values = (np.concatenate(parts) for parts in zip(*self._samples[i], strict=True))
            yield np.stack([np.bincount(here, column, self.points) for column in values.T]).astype(np.float32)


def _block_medians(values: Floats, blocks: int) -> Floats:
    """The median (n) of the block of each of some values (n), in so many blocks; the first are longer by one."""
    size, longer = divmod(len(values), blocks)
    cut = longer * (size + 1)
    parts = values[:cut].reshape(longer, size + 1), values[cut:].reshape(blocks - longer, size)
    return np.concatenate([np.repeat(np.median(part, axis=1), part.shape[1]) for part in parts])
