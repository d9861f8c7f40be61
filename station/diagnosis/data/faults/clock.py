"""The device's clock: frames against the host's time."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.counters import unwrapped
from station.diagnosis.data.faults.gross_fault import FaultParameter, GrossFault, rows_of_units, unit_label
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: Standard deviations beyond the tolerance from which a clock is off.
DETECTION_SIGMA = 4.0


def faults(recipe: Recipe, table: SampleTable, stop: NDArray[np.intp]) -> list[GrossFault]:
    """Units whose sample rate is beyond the data sheet's tolerance."""
    error, std = rates(recipe, table, stop)
    tolerance = recipe.device.clock_tolerance_ppm * 1e-6
    beyond = (np.abs(error) - tolerance) / std
    off = beyond > DETECTION_SIGMA
    if not off.any():
        return []
    numbers = tuple(
        # A clock within its tolerance has an error of its own beside the fault.
        FaultParameter(
            "rate_error",
            None,
            unit_label(table.unit, int(u)),
            float(error[u]),
            float(np.hypot(std[u], tolerance / 2)),
            "1",
        )
        for u in np.flatnonzero(np.isfinite(error))
    )
    told = f"{int(off.sum())} of {len(error)} clocks are off by more than {recipe.device.clock_tolerance_ppm:g} ppm"
    return [GrossFault("clock-error", "unit", numbers, told, float(0.5 * np.sum(beyond[off] ** 2)))]


def rates(recipe: Recipe, table: SampleTable, stop: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Relative error of each unit's rate (U) and its standard deviation, NaN where nothing tells.

    Frames are numbered by the counter, or by their place where there is none, and laid against time stop by stop;
    over a whole run where the counter cannot have gone round unnoticed in between.
    """
    first = np.flatnonzero(np.diff(stop, prepend=-1))
    bits = recipe.device.counter_bits
    nominal = recipe.device.rate_hz
    has = "counter" in table.values
    number = (
        unwrapped(table.values["counter"], stop, bits)
        if has
        else _numbers_from_time(table.time_s, stop, first, nominal)
    )
    error = np.full(len(table.unit.names), np.nan)
    std = np.full(len(table.unit.names), np.nan)
    for u, of in enumerate(rows_of_units(table.unit)):
        rows = np.arange(of.start, of.stop)
        if len(rows) < 3:
            continue
        group = stop[rows]
        error[u], std[u] = _slope(table.time_s[rows], number[rows] / nominal, group)
        if has and np.isfinite(std[u]):
            starts = first[slice(*np.searchsorted(first, (of.start, of.stop)))] - of.start
            joined = _numbers_across_visits(table, rows, number[rows], starts, error[u], std[u], (nominal, bits))
            if joined is not None:
                run = table.run[rows]
                error[u], std[u] = _slope(table.time_s[rows], joined / nominal, run, stop[rows])
    return error, std


def _numbers_from_time(
    time_s: Floats, stop: NDArray[np.intp], first: NDArray[np.intp], rate_hz: float
) -> NDArray[np.int64]:
    """Numbers of frames without a counter: one more than the last, or as many more as fit into a gap."""
    step = np.diff(time_s, prepend=time_s[:1]) * rate_hz
    step = np.where(np.diff(stop, prepend=-1) != 0, 0, np.maximum(np.round(step), 1))
    total = np.cumsum(step)
    return np.asarray(total - np.repeat(total[first], np.diff(np.append(first, len(stop)))), np.int64)


def _slope(time_s: Floats, device_s: Floats, group: Array, stop: Array | None = None) -> tuple[float, float]:
    """Relative error of the device's time against the host's, with one offset for each group, and its deviation.

    stop: where given, what the samples of a stop are off by together counts once (a start between two frames).
    """
    _, code = np.unique(group, return_inverse=True)
    count = np.bincount(code)
    t = time_s - (np.bincount(code, time_s) / count)[code]
    y = device_s - (np.bincount(code, device_s) / count)[code] - t
    spread = float(t @ t)
    free = len(t) - len(count) - 1
    if spread <= 0 or free < 1:
        return float("nan"), float("nan")
    slope = float(t @ y) / spread
    left = y - slope * t
    std = float(np.sqrt(np.sum(left**2) / free / spread))
    if stop is not None:
        pulls = np.bincount(stop - stop.min(), left * t)
        spare = max(len(pulls) - len(count) - 1, 1)
        std = max(std, float(np.sqrt(np.sum(pulls**2) * len(pulls) / spare)) / spread)
    return slope, std + 1e-9


def _numbers_across_visits(
    table: SampleTable, rows: NDArray[np.intp], number: NDArray[np.int64], starts: NDArray[np.intp],
    error: float, std: float, clock: tuple[float, int],
) -> NDArray[np.int64] | None:  # fmt: skip
    """Frame numbers of a unit counted on from stop to stop, or None where the counter may have gone round.

    starts: where among the unit's rows each stop begins.
    """
    nominal, bits = clock
    span = 1 << bits
    out = number.copy()
    raw = table.values["counter"][rows].astype(np.int64)
    for a, b in pairwise(starts):
        if table.run[rows[a]] != table.run[rows[b]]:
            continue
        gap_s = table.time_s[rows[b]] - table.time_s[rows[b - 1]]
        if gap_s * nominal * max(5 * std, 1e-4) > span / 4:
            return None
        expected = gap_s * nominal * (1 + error)
        step = (raw[b] - raw[b - 1]) % span
        step += span * round((expected - step) / span)
        end = np.searchsorted(starts, b) + 1
        stop_at = starts[end] if end < len(starts) else len(rows)
        out[b:stop_at] += out[b - 1] + step - out[b]
    return out
