"""Whether any line of the dwells' spectrum stands out in proportion to the drive: units add up, some at a time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.matched_spectrum import MatchedSpectrum
from station.diagnosis.data.faults.spectral_lines import OVERSAMPLING, PowerSpectrum, background, line_gains
from station.diagnosis.data.faults.white_dwells import WhiteDwells, white_dwells
from station.domain.core.types import Floats, SampleTable

#: Nats of log-likelihood that a line must gain beyond the number of frequencies tried.
MIN_GAIN_NATS = 12.0
#: Samples of a table, and of its longest visit, at the least.
LEAST_SAMPLES, LEAST_DWELL = 64, 16
#: Terms of a late sample's wave at most, and the size below which one is none: single precision has no more digits.
MAX_TERMS, LEAST_TERM = 6, 1e-7
#: Samples whose spectrum is taken at once.
SAMPLES_AT_ONCE = 50_000


@dataclass(frozen=True, slots=True)
class ToneExtent:
    """What must be known of all samples before any spectrum is taken: how many they are, and those of the longest
    visit; the first and the last one on the campaign's clock, s; least and greatest drive."""

    samples: int
    longest: int
    begin_s: float
    end_s: float
    least_drive: float
    greatest_drive: float

    @staticmethod
    def of(table: SampleTable, visit: NDArray[np.intp]) -> "ToneExtent | None":
        """Of a table with samples in visits (n); None where drive or clock were not recorded."""
        if not {"motor", "started_s"} <= set(table.values) or not len(table):
            return None
        t, motor = table.time_s + table.values["started_s"], table.values["motor"]
        drive = float(motor.min()), float(motor.max())
        return ToneExtent(len(table), int(np.bincount(visit).max()), float(t.min()), float(t.max()), *drive)

    @staticmethod
    def of_all(parts: "Sequence[ToneExtent]") -> "ToneExtent":
        """Of all parts of a table, at least one."""
        return ToneExtent(
            sum(p.samples for p in parts),
            max(p.longest for p in parts),
            min(p.begin_s for p in parts),
            max(p.end_s for p in parts),
            min(p.least_drive for p in parts),
            max(p.greatest_drive for p in parts),
        )

    @property
    def is_driven(self) -> bool:
        """Whether the drive was ever another one."""
        return self.greatest_drive > self.least_drive

    @property
    def shows_tones(self) -> bool:
        """Whether a tone could be told from these samples."""
        return self.is_driven and self.samples >= LEAST_SAMPLES and self.longest >= LEAST_DWELL


@dataclass(frozen=True, slots=True, eq=False)
class ToneLine:
    """A line that stands out, by so many nats, of so many tried: at one frequency, Hz, or near one of several,
    resolution_hz apart, if the phases hold from visit to visit."""

    frequency_hz: Floats
    nats: float
    tried: float
    resolution_hz: float | None


@dataclass(frozen=True, slots=True, eq=False)
class _PowerSums:
    """Power (f, 3) of visits times their weight, the sum of their weights and that of the squares of these."""

    power: Floats
    weight: float
    squares: float

    @staticmethod
    def none(frequencies: int) -> "_PowerSums":
        """Of no visit."""
        return _PowerSums(np.zeros((frequencies, 3)), 0.0, 0.0)

    def __add__(self, more: "_PowerSums") -> "_PowerSums":
        return _PowerSums(self.power + more.power, self.weight + more.weight, self.squares + more.squares)

    @property
    def mean(self) -> Floats:
        """Mean power (f, 3) of a visit."""
        return np.asarray(self.power / max(self.weight, 1e-300))

    @property
    def visits(self) -> float:
        """How many count, by their weight."""
        return self.weight**2 / max(self.squares, 1e-300)


