"""Where the mean of readings at rest steps and stays: an offset that jumped while the unit was not touched.

At each row the means of equal windows before and after it are compared, with windows of doubling length. A step is
beyond what such differences usually are at that length, drift and walk included, and as large between windows farther
away: what settles, drifts or passes soon is none.
"""

import numpy as np

from station.domain.core.types import Floats

#: Windows are at least this long, s, and of so many readings; a stretch holds so many of the longest ones.
LEAST_S, LEAST_READINGS, LEAST_WINDOWS = 0.25, 8, 16
#: Differences of windows are a step from so many of their robust deviations on.
SIGMA = 8.0
#: Between windows so many lengths long, and of so many of the shortest, beside those next to it, the difference is the
#: same within these shares of it.
AWAY, LEAST_AWAY, SAME = 4, 12, (0.7, 1.4)
#: Readings that hardly scatter go from one code to the next one by drift alone; a step is more codes than that.
MOST_CODES = 1.5


def find(reading: Floats, period_s: float) -> list[int]:
    """Rows, rising, at which the mean of readings (n, 3) of one rest, period_s apart, steps: the first row after."""
    least = _least_window(period_s)
    found, pending = list[int](), [(0, len(reading))]
    while pending:
        begin, end = pending.pop()
        row = _clearest(reading[begin:end], least)
        if row is not None:
            found.append(begin + row)
            pending += [(begin, begin + row), (begin + row, end)]
    return sorted(found)


def least_rows(period_s: float) -> int:
    """How many readings, period_s apart, a rest has at the least in which a step shows."""
    return LEAST_WINDOWS * _least_window(period_s)


def _least_window(period_s: float) -> int:
    return max(LEAST_READINGS, round(LEAST_S / period_s)) if period_s > 0 else LEAST_READINGS


def _clearest(reading: Floats, least: int) -> int | None:
    """The row of the clearest step at the shortest windows that show one."""
    window = least
    if len(reading) < LEAST_WINDOWS * window:
        return None
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(reading - reading.mean(axis=0), axis=0)])
    apart = np.abs(np.diff(reading, axis=0))
    noise = np.median(apart, axis=0) / 0.6745 / np.sqrt(2)
    code = np.array([np.min(a[a > 0], initial=np.inf) for a in apart.T])
    coarse = np.where(noise == 0, MOST_CODES * np.where(np.isfinite(code), code, 0.0), 0.0)
    while len(reading) >= LEAST_WINDOWS * window:
        every = window // least
        change = _changes(sums, window, every)
        usual = np.median(np.abs(change), axis=0) / 0.6745
        allowed = np.maximum(SIGMA * np.maximum(usual, noise * np.sqrt(2 / window)), coarse)
        beyond = (np.abs(change) / np.where(allowed > 0, allowed, np.inf)).max(axis=1)
        if beyond.max() > 1:
            row, largest = _largest(sums, window, every, int(np.argmax(beyond)) * every, allowed)
            if _stays(sums, row, window, max(AWAY * window, LEAST_AWAY * least), largest):
                return row
        window *= 2
    return None


def _changes(sums: Floats, window: int, every: int) -> Floats:
    """Means of the window from every so many rows on less those of the window before it."""
    middle = sums[window:-window:every]
    return np.asarray((sums[2 * window :: every] - 2 * middle + sums[: -2 * window : every]) / window)


def _largest(sums: Floats, window: int, every: int, near: int, allowed: Floats) -> tuple[int, Floats]:
    """The row beside which the windows differ the most, within `every` rows of the window's begin `near`, and by what
    (3)."""
    begin = max(near - every, 0)
    change = _changes(sums[begin : near + every + 2 * window + 1], window, 1)
    best = int(np.argmax((np.abs(change) / np.where(allowed > 0, allowed, np.inf)).max(axis=1)))
    return begin + window + best, change[best]


def _stays(sums: Floats, row: int, window: int, away: int, change: Floats) -> bool:
    """Whether a change (3) at a row is as large between the `away` rows beside the windows next to it."""
    before, after = max(row - window - away, 0), min(row + window + away, len(sums) - 1)
    if row - window - before < window or after - row - window < window:
        return False
    ahead = (sums[row - window] - sums[before]) / (row - window - before)
    behind = (sums[after] - sums[row + window]) / (after - row - window)
    share = float((behind - ahead) @ change / (change @ change))
    return SAME[0] < share < SAME[1]
