"""What rounding leaves of a dwell's mean where the noise is too small to average it out.

A mean of readings in steps of q whose noise is σ errs by a wave of where it lies between two steps, of root mean square
e with e² = Σ (q/πk)²/2 · exp(−(2πkσ/q)²), k = 1, 2, … (Widrow, Kollár, Quantization Noise, 2008, section 4). No sample
of the dwell shows it, and dwells that lie alike between two steps all err alike: a square of what the faces feel is
what rounding makes of offset and gain. So noise is laid into the samples, as much as if each of the dwells that lie
alike erred by itself and their mean by what it does. That mean, which errs already, it leaves as it is.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import rows_of_units
from station.domain.core.types import Floats, SampleTable

#: Waves of the error that are summed, and steps beside the noise below which nothing of it is left.
WAVES, COARSE = 8, 1.5
#: Noises beside a step at which what shows within the dwells is computed; of more nothing is hidden.
RATIOS = np.linspace(0.0, 1.0, 201)
#: Steps beside the noise from which on rounding hides what the other units show.
HOPELESS = 5.0
#: Dwells lie alike where their means are no further apart than this share of a step.
ALIKE = 0.1


def error_of_means(step: Floats, noise: Floats) -> Floats:
    """By how much means err (…) of readings in steps (…) of a noise (…)."""
    k = np.arange(1, WAVES + 1)
    ratio = (noise / np.maximum(step, 1e-300))[..., None]
    return np.asarray(step * np.sqrt(np.sum(np.exp(-((2 * np.pi * k * ratio) ** 2)) / (np.pi * k) ** 2 / 2, axis=-1)))


def with_honest_rounding(table: SampleTable, visit: NDArray[np.intp], step: Floats, sheet: float) -> SampleTable:
    """A table, samples in visits (n), of units with readings in steps (U), without those that rounding hides beside
    others. sheet: noise of a sample by the data sheet; where steps hide it, no more is believed."""
    if sheet <= 0 or not np.any(step > COARSE * sheet):
        return table
    reading, rng, tell = table.reading.copy(), np.random.default_rng(0), np.ones(len(table), bool)
    coarse = [
        _Dwells.of(reading, visit, rows, float(step[u]))
        for u, rows in enumerate(rows_of_units(table.unit))
        if step[u] > COARSE * sheet and rows.stop > rows.start
    ]
    # Where most dwells lie within one step, few of one unit show any noise: all of them together do.
    shown = np.mean([unit.variance / unit.step**2 for unit in coarse]) if coarse else 0.0
    for unit in coarse:
        noise = noise_below_steps(unit.variance, unit.step)
        most = min(sheet, float(noise_below_steps(np.asarray(shown), 1.0)) * unit.step)
        noise = np.where(noise > unit.step / 2, noise, np.minimum(noise, most))
        tell[unit.rows] = unit.step <= HOPELESS * noise.max()
        error = error_of_means(np.full(3, unit.step), noise)
        for axis in range(3):
            alike = _alike(unit.mean[:, axis], unit.step)
            size = error[axis] * np.sqrt(unit.samples * np.bincount(alike)[alike])
            reading[unit.rows, axis] += size[unit.where] * _laid(alike, unit.samples, unit.where, rng)
    table = replace(table, reading=reading)
    return table if tell.all() or not tell.any() else table[tell].used()


class _Dwells(NamedTuple):
    """Those of a unit: its rows, step, visit of each row (n), means (v, 3), numbers of samples (v) and the variance
    (3) within them."""

    rows: slice
    step: float
    where: NDArray[np.intp]
    mean: Floats
    samples: NDArray[np.intp]
    variance: Floats

    @staticmethod
    def of(reading: Floats, visit: NDArray[np.intp], rows: slice, step: float) -> "_Dwells":
        where = visit[rows] - visit[rows.start]
        mean, count = _means(reading[rows], where), np.bincount(where)
        within = np.sum((reading[rows] - mean[where]) ** 2, axis=0) / max(len(where) - len(count), 1)
        return _Dwells(rows, step, where, mean, count, np.asarray(within))


def noise_below_steps(variance: Floats, step: float) -> Floats:
    """The noise (…) that shows as a variance (…) within the dwells, once rounded: what rounding adds, q²/12, without
    what all samples of a dwell have of it alike."""
    shown = RATIOS**2 + 1 / 12 - error_of_means(np.ones_like(RATIOS), RATIOS) ** 2
    share = np.asarray(variance) / step**2
    beyond = np.sqrt(np.maximum(share - 1 / 12, 0.0))
    return step * np.where(share < shown[-1], np.interp(share, shown, RATIOS), beyond)


def _alike(mean: Floats, step: float) -> NDArray[np.intp]:
    """Of each dwell of these means (v), which group of dwells that lie alike it belongs to."""
    order, group = np.argsort(mean), np.empty(len(mean), np.intp)
    group[order] = np.cumsum(np.diff(mean[order], prepend=mean[order[0]]) > ALIKE * step)
    return group


def _laid(
    alike: NDArray[np.intp], count: NDArray[np.intp], where: NDArray[np.intp], rng: np.random.Generator
) -> Floats:
    """Noise of unit variance for the samples (n) of dwells, so many each (v), whose means scatter as its means do, but
    evenly, since one far out would be taken for a cause, and not at all over all that are alike (v)."""
    noise = rng.standard_normal(len(where))
    noise = noise - (np.bincount(where, noise) / count)[where]
    noise = noise / np.sqrt(np.maximum(np.bincount(where, noise**2) / count, 1e-300))[where]
    order, size = np.lexsort((rng.random(len(alike)), alike)), np.bincount(alike)
    place = np.empty(len(alike))
    place[order] = np.arange(len(alike)) - (np.cumsum(size) - size)[alike[order]]
    score = scipy.special.ndtri((place + 0.5) / size[alike])
    rms = np.sqrt(np.bincount(alike, score**2) / np.maximum(size - 1, 1))
    return np.asarray(noise + (score / np.where(rms > 0, rms, 1.0)[alike] / np.sqrt(count))[where])


def _means(values: Floats, where: NDArray[np.intp]) -> Floats:
    return np.stack([np.bincount(where, column) for column in values.T], axis=1) / np.bincount(where)[:, None]