class ToneSearch:
    """Adds up the spectra of units, and finds the strongest line."""

    def __init__(self, rate_hz: float, longest: int, *, in_parts: bool = False) -> None:
        """rate_hz of the samples, and how many of them the longest visit of the first units has; in_parts: whether more
        units are to come after them."""
        self.rate_hz, self._longest = rate_hz, longest
        self.tried = np.arange(3, OVERSAMPLING * longest // 2) * rate_hz / (OVERSAMPLING * longest)
        self._matched = MatchedSpectrum(rate_hz, float(self.tried[0]), in_parts=in_parts)
        self._sums = _PowerSums.none(len(self.tried))

    def covers(self, extent: ToneExtent) -> bool:
        """Whether the frequencies tried lie close enough together for the visits of more units."""
        return extent.longest <= OVERSAMPLING * self._longest

    def add(self, table: SampleTable, visit: NDArray[np.intp], extent: ToneExtent) -> None:
        """Whole units of a table whose samples are in visits (n), rising from 0, and what they are."""
        record, own = self._matched.record(extent.begin_s, extent.end_s), _PowerSums.none(len(self.tried))
        starts = np.flatnonzero(np.diff(table.unit.code, prepend=-1))
        part = np.append(starts[np.diff(starts // SAMPLES_AT_ONCE, prepend=-1) > 0], len(visit))
        for first, last in pairwise(part):
            d, _ = white_dwells(table[first:last], visit[first:last] - visit[first], self.rate_hz)
            own += _PowerSums(power(d, self.tried), float(np.sum(d.weight)), float(np.sum(d.weight**2)))
            record.add(d.white, d.time_s, d.motor, d.live)
        self._sums += own
        # Of all so far: what one portion shows scatters by itself.
        # Without its slow course a dwell has less power at its lowest frequencies than around them.
        around = np.minimum(background(self._sums.mean), self._sums.mean)
        self._matched.add(record, lambda frequency_hz: _between(self.tried, around, frequency_hz), own.visits)

    def lines(self) -> tuple[ToneLine, ...]:
        """Lines that stand out, by their power alone and by their phase; the one that stands out more is first."""
        tried, gains = float(len(self.tried)), line_gains(PowerSpectrum(self._sums.mean, self._sums.visits))
        best = int(gains.argmax())
        matched = self._matched.lines()
        by_phase = () if matched is None else (ToneLine(*matched, self._matched.resolution_hz),)
        if gains[best] < MIN_GAIN_NATS + np.log(tried):
            return by_phase
        by_power = (ToneLine(self.tried[best : best + 1], float(gains[best]), tried, None),)
        clearer = matched is None or gains[best] > matched[1] - np.log(matched[2])
        return by_power + by_phase if clearer else by_phase + by_power


def _between(tried_hz: Floats, power: Floats, frequency_hz: Floats) -> list[Floats]:
    """Powers (f, 3) of some frequencies at others (n), of each axis."""
    return [np.interp(frequency_hz, tried_hz, column) for column in power.T]


def power(d: WhiteDwells, tried: Floats) -> Floats:
    """Sum over the visits of their power (f, 3) at frequencies in equal steps, times their weight."""
    weight = d.weight / np.maximum(d.count, 1)
    even = _even_power(d, tried, weight)
    return _uneven_power(d, tried, weight) if even is None else even


def _even_power(d: WhiteDwells, tried: Floats, weight: Floats) -> Floats | None:
    """The same where each visit's samples came one after the other at the rate, by fast transforms; None of others.

    Of a sample that is late by δ the wave is the even one's times Σ (2πi·f·δ)ᵏ/k!: one transform for each term.
    """
    periods = (d.time_s - d.middle_s[:, None]) * d.rate_hz
    late = np.where(d.live, periods - np.arange(periods.shape[1]), 0.0)
    turn = 2 * np.pi * tried[-1] / d.rate_hz * float(np.abs(late).max(initial=0.0))
    terms = next((k for k in range(1, MAX_TERMS + 1) if turn**k / math.factorial(k) < LEAST_TERM), None)
    points = round(d.rate_hz / (tried[1] - tried[0])) if len(tried) > 1 else 0
    if terms is None or points < periods.shape[1]:
        return None
    first, moment = round(tried[0] * points / d.rate_hz), np.ascontiguousarray(d.white.swapaxes(1, 2), np.float32)
    wave = 0.0
    for k in range(terms):
        found = scipy.fft.rfft(moment, points)[..., first : first + len(tried)]
        # The transform turns the other way.
        factor = (-2j * np.pi * tried / d.rate_hz) ** k / math.factorial(k)
        wave = found * factor.astype(np.complex64) + wave
        moment = moment * late.astype(np.float32)[:, None]
    return np.asarray(np.einsum("v,vaf->fa", weight, wave.real**2 + wave.imag**2))


def _uneven_power(d: WhiteDwells, tried: Floats, weight: Floats) -> Floats:
    """The same of samples at any times. Each wave is the one before, turned on by the step: sines are dearer than
    products."""
    late = 2 * np.pi * (d.time_s - d.middle_s[:, None])
    step = late * (tried[1] - tried[0] if len(tried) > 1 else 0.0)
    c, s, cos, sin = (f(x).astype(np.float32) for x in (late * tried[0], step) for f in (np.cos, np.sin))
    white = d.white.astype(np.float32)
    power = np.zeros((len(tried), 3))
    for i in range(len(tried)):
        both = np.stack([c, s], axis=1) @ white
        power[i] = np.sum(weight[:, None] * np.sum(both.astype(float) ** 2, axis=1), axis=0)
        c, s = c * cos - s * sin, s * cos + c * sin
    return power
