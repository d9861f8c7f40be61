"""The device's clock: frames counted over spans of the host's time.

Stamps of a host are late by whatever it was busy with, never early, so no single gap tells a rate. Frames are numbered
in the order of arrival; a frame is taken for lost only where all stamps after it in the visit stay late by a whole
period. The slope of number against stamp is then fitted over each visit, or over the whole run where a counter bridges
the visits, and its standard deviation is that of the visits among each other: jitter is whatever they scatter by. Of
frames that are handed over in bursts the last of each burst counts, and none of a visit's last, which the visit may
cut."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.counters import unwrapped
from station.diagnosis.data.faults.gross_fault import (
    BlockGain,
    FaultParameter,
    GrossFault,
    block_gain,
    halves_of,
    rows_of_units,
    unit_label,
)
from station.diagnosis.data.faults.rounded_stamps import deviation_of_rounding, period_within_rounding, stamp_grid
from station.diagnosis.data.visit_noise import MAD_PER_SIGMA
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: Standard deviations beyond the tolerance from which a clock is off.
DETECTION_SIGMA = 4.0
#: An oscillator is never so far off: such a rate is another setting, not an error (the worst RC oscillators, 10 %).
MAX_RATE_ERROR = 0.15
#: No host stamps more exactly, s.
STAMP_STD_S = 1e-6
#: Without a counter frames that are missing can be counted where stamps scatter by less than this share of a period.
MAX_SCATTER = 0.08
#: … and where they lie on a grid no coarser than this share of a period: two frames may come to lie two steps apart.
MOST_GRID = 0.3
#: Frames come in bursts where at least this share of steps within visits is shorter than this share of the mean one.
IN_BURSTS, IN_BURST = 1 / 4, 0.2
#: Rounds of numbering the frames by the rate and fitting the rate to the numbers.
ROUNDS = 3


@dataclass(frozen=True, slots=True, eq=False)
class ClockRates:
    """Of each unit (U) the relative error of its rate and the standard deviation, NaN where nothing tells; error,
    weight, frames (u, s): of each of its visits on its own, weight 0 where a visit tells nothing."""

    error: Floats
    std: Floats
    visits: tuple[tuple[Floats, Floats, Floats], ...]


def faults(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp]) -> list[GrossFault]:
    """Units whose sample rate is beyond the data sheet's tolerance; none where no data sheet states a rate."""
    if not states_rate(recipe):
        return []
    found = rates(recipe, table, visit)
    error, std = found.error, found.std
    tolerance = recipe.device.clock_tolerance_ppm * 1e-6
    beyond = (np.abs(error) - tolerance) / std
    off = (beyond > DETECTION_SIGMA) & (np.abs(error) < MAX_RATE_ERROR)
    if not off.any():
        return []
    numbers = tuple(
        FaultParameter("rate_error", None, unit_label(table.unit, int(u)), float(error[u]), float(std[u]), "1")
        for u in np.flatnonzero(np.isfinite(error) & (np.abs(error) < MAX_RATE_ERROR))
    )
    sentence = f"{int(off.sum())} of {len(error)} clocks are off by more than {recipe.device.clock_tolerance_ppm:g} ppm"
    gain = _held_out_gain([found.visits[int(u)] for u in np.flatnonzero(off)], tolerance)
    nats = float(0.5 * np.sum(beyond[off] ** 2)) if gain is None else max(gain.total, 0.0)
    return [GrossFault("clock-error", "unit", numbers, sentence, nats, gain=gain)]


def states_rate(recipe: Recipe) -> bool:
    """Whether the recipe states a rate against which a clock can be wrong; a rate taken from the readings is none."""
    return "device" not in recipe.model_fields_set or "rate_hz" in recipe.device.model_fields_set


