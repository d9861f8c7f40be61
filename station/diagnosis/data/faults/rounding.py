"""What rounding leaves of a dwell's mean where the noise is too small to average it out.

A mean of readings in steps of q whose noise is σ errs by a wave of where it lies between two steps, of root mean square
e with e² = Σ (q/πk)²/2 · exp(−(2πkσ/q)²), k = 1, 2, … (Widrow, Kollár, Quantization Noise, 2008, section 4). No sample
of the dwell shows it, and dwells that lie alike between two steps all err alike: a square of what the faces feel is
what rounding makes of offset and gain. So noise is laid into the samples, of which the mean of all dwells that lie
alike has as much as it errs by.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import rows_of_units
from station.domain.core.types import Floats, SampleTable

#: Waves of the error that are summed, and steps beside the noise below which nothing of it is left.
WAVES, COARSE = 8, 1.5
#: Rounds in which the noise is found that shows as much within the dwells.
ROUNDS = 30
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
    for u, rows in enumerate(rows_of_units(table.unit)):
        if step[u] <= COARSE * sheet or rows.stop == rows.start:
            continue
        where = visit[rows] - visit[rows.start]
        mean, count = _means(reading[rows], where), np.bincount(where)[:, None]
        within = reading[rows] - mean[where]
        free = max(len(where) - len(count), 1)
        noise = _below_steps(np.sum(within**2, axis=0) / free, float(step[u]), sheet)
        tell[rows] = step[u] <= HOPELESS * noise.max()
        error = error_of_means(np.full(3, step[u]), noise) * np.sqrt(count * _alike(mean, float(step[u])))
        reading[rows] += error[where] * rng.standard_normal(within.shape)
    table = replace(table, reading=reading)
    return table if tell.all() or not tell.any() else table[tell].used()


def _below_steps(variance: Floats, step: float, sheet: float) -> Floats:
    """The noise (3) that shows as a variance (3) within the dwells, once rounded."""
    noise = np.full(3, sheet)
    for _ in range(ROUNDS):
        hidden = step**2 / 12 - error_of_means(np.full(3, step), noise) ** 2
        noise = np.sqrt(np.maximum(variance - hidden, 0.0))
        noise = np.where(noise > step / 2, noise, np.minimum(noise, sheet))
    return noise


def _alike(mean: Floats, step: float) -> Floats:
    """How many dwells lie alike on an axis, of each one (v, 3) of these means."""
    count = np.empty(mean.shape)
    for axis, column in enumerate(mean.T):
        order = np.argsort(column)
        group = np.cumsum(np.diff(column[order], prepend=column[order[0]]) > ALIKE * step)
        count[order, axis] = np.bincount(group)[group]
    return count


def _means(values: Floats, where: NDArray[np.intp]) -> Floats:
    return np.stack([np.bincount(where, column) for column in values.T], axis=1) / np.bincount(where)[:, None]
