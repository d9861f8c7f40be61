"""The frequencies near a line at which the phases of all dwells agree.

Dwells that follow each other in equal steps copy a tone's line at every multiple of 1/step: whole waves more or fewer
from dwell to dwell. Only its course within the dwells tells the copies apart. All samples are therefore turned back by
the line's frequency and laid on one grid of times, whose transform holds the courses within the dwells and between
them; the strongest peaks are then judged at the samples' own times.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.white_dwells import WhiteDwells
from station.domain.core.types import Array, Floats

#: Cells of the grid in a dwell: half a cell off, the outermost copies lose a hundredth.
CELLS = 16
#: Values of the transform for each 1/record: between two of them a peak loses a twentieth.
FINER = 4
#: Cells of the longest grid: of a longer record they are larger.
MOST_CELLS = 1 << 21
#: Peaks this share of the best one's nats below it, and this many nats, may be the best once filtered.
NEAR_SHARE, NEAR_NATS = 0.2, 8.0
#: Least and most peaks that are filtered, and samples in all.
PEAKS, JUDGED = (4, 32), 1_000_000
#: Share of the peaks, by weight, that an interval holds.
COVERED = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class PhasePeaks:
    """Frequencies (n), Hz, the best first, and by how many nats (n) white samples are likelier with a tone there."""

    frequency_hz: Floats
    nats: Floats

    @property
    def best_hz(self) -> float:
        """The frequency at which the phases agree best."""
        return float(self.frequency_hz[0])

    def reach_hz(self, noise2: float) -> float:
        """How far from the best peak 95 % of the peaks are, each weighted by how likely the tone is there; noise2:
        variance of the noise beside that of white samples."""
        weight = np.exp((self.nats - self.nats[0]) / max(noise2, 1e-300))
        off = np.abs(self.frequency_hz - self.best_hz)
        order = np.argsort(off)
        held = np.cumsum(weight[order]) / np.sum(weight)
        return float(off[order][int(np.searchsorted(held, COVERED))])


def phase_peaks(d: WhiteDwells, frequency_hz: float) -> PhasePeaks:
    """The peaks within a dwell's resolution of a line."""
    samples, reach = _Weighted.of(d), d.rate_hz / d.white.shape[1]
    length = d.white.shape[1] / d.rate_hz
    span = float(samples.time_s.max()) + length
    step = max(length / CELLS, span / MOST_CELLS)
    place = np.rint(samples.time_s / step).astype(np.intp)
    points = int(scipy.fft.next_fast_len(FINER * int(place.max() + 1)))
    offset = scipy.fft.fftfreq(points, step)
    band = np.flatnonzero(np.abs(offset) <= reach)
    band = band[np.argsort(offset[band])]
    turned = np.exp(-2j * np.pi * frequency_hz * samples.time_s)[:, None] * samples.values
    sums = [scipy.fft.fft(_on_grid(column, place), points)[band] for column in turned.T]
    nats = _agreement(np.stack(sums, axis=-1)) / (2 * samples.weight)
    found = frequency_hz + offset[band][_peaks(nats, int(np.clip(JUDGED // len(samples.time_s), *PEAKS)))]
    # A line between two values of the transform, and in the middle of a cell, at its own height.
    fine = found[:, None] + np.linspace(-0.5, 0.5, 5) / (points * step)
    best = np.array([max(row, key=samples.nats) for row in fine.tolist()])
    exact = np.array([_filtered_nats(d, f) for f in best.tolist()])
    order = np.argsort(-exact)
    return PhasePeaks(best[order], exact[order])


def waves_of(d: WhiteDwells, frequency_hz: float) -> Floats:
    """Sine and cosine (2, v, s, 3) of a tone at amplitude 1 as the filtered samples hold them."""
    angle = 2 * np.pi * frequency_hz * d.time_s
    return np.stack([d.filtered(np.sin(angle)), d.filtered(np.cos(angle))])


def _filtered_nats(d: WhiteDwells, frequency_hz: float) -> float:
    """By how much likelier the samples are with the best tone of one phase, of which the filter took its part."""
    waves = waves_of(d, frequency_hz)
    along = np.einsum("kvsi,vsi->ki", waves, d.white)
    along /= np.sqrt(np.maximum(np.sum(waves**2, axis=(0, 1, 2)) / 2, 1e-300))
    return 0.5 * float(np.linalg.eigvalsh(along @ along.T)[-1])


@dataclass(frozen=True, slots=True, eq=False)
class _Weighted:
    """Samples (n, 3) times their drive, at times (n) since the first one; weight: the sum of the drives' squares."""

    time_s: Floats
    values: Floats
    weight: float

    @staticmethod
    def of(d: WhiteDwells) -> "_Weighted":
        live = d.live
        drive = np.broadcast_to(d.motor[:, None], live.shape)[live]
        t = d.time_s[live]
        return _Weighted(t - t.min(), drive[:, None] * d.white[live], max(float(np.sum(drive**2)), 1e-300))

    def nats(self, frequency_hz: float) -> float:
        """By how much likelier the samples are with the best tone of one phase at a frequency."""
        total = np.exp(-2j * np.pi * frequency_hz * self.time_s) @ self.values
        return float(_agreement(total)) / (2 * self.weight)


def _on_grid(values: Array, place: NDArray[np.intp]) -> Array:
    return np.asarray(np.bincount(place, values.real) + 1j * np.bincount(place, values.imag))


def _agreement(total: Array) -> Floats:
    """Twice the largest sum of squares that sums (…, 3) of the axes have along one phase."""
    return np.asarray(np.abs(np.sum(total**2, axis=-1)) + np.sum(np.abs(total) ** 2, axis=-1))


def _peaks(nats: Floats, most: int) -> NDArray[np.intp]:
    """Where the strongest peaks are, so many at most, among values (n) in the order of their frequencies."""
    inside = np.pad(nats, 1, constant_values=-np.inf)
    top = np.flatnonzero((nats >= inside[:-2]) & (nats > inside[2:]))
    near = top[nats[top] > (1 - NEAR_SHARE) * nats.max() - NEAR_NATS]
    return np.asarray(near[np.argsort(-nats[near])][:most])
