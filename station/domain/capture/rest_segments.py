"""A raw recording, turned by hand → the stretches in which the unit was at rest."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from station.domain.capture import mean_steps
from station.domain.capture.sample_rate import rate_of
from station.domain.core.types import Floats, Labels, SampleTable
from station.errors import SamplesError

#: Rest is judged over this long, and a stretch at rest is at least as long.
WINDOW_S = 1.0
#: Fewer readings in a window tell no noise.
MIN_READINGS = 8
#: The quietest share of the windows shows the noise of a unit at rest.
QUIET_SHARE = 0.05
#: A window moves when its standard deviation is above (1 + MOTION_MARGIN/√n) times that noise: ten of its own
#: deviations at 100 readings, where n readings know a standard deviation to 1/√(2n).
MOTION_MARGIN = 10.0
#: A reading that goes to and fro between two codes scatters by half a step.
BETWEEN_CODES = 0.51
#: This share of a window at either end may still move; a disturbance that short does not end a stretch.
EDGE_SHARE = 0.2
#: Means on both sides of a row differ when they are this many robust deviations of such differences apart …
STEP_SIGMA = 8.0
#: … and by this share of the readings' own size: a third of a degree.
STEP_SHARE = 0.006
#: A pause between two readings longer than this many steps, and this long, ends a stretch.
GAP_STEPS, GAP_S = 5.0, 0.25
#: Parts of a stretch whose means are compared.
PARTS = 8
#: Directions closer than this are one orientation.
SAME_ORIENTATION_DEG = 10.0

Ints = NDArray[np.int64]


def find(time_s: Floats, reading: Floats, louder: float = 1.0) -> Ints:
    """Stretches at rest (k, 2) of readings (n, 3): first row and one past the last, in order; k may be 0. louder: how
    many times the noise of the quietest parts a rest may show.

    A reading belongs to one when some window of WINDOW_S around it is as quiet as the recording can be; a stretch ends
    where the readings pause and where the means before and after differ, however short the move between them was.
    Errors: SamplesError when the recording is too short to tell.
    """
    window = _window(time_s)
    std = _moving_std(reading, window)
    code = np.array([_smallest_difference(column) for column in reading.T])
    quiet = louder * _quiet_level(reading, std) * (1 + MOTION_MARGIN / np.sqrt(window))
    quiet = np.maximum(quiet, BETWEEN_CODES * code)
    still = (std <= quiet).all(axis=1) & ~_straddles_gap(time_s, window)
    runs = _runs(still)
    if not len(runs):
        return np.zeros((0, 2), np.int64)
    edge = runs + np.array([0, window - 1])
    short = round(EDGE_SHARE * window)
    step = np.maximum(_step_threshold(reading, still, window), code)
    rests = [part for a, b in _joined(reading, edge, short, step) for part in _split(reading, a, b, window, step)]
    parts = [part for a, b in rests for part in _without_steps(reading, a, b, WINDOW_S / window)]
    trimmed = np.array(parts, np.int64).reshape(-1, 2) + np.array([short, -short])
    return np.asarray(trimmed[trimmed[:, 1] - trimmed[:, 0] >= window - 2 * short])


def _quiet_level(reading: Floats, std: Floats) -> Floats:
    """What the quietest windows scatter by (3); those that stand still at the end of an axis's range are cut off there,
    and show no noise, nor do those of a sensor that froze for a while."""
    level, window = np.quantile(std, QUIET_SHARE, axis=0), len(reading) - len(std) + 1
    changes = np.cumsum(np.r_[np.zeros((1, 3)), reading[1:] != reading[:-1]], axis=0)
    stands = changes[window - 1 :] == changes[: len(std)]
    for axis, column in enumerate(reading.T):
        cut_off = stands[:, axis] & np.isin(column[: len(std)], (column.min(), column.max()))
        if 0 < cut_off.sum() < len(std):
            level[axis] = max(level[axis], np.quantile(std[~cut_off, axis], QUIET_SHARE))
    frozen = stands.all(axis=1)
    if 0 < frozen.sum() < len(std) / 2:
        shown = std[~frozen]
        awake = np.maximum(level, np.quantile(shown, QUIET_SHARE, axis=0))
        # Where rest is no more than codes that stand still, hardly a window is as quiet without standing still.
        if (shown <= awake * (1 + MOTION_MARGIN / np.sqrt(window))).all(axis=1).sum() > frozen.sum():
            level = awake
    return np.asarray(level)


def _smallest_difference(column: Floats) -> float:
    """Of neighbouring readings (n) that differ by more than rounding."""
    apart = np.abs(np.diff(column))
    return float(np.min(apart[apart > 1e-6 * np.ptp(column)], initial=np.ptp(column)))


def _runs(flag: NDArray[np.bool_]) -> Ints:
    """First row and one past the last (k, 2) of each run of True."""
    return np.flatnonzero(np.diff(np.r_[0, flag.astype(np.int8), 0])).reshape(-1, 2)


def _straddles_gap(time_s: Floats, window: int) -> NDArray[np.bool_]:
    """Whether the window from each row on (n − window + 1) holds a pause of the recording, or a clock set back."""
    gap = _pauses(time_s) | (np.diff(time_s) < 0)
    count = np.cumsum(np.r_[0, gap])
    return np.asarray(count[window - 1 :] - count[: len(count) - window + 1] > 0)


def _pauses(time_s: Floats) -> NDArray[np.bool_]:
    """Whether the recording pauses between one reading and the next (n − 1)."""
    apart = np.diff(time_s)
    step = float(np.median(apart[apart > 0])) if (apart > 0).any() else 0.0
    return np.asarray(apart > max(GAP_STEPS * step, GAP_S))


def _step_threshold(reading: Floats, still: NDArray[np.bool_], window: int) -> Floats:
    """From which difference (3) on two neighbouring half-window means belong to two poses."""
    half = window // 2
    sums = np.cumsum(np.r_[np.zeros((1, 3)), reading - reading.mean(axis=0)], axis=0)
    rows = np.flatnonzero(still)
    before = sums[rows + half] - sums[rows]
    after = sums[rows + 2 * half] - sums[rows + half]
    spread = np.median(np.abs(after - before), axis=0) / half / 0.6745
    size = float(np.median(np.linalg.norm(reading[rows + half], axis=1)))
    return np.asarray(np.maximum(STEP_SIGMA * spread, STEP_SHARE * size))


def _joined(reading: Floats, edge: Ints, short: int, step: Floats) -> list[tuple[int, int]]:
    """Quiet stretches (k, 2), joined where they overlap or leave `short` rows, and have one mean on both sides."""
    done: list[tuple[int, int]] = []
    for begin, end in edge.tolist():
        if done and begin - done[-1][1] <= short:
            first, last = done[-1]
            if begin >= last:
                before, after = reading[max(first, last - 2 * short) : last], reading[begin : begin + 2 * short]
                same = bool((np.abs(before.mean(axis=0) - after.mean(axis=0)) <= step).all())
            else:
                same = True  # they overlap: where exactly the mean changes is for _split to find
            if same:
                done[-1] = first, end
                continue
        done.append((begin, end))
    return done


def _split(reading: Floats, begin: int, end: int, window: int, step: Floats) -> list[tuple[int, int]]:
    """Parts of a stretch without a step of the mean: of each step the row where it is largest."""
    half = max(window // 4, 2)
    if end - begin < 2 * half + 1:
        return [(begin, end)]
    sums = np.cumsum(np.r_[np.zeros((1, 3)), reading[begin:end] - reading[begin]], axis=0)
    before = (sums[half:-half] - sums[: -2 * half]) / half
    after = (sums[2 * half :] - sums[half:-half]) / half
    excess = (np.abs(after - before) / np.where(step > 0, np.sqrt(2.0) * step, np.inf)).max(axis=1)
    parts, start = [], begin
    for first, last in _runs(excess > 1).tolist():
        row = begin + half + first + int(np.argmax(excess[first:last]))
        parts.append((start, row))
        start = row
    return [*parts, (start, end)]


def _without_steps(reading: Floats, begin: int, end: int, period_s: float) -> list[tuple[int, int]]:
    """Parts of a rest between jumps of the offset, which are smaller than those of a pose."""
    rows = [begin, *(begin + row for row in mean_steps.find(reading[begin:end], period_s)), end]
    return list(pairwise(rows))


def table(time_s: Floats, reading: Floats, stretches: Ints, unit: str, names: list[str]) -> SampleTable:
    """A samples table of one run with one visit a stretch, at positions called `names`."""
    length = stretches[:, 1] - stretches[:, 0]
    rows = np.concatenate([np.arange(a, b) for a, b in stretches])
    visit = np.repeat(np.arange(len(stretches), dtype=np.int32), length)
    known = list(dict.fromkeys(names))
    code = np.array([known.index(n) for n in names], np.int32)
    return SampleTable(
        unit=Labels((unit,), np.zeros(len(rows), np.int32)),
        run=np.zeros(len(rows), np.int32),
        visit=visit,
        position=Labels(tuple(known), code[visit]),
        time_s=time_s[rows],
        reading=reading[rows],
    )


def orientations(directions: Floats) -> Ints:
    """Number of the orientation of each direction (k, 3): those within SAME_ORIENTATION_DEG of its first are one."""
    unit = directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-300)
    number = np.full(len(unit), -1)
    for i in range(len(unit)):
        if number[i] < 0:
            close = unit @ unit[i] > np.cos(np.deg2rad(SAME_ORIENTATION_DEG))
            close[i] = True
            number[close & (number < 0)] = number.max() + 1
    return number


def wandering(reading: Floats) -> float:
    """How far the means of PARTS parts of a stretch (n, 3) lie apart, beyond what its noise from reading to reading
    explains: what rests goes nowhere and comes back from nowhere."""
    parts = min(PARTS, max(len(reading) // 4, 1))
    means = np.array([part.mean(axis=0) for part in np.array_split(reading, parts)])
    noise = float(np.linalg.norm(np.diff(reading, axis=0).std(axis=0))) / 2**0.5 if len(reading) > 1 else 0.0
    # The range of eight means of white noise is about three of their deviations.
    explained = 3 * noise / (len(reading) / parts) ** 0.5
    return float(max(np.linalg.norm(np.ptp(means, axis=0)) - explained, 0.0))


def _window(time_s: Floats) -> int:
    """Rows of a window: WINDOW_S of them, or MIN_READINGS of a slow recording."""
    rate_hz, _ = rate_of(time_s, ~_pauses(time_s))
    step = 1 / rate_hz if rate_hz else 0.0
    window = max(round(WINDOW_S / step), MIN_READINGS) if step > 0 else 0
    if window == 0 or len(time_s) < 4 * window:
        least_s = 4 * max(WINDOW_S, MIN_READINGS * step)
        lasts_s = float(time_s[-1] - time_s[0]) if len(time_s) else 0.0
        raise SamplesError("recording-too-short", readings=len(time_s), lasts_s=lasts_s, least_s=least_s)
    return window


def _moving_std(reading: Floats, window: int) -> Floats:
    """Standard deviations (n − window + 1, 3) over `window` readings from each row on."""
    x = reading - reading.mean(axis=0)
    zero = np.zeros((1, 3))
    sums, squares = np.cumsum(np.r_[zero, x], axis=0), np.cumsum(np.r_[zero, x**2], axis=0)
    mean = (sums[window:] - sums[:-window]) / window
    return np.asarray(np.sqrt(np.maximum((squares[window:] - squares[:-window]) / window - mean**2, 0.0)))
