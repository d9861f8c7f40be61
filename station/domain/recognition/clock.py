"""Stamps of a recording → seconds from 0: their unit, the rate, its jitter, pauses and restarts."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.capture.sample_rate import rate_of
from station.domain.core.types import Array, Floats
from station.domain.recognition import corrupt_columns
from station.errors import SamplesError

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86_400.0}
_SPELLINGS = {
    "s": "s", "sec": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms", "millis": "ms", "us": "us",
    "µs": "us", "μs": "us", "usec": "us", "micros": "us", "ns": "ns", "nsec": "ns", "nanos": "ns", "utc": "s",
    "min": "min", "mins": "min", "minutes": "min", "h": "h", "hr": "h", "hours": "h", "d": "d", "day": "d", "days": "d",
    "datenum": "d",
}  # fmt: skip
#: The rate that recordings of such sensors have, as a middle and as limits, Hz.
TYPICAL_HZ, LEAST_HZ, MOST_HZ = 100.0, 0.5, 30_000.0
#: Readings come at the rate that a file states to within this share, or its stamps are in ticks of another size.
SAME_RATE = 0.3
#: Stamps of the present day since 1970, s.
EPOCH_S = (5e8, 5e9)
#: Stamps are coarse where fewer than this share of the readings has a new one, and tell the rate where so many change.
COARSE, LEAST_CHANGES = 0.2, 4
#: Fewer different stamps than this, of many readings, have lost their digits.
FEWEST_STAMPS = 4
#: A step so many times the usual one is a pause.
PAUSE_STEPS = 50.0
#: Steps from reading to reading, at least so many, lie within this share of their middle, and rise as often as they
#: fall within this factor.
LEAST_STEPS, ABOUT_ONE, AS_OFTEN = 50, 1.5, 1.5
#: A clock is steady where this share of its steps is within this share of the usual one.
MOSTLY, STEADY = 0.95, 0.2
#: More stamps than this share going back, and the rows are out of order.
BACKWARDS = 0.1
#: Units that headers confuse; slower or faster than this, one is doubted, if another makes a rate so usual.
MISLABELLED = ("s", "ms", "us", "ns")
SELDOM_HZ, USUAL_HZ = (0.5, 50_000.0), (5.0, 5_000.0)
#: A stamp is an outlier beyond so many periods, by the pace of the middle of the stamps.
FAR_PERIODS, MIDDLE = 50.0, (0.1, 0.9)


@dataclass(frozen=True, slots=True, eq=False)
class SampleClock:
    """time_s (n) from 0, in the order of `order` (n) rows. unit: of the stamps, `none` without any; inferred: by their
    size; rate_hz: counts over the span, pauses left out; source: data | given | assumed; jitter_s: scatter of steps;
    outliers: stamps far off the pace of those before and after, which is used; of_steps: added up."""

    time_s: Floats
    order: NDArray[np.intp]
    unit: str
    inferred: bool
    rate_hz: float
    source: str
    jitter_s: float = 0.0
    gaps: int = 0
    restarts: int = 0
    outliers: int = 0
    of_steps: bool = False

    def without_few(self, kept: NDArray[np.intp]) -> "SampleClock":
        """The clock of the rows kept (k), few of which were left out: its rate is as it was."""
        return replace(self, time_s=self.time_s[kept], order=self.order[kept])

    def only(self, rows: NDArray[np.intp]) -> "SampleClock":
        """The clock of some of the rows (k), spread evenly."""
        rate_hz = self.rate_hz * len(rows) / len(self.time_s)
        return replace(self, time_s=self.time_s[rows], order=self.order[rows], rate_hz=rate_hz)


def are_of_today(stamps: Floats) -> bool:
    """Whether stamps (n) are of the present day in a unit of which a second has a thousand, or more."""
    low, high = EPOCH_S
    found = stamps[np.isfinite(stamps)]
    return bool(len(found)) and any(
        bool(np.all((found * size > low) & (found * size < high))) for size in (1e-3, 1e-6, 1e-9)
    )


def are_seconds_of_today(stamps: Floats) -> bool:
    """Whether stamps (n) are whole seconds since 1970 of the present day, which many readings may share."""
    low, high = EPOCH_S
    return bool(len(stamps)) and bool(np.all((stamps > low) & (stamps < high) & (stamps % 1 == 0)))


def counted(readings: int, counter: Array | None, rate_hz: float, source: str) -> SampleClock:
    """Without stamps: by a counter of readings (n), or by their places, at a rate."""
    places = np.arange(readings, dtype=float)
    if counter is not None:
        steps = np.diff(np.asarray(counter, float), prepend=float(counter[0]))
        places = np.cumsum(np.where(steps > 0, steps, np.where(np.arange(readings) > 0, 1.0, 0.0)))
    gaps = int(np.count_nonzero(np.diff(places) > 1))
    order = np.arange(readings)
    return SampleClock(places / rate_hz, order, unit="none", inferred=False, rate_hz=rate_hz, source=source, gaps=gaps)


def stamped(
    file: str, stamps: Array, name: str, stated: str, wanted: str | None, rate_hz: float | None = None
) -> SampleClock:
    """By stamps (n). stated: the header's unit; wanted: the person's; rate_hz: as the file states it, to tell the unit.
    Ticks of no unit that makes that rate are counted at it. Errors: SamplesError."""
    unit = wanted or unit_of_name(name, stated)
    of_steps = are_steps(np.asarray(stamps, float))
    if of_steps:
        stamps = np.cumsum(np.asarray(stamps, float))
    inferred = unit is None
    raw = stamps - stamps[0] if stamps.dtype.kind in "iu" else np.asarray(stamps, float)
    raw = np.asarray(raw, float)
    paced = repaired_ticks(raw)
    outliers = int(np.count_nonzero(paced != raw))
    raw, restarts = _continued(paced)
    if unit is None:
        unit = _by_size(raw, float(stamps[0]), rate_hz or TYPICAL_HZ)
        ticks = (raw[-1] - raw[0]) * TIME_UNITS[unit]
        if rate_hz and ticks > 0 and abs((len(raw) - 1) / ticks / rate_hz - 1) > SAME_RATE:
            return counted(len(raw), None, rate_hz, "data")
    time_s = (raw - raw[0]) * TIME_UNITS[unit]
    back = np.diff(time_s) < 0
    if back.sum() > max(BACKWARDS * len(back), 2) and not _shuffled(time_s):
        row = int(np.flatnonzero(back)[0]) + 1
        raise SamplesError("stamps-go-back", file=file, column=name, row=row + 1, rows=int(back.sum()))
    order = np.argsort(time_s, kind="stable")
    time_s = time_s[order] - time_s[order[0]]
    if not time_s[-1] > 0:
        raise SamplesError("stamps-stand-still", file=file, column=name)
    different = 1 + int(np.count_nonzero(np.diff(time_s)))
    if different < FEWEST_STAMPS <= len(time_s) / FEWEST_STAMPS:
        raise SamplesError("stamps-too-few", file=file, column=name, stamps=different, rows=len(time_s))
    time_s = _between_changes(time_s)
    steps = np.diff(time_s)
    middle = float(np.median(steps[steps > 0]))
    gap = steps > max(5 * middle, 0.25)
    found_hz, jitter_s = rate_of(time_s, ~gap)
    return SampleClock(
        time_s,
        order,
        unit,
        inferred,
        found_hz or 1 / middle,
        "data",
        jitter_s,
        int(gap.sum()),
        restarts,
        outliers,
        of_steps,
    )


def are_steps(stamps: Floats) -> bool:
    """Whether a column (n) holds what passed since the reading before, and no stamps: it falls as often as it rises,
    stays about one size, and is not a steady clock in another order."""
    if len(stamps) < LEAST_STEPS or not (np.isfinite(stamps) & (stamps >= 0)).all():
        return False
    middle, (low, high) = float(np.median(stamps)), np.quantile(stamps, (0.05, 0.95))
    if not 0 < high - low <= ABOUT_ONE * middle or stamps.max() > PAUSE_STEPS * middle:
        return False
    rises, falls = (int(np.count_nonzero(sign * np.diff(stamps) > 0)) for sign in (1, -1))
    evenly = falls >= LEAST_CHANGES and falls / AS_OFTEN <= rises <= falls * AS_OFTEN
    return evenly and not (are_of_today(stamps) or are_seconds_of_today(stamps) or _shuffled(stamps))


def _shuffled(time_s: Floats) -> bool:
    """Whether stamps that go back are those of a steady clock in another order: backwards, or by other things."""
    steps = np.diff(np.sort(time_s))
    middle = float(np.median(steps))
    return middle > 0 and bool(np.mean(np.abs(steps - middle) < STEADY * middle) > MOSTLY)


def _between_changes(time_s: Floats) -> Floats:
    """Stamps that stand still for many readings, as whole seconds do: a line from change to change."""
    changes = np.flatnonzero(np.diff(time_s) > 0) + 1
    if len(changes) < LEAST_CHANGES or len(changes) > COARSE * len(time_s):
        return time_s
    places = np.arange(len(time_s))
    step = float((time_s[changes[-1]] - time_s[changes[0]]) / (changes[-1] - changes[0]))
    between = np.interp(places, changes, time_s[changes])
    between = np.where(places < changes[0], time_s[changes[0]] + (places - changes[0]) * step, between)
    between = np.where(places > changes[-1], time_s[changes[-1]] + (places - changes[-1]) * step, between)
    return np.asarray(between - between[0])


def unit_of_name(name: str, stated: str) -> str | None:
    """The unit that a header states beside a name, or at its end: `time_us`, `t [ms]`, `seconds_elapsed`."""
    parts = [stated, *reversed(name.lower().replace("(", " ").replace(")", " ").replace("_", " ").split())]
    parts += [tail for tail in ("us", "ms", "ns") if len(name) > 2 and name.lower().endswith(f"time{tail}")]
    return next((_SPELLINGS[p.strip(" []().").lower()] for p in parts if p.strip(" []().").lower() in _SPELLINGS), None)


def repaired_ticks(raw: Floats) -> Floats:
    """Stamps (n) without single ones far off the pace of the others."""
    low, high = np.quantile(raw, MIDDLE)
    period = float(high - low) / ((MIDDLE[1] - MIDDLE[0]) * len(raw))
    all_one = np.zeros(len(raw), np.intp)
    return corrupt_columns.repaired_stamps(raw, all_one, all_one, FAR_PERIODS * period)


def _continued(raw: Floats) -> tuple[Floats, int]:
    """Stamps without restarts of their clock: after one, time goes on by a usual step."""
    steps = np.diff(raw)
    middle = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    far = np.flatnonzero(steps < -50 * max(middle, 1e-12))
    if not len(far) or len(far) > BACKWARDS * len(raw):
        return raw, 0
    steps[far] = middle
    return np.r_[raw[0], raw[0] + np.cumsum(steps)], len(far)


def likelier_unit(ticks: SampleClock) -> str | None:
    """The unit in which stamps make a usual rate, where in the one that a header states they make one that few sensors
    have; None otherwise."""
    if ticks.source != "data" or ticks.inferred or ticks.unit not in MISLABELLED:
        return None
    if SELDOM_HZ[0] <= ticks.rate_hz <= SELDOM_HZ[1]:
        return None
    rates_hz = {unit: ticks.rate_hz * TIME_UNITS[ticks.unit] / TIME_UNITS[unit] for unit in MISLABELLED}
    return next((unit for unit, hz in rates_hz.items() if USUAL_HZ[0] <= hz <= USUAL_HZ[1]), None)


def _by_size(raw: Floats, first: float, rate_hz: float) -> str:
    """The unit in which stamps are of this day, or come nearest to a rate."""
    steps = np.diff(raw)
    if not (steps > 0).any():
        return "s"
    # A pause, or a first stamp that is stale, may be longer than all the readings took.
    usual = steps[steps <= PAUSE_STEPS * np.median(steps[steps > 0])]
    span = float(usual.sum())
    if not span > 0:
        usual, span = steps, float(raw[-1] - raw[0])
    rates = {unit: len(usual) / (abs(span) * size) for unit, size in TIME_UNITS.items()}
    short = {unit: rates[unit] for unit in ("s", "ms", "us", "ns")}
    fits = {unit: rate for unit, rate in short.items() if LEAST_HZ <= rate <= MOST_HZ}
    fits = fits or {unit: rate for unit, rate in rates.items() if LEAST_HZ <= rate <= MOST_HZ} or rates
    today = [unit for unit in fits if EPOCH_S[0] < first * TIME_UNITS[unit] < EPOCH_S[1]]
    return today[0] if today else min(fits, key=lambda unit: abs(np.log(fits[unit] / rate_hz)))