def _held_out_gain(units: list[tuple[Floats, Floats, Floats]], tolerance: float) -> BlockGain | None:
    """The gain of the rate of one half of a unit's visits at the other half, against the nearest rate within the
    tolerance; Gaussian, with the scatter of the fitted visits."""
    scores, counts = [], []
    for every, weights, number in units:
        live = weights > 0
        error, weight, frames = every[live], weights[live], number[live]
        half = halves_of(len(error))
        for part in (0, 1):
            fitted, judged = half != part, half == part
            if fitted.sum() < 2 or not judged.any():
                continue
            rate = float(np.average(error[fitted], weights=weight[fitted]))
            variance = float(np.sum(weight[fitted] * (error[fitted] - rate) ** 2)) / (fitted.sum() - 1)
            scale = weight[judged] / max(variance, STAMP_STD_S**2)
            nearest = float(np.clip(rate, -tolerance, tolerance))
            scores.append(0.5 * scale * ((error[judged] - nearest) ** 2 - (error[judged] - rate) ** 2))
            counts.append(frames[judged])
    return block_gain(np.concatenate(scores), np.concatenate(counts), "frame") if scores else None


def rates(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp]) -> ClockRates:
    """Each unit's rate against the recipe's. Frames are numbered by the counter, or by their place where there is none,
    and fitted against time visit by visit, or over a whole run where the counter cannot have wrapped unnoticed in
    between. Where frames are missing and stamps scatter too much to count them, the rate is unknown."""
    bits, nominal = recipe.device.counter_bits, recipe.device.rate_hz
    has = "counter" in table.values
    counted = unwrapped(table.values["counter"], visit, bits) if has else None
    error, std = np.full((2, len(table.unit.names)), np.nan)
    visits = [(np.zeros(0), np.zeros(0), np.zeros(0))] * len(error)
    for u, of in enumerate(rows_of_units(table.unit)):
        rows = np.arange(of.start, of.stop)
        if len(rows) < 3:
            continue
        t, group, number = _numbered(table, visit, counted, rows)
        kept = _fresh(t, group)
        if counted is None and not _is_countable(t[kept], number[kept], group[kept], _places(group)[kept]):
            continue
        error[u], std[u], visits[u] = _rate(t, number, group, group, kept, nominal)
        if has and np.isfinite(std[u]):
            starts = np.flatnonzero(np.diff(group, prepend=-1))
            joined = _numbers_across_visits(table, rows, number, starts, error[u], std[u], (nominal, bits))
            if joined is not None:
                error[u], std[u], _ = _rate(t, joined, table.run[rows], group, kept, nominal)
    return ClockRates(error, std, tuple(visits))


def _rate(
    time_s: Floats, number: NDArray[np.int64], group: Array, visit: Array, kept: NDArray[np.bool_], nominal: float
) -> tuple[float, float, tuple[Floats, Floats, Floats]]:
    """What `_slope` gives of the kept ones of frames (n) by their numbers, with what their rounding adds; where their
    rounding accounts for all, the rate by that."""
    t, k, of = time_s[kept], number[kept], group[kept]
    error, std, own = _slope(t, k / nominal, of, visit[kept])
    if (found := period_within_rounding(time_s, number, group)) is not None:
        period, off = found
        return 1 / (nominal * period) - 1, off / (nominal * period**2), own
    repeated = deviation_of_rounding(t, k, of, 1 / (nominal * (1 + error))) if np.isfinite(std) else 0.0
    return error, float(np.hypot(std, repeated)), own


def _fresh(time_s: Floats, group: Array) -> NDArray[np.bool_]:
    """The frames (n) that show the time: all, or the last of each burst that ended within its visit. A burst is stamped
    when it is handed over, at the arrival of its last frame; of a burst that the visit cuts off, that frame is
    missing."""
    step = np.diff(time_s)
    within = group[1:] == group[:-1]
    inside = step[within]
    short = IN_BURST * float(np.mean(inside)) if len(inside) else 0.0
    if np.count_nonzero(inside < short) < IN_BURSTS * len(inside):
        return np.ones(len(time_s), bool)
    return np.append(within & (step >= short), False)


