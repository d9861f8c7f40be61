"""What readings tell of the sensor itself, where no data sheet does: noise, resolution, range, rate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.capture.sample_rate import rate_of
from station.domain.core.types import Array, Floats
from station.domain.recognition.distinct_values import distinct

#: Differences of values are whole steps when they miss them by this share of one; by chance they miss by 0.29.
WHOLE = 0.15
#: Values from whose differences a step is found, and the fewest that show one.
MOST_READINGS, MOST_VALUES, LEAST_VALUES = 200_000, 4000, 4
#: Fewer readings than these are apart by their poses, not by a step.
LEAST_READINGS = 16
#: A reading repeated this often in a visit, at the end of what the axis ever reads, is the end of its range.
FLAT_SHARE = 0.5
#: The range of one axis is more than this share of another's: a part has one range.
ONE_RANGE = 0.7
MAD = 1.4826
#: A step below this share of the noise is the last digit of a printed number and none of a converter.
PRINTED = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class InferredSheet:
    """noise (3): standard deviation of one reading from one to the next; lsb (3): step of the readings, 0 where none
    shows; full_scale: where readings are cut off flat, or None; rate_hz: readings over the time they took, or None;
    jitter_s: scatter of a step in time."""

    noise: Floats
    lsb: Floats
    full_scale: float | None
    rate_hz: float | None
    jitter_s: float


def infer(reading: Floats, time_s: Floats, visit: Array) -> InferredSheet:
    """From the readings (n, 3) of visits, numbered (n)."""
    within = np.diff(visit) == 0
    lsb = np.array([step_of(column) for column in reading.T])
    noise = noise_of(reading, within)
    lsb = np.where(lsb > PRINTED * noise, lsb, 0.0)
    rate_hz, jitter_s = rate_of(time_s, within)
    return InferredSheet(noise, lsb, full_scale_of(reading, visit, lsb, noise), rate_hz, jitter_s)


def noise_of(reading: Floats, within: NDArray[np.bool_]) -> Floats:
    """White noise (3) of one reading from differences of neighbours within visits; rounding stays in it."""
    near = np.abs(np.diff(reading, axis=0)[within])
    if not len(near):
        return np.zeros(3)
    robust = MAD * np.array([np.median(column) for column in near.T])
    # A coarse sensor's differences are mostly 0, or of few sizes: their mean square still tells.
    bound = np.where(robust > 0, 5 * robust, np.inf)
    return np.asarray(np.sqrt(np.mean(np.minimum(near, bound) ** 2, axis=0) / 2))


def step_of(column: Floats) -> float:
    """The step of which all readings (n) are multiples apart; 0 where they show none."""
    if len(column) < LEAST_READINGS:
        return 0.0
    values = distinct(column[:MOST_READINGS])
    if len(values) > MOST_VALUES:
        middle = len(values) // 2
        values = values[middle - MOST_VALUES // 2 : middle + MOST_VALUES // 2]
    apart = np.diff(values)
    # Rounding of one number written twice, by its own size: one outlier says nothing of the others.
    apart = apart[apart > 1e-9 * np.maximum(np.abs(values[1:]), np.abs(values[:-1]))]
    if len(apart) < LEAST_VALUES - 1:
        return float(apart.min()) if len(apart) else 0.0
    step = float(apart.min())
    step = float(np.median(apart[apart < 1.5 * step]))
    # Numbers printed with few digits miss the step a little: it is refined over farther and farther values.
    offsets = np.cumsum(np.r_[0.0, apart])
    reach = 8.0
    while True:
        near = offsets[offsets <= reach * step]
        whole = np.round(near / step)
        if whole.any():
            step = float((whole @ near) / (whole @ whole))
        if reach * step >= offsets[-1]:
            break
        reach *= 4
    miss = offsets / step - np.round(offsets / step)
    return step if float(np.sqrt(np.mean(miss**2))) < WHOLE and len(column) > len(values) else 0.0


def full_scale_of(reading: Floats, visit: Array, lsb: Floats, noise: Floats) -> float | None:
    """The magnitude at which readings (n, 3) are cut off; None where they are not.

    A visit most of whose readings are the very greatest (or least) that the axis ever shows, while others scatter; not
    one in which all axes stand still, and not all at an end: the sensor froze there.
    """
    awake = ~_frozen(reading, visit)
    found = [
        abs(float(end))
        for i in range(3)
        for end in (reading[:, i].max(), reading[:, i].min())
        if noise[i] > lsb[i] and end != 0 and _flat(reading[awake, i], visit[awake], float(end))
    ]
    return max(found) if found else None


def _frozen(reading: Floats, visit: Array) -> NDArray[np.bool_]:
    """Which readings (n) are of a visit in which all axes stand still, and not all at an end of theirs."""
    begin = np.flatnonzero(np.r_[True, np.diff(visit) != 0])
    length = np.diff(np.r_[begin, len(visit)])
    first = reading[begin]
    still = np.logical_and.reduceat((reading == np.repeat(first, length, axis=0)).all(axis=1), begin)
    size = np.abs(first)
    one_range = size.min(axis=1) > ONE_RANGE * size.max(axis=1)
    at_end = ((first == reading.max(axis=0)) | (first == reading.min(axis=0))).all(axis=1) & one_range
    return np.asarray(np.repeat(still & ~at_end, length))


def _flat(column: Floats, visit: Array, end: float) -> bool:
    if not len(column):
        return False
    begin = np.flatnonzero(np.r_[True, np.diff(visit) != 0])
    counts = np.diff(np.r_[begin, len(visit)])
    share = np.add.reduceat(column == end, begin) / counts
    return bool(((share >= FLAT_SHARE) & (counts >= LEAST_VALUES)).any())