def frames_of(
    recipe: Recipe, table: SampleTable, visit: NDArray[np.intp], unit: int
) -> tuple[Floats, NDArray[np.intp], NDArray[np.int64]]:
    """Stamps (n) of a unit's frames by the host's clock, s, the visit of each, and its number by the device."""
    bits = recipe.device.counter_bits
    counted = unwrapped(table.values["counter"], visit, bits) if "counter" in table.values else None
    of = rows_of_units(table.unit)[unit]
    return _numbered(table, visit, counted, np.arange(of.start, of.stop))


def _numbered(
    table: SampleTable, visit: NDArray[np.intp], counted: NDArray[np.int64] | None, rows: NDArray[np.intp]
) -> tuple[Floats, NDArray[np.intp], NDArray[np.int64]]:
    t, group = table.time_s[rows], visit[rows] - visit[rows[0]]
    return t, group, _numbers_in_order(t, group) if counted is None else counted[rows]


def _numbers_in_order(time_s: Floats, group: Array) -> NDArray[np.int64]:
    """Numbers (n) of frames without a counter, from 0 in each visit (group): their order, plus the frames lost for
    good. Of the periods that the gaps suggest, the one is taken that leaves the stamps nearest to a line."""
    number, kept = _places(group), _fresh(time_s, group)
    if period_within_rounding(time_s, number, group) is not None:
        # A grid of stamps as coarse as the period leaves some out by itself.
        return number
    number[kept] = _numbers_of_stamps(time_s[kept], group[kept], number[kept])
    return number


def _places(group: Array) -> NDArray[np.int64]:
    """The place (n) of each frame in its visit, from 0."""
    return np.asarray(np.arange(len(group)) - np.repeat(*_first_and_count(group)), np.int64)


def _numbers_of_stamps(time_s: Floats, group: Array, place: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers (n) of frames at these places of their visits, as many ahead of the place as were lost before."""
    within = group[1:] == group[:-1]
    gap = np.diff(time_s)[within] / np.diff(place)[within]
    usual = float(np.median(gap)) if len(gap) else 0.0
    # Late stamps leave the median alone, stamps of whole milliseconds the mean; of bursts only the span tells a rate.
    means = [float(np.mean(some)) for some in (gap[gap < 1.5 * usual], gap) if len(some)]
    first, count = _first_and_count(group)
    before = np.repeat(place[first], count)
    tried = [_numbers_by_period(time_s, group, place - before, p) for p in (usual, *means) if p > 0]
    return min(tried, key=lambda pair: pair[0])[1] + before if tried else place


def _is_countable(time_s: Floats, number: NDArray[np.int64], group: Array, place: NDArray[np.int64]) -> bool:
    """Whether the numbers of frames are certain: none is missing, or the stamps lie close to their lines, on a grid
    that leaves nobody out by itself."""
    if np.array_equal(number, place):
        return True
    first, count = _first_and_count(group)
    frames = np.maximum(number[first + count - 1] - number[first], 1)
    if MOST_GRID * np.median((time_s[first + count - 1] - time_s[first]) / frames) < stamp_grid(time_s):
        return False
    middle = [np.repeat(np.add.reduceat(x, first) / count, count) for x in (time_s, number.astype(float))]
    t, n = time_s - middle[0], number - middle[1]
    off = n - t * float(t @ n) / max(float(t @ t), 1e-300)
    # A few late stamps leave the others in line.
    return bool(np.median(np.abs(off - np.median(off))) < MAX_SCATTER * MAD_PER_SIGMA)


def _first_and_count(group: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First row of each group of neighbours, and how many rows it has."""
    first = np.flatnonzero(np.diff(group, prepend=-1))
    return first, np.diff(np.append(first, len(group)))


def _numbers_by_period(
    time_s: Floats, group: Array, place: NDArray[np.int64], period: float
) -> tuple[float, NDArray[np.int64]]:
    """The numbers of frames sent at a period, and the scatter of their stamps about a line, s."""
    number, scatter = place, np.inf
    since = time_s - np.repeat(time_s[_first_and_count(group)[0]], _first_and_count(group)[1])
    for _ in range(ROUNDS):
        late = since / period - place
        # The least lateness of all that follow in the visit: a late stamp is made up for, a lost frame is not.
        lost = _running_minimum(late[::-1], group[::-1])[::-1]
        number = place + np.maximum(np.round(lost), 0).astype(np.int64)
        device_s = np.asarray(number * period, float)
        slope, std, _ = _slope(time_s, device_s, group, group)
        if not np.isfinite(slope) or abs(slope) > 0.5:
            break
        scatter = std
        period /= 1 + slope
    return scatter, number


def _running_minimum(values: Floats, group: Array) -> Floats:
    """Least value so far (n) within each group of neighbours."""
    # A step down by more than any range from group to group starts each anew.
    span = float(np.ptp(values)) + 1.0
    step = np.cumsum(np.diff(group, prepend=group[:1]) != 0) * span
    return np.asarray(np.minimum.accumulate(values - step) + step)


def _slope(
    time_s: Floats, device_s: Floats, group: Array, visit: Array
) -> tuple[float, float, tuple[Floats, Floats, Floats]]:
    """Relative error of the device's time against the host's, with one offset for each group, and its deviation by the
    scatter of the visits; and error, weight and frames (s) of each visit on its own."""
    code = np.cumsum(np.diff(group, prepend=group[:1]) != 0)
    count = np.bincount(code)
    t = time_s - (np.bincount(code, time_s) / count)[code]
    y = device_s - (np.bincount(code, device_s) / count)[code] - t
    spread = float(t @ t)
    free = len(t) - len(count) - 1
    if spread <= 0 or free < 1:
        return float("nan"), float("nan"), (np.zeros(0), np.zeros(0), np.zeros(0))
    slope = float(t @ y) / spread
    residual = y - slope * t
    std = float(np.sqrt(np.sum(residual**2) / free / spread))
    pulls, weight = np.bincount(visit, residual * t), np.bincount(visit, t * t)
    own = np.where(weight > 0, np.bincount(visit, t * y) / np.where(weight > 0, weight, 1.0), 0.0)
    spare = max(len(pulls) - (len(count) if len(count) < len(pulls) else 0) - 1, 1)
    std = max(std, float(np.sqrt(np.sum(pulls**2) * len(pulls) / spare)) / spread)
    return slope, std + 1e-9, (own, np.asarray(weight, float), np.bincount(visit).astype(float))


def _numbers_across_visits(
    table: SampleTable, rows: NDArray[np.intp], number: NDArray[np.int64], starts: NDArray[np.intp],
    error: float, std: float, clock: tuple[float, int],
) -> NDArray[np.int64] | None:  # fmt: skip
    """Frame numbers of a unit counted on from visit to visit, or None where the counter may have gone round.

    starts: where among the unit's rows each visit begins.
    """
    nominal, bits = clock
    span, begin, end = 1 << bits, starts[1:], starts[1:] - 1
    run, raw = table.run[rows], table.values["counter"][rows].astype(np.int64)
    same = run[begin] == run[starts[:-1]]
    gap = np.diff(table.time_s[rows])[end]
    if np.any(same & (gap * nominal * max(5 * std, 1e-4) > span / 4)):
        return None
    step = (raw[begin] - raw[end]) % span
    step += span * np.rint((gap * nominal * (1 + error) - step) / span).astype(np.int64)
    # What each visit is ahead by adds up over a run.
    ahead = np.append(0, np.cumsum(np.where(same, number[end] + step - number[begin], 0)))
    first = np.maximum.accumulate(np.append(0, np.where(same, 0, np.arange(1, len(starts)))))
    return np.asarray(number + np.repeat(ahead - ahead[first], np.diff(np.append(starts, len(rows)))))
