"""Which column is time, or counts the readings: by its name first, by its content where names do not tell."""

import re

import numpy as np

from station.domain.core.types import Array, Floats
from station.domain.recognition import clock
from station.domain.recognition.raw_table import RawColumn, RawTable

NAMES = re.compile(
    r"time(?!s_)|zeit|stamp|epoch|elapsed|seconds|^ts$|^t$|^t[ _]?[(\[]?(s|sec|ms|us|ns)[)\]]?$|^utc$"
    r"|^(s|sec|secs|ms|msec|us|usec|ns|nsec)$|millis|micros|时间"
    r"|^(tiempo|tempo|temps|czas|tid|tijd|время|aika)($|[ _(\[])",
    re.IGNORECASE,
)
_UNIT = re.compile(r"_?(s|ms|us|ns)$")
_COUNTER = re.compile(r"sample|index|count|frame|^n$|^i$|^no$|^nr$|^#$|^seq|序号", re.IGNORECASE)
#: Units of stamps.
TIME_UNITS = ("s", "ms", "us", "ns")
#: A column of at least so many steps is time where this share of them is within this share of the median step.
LEAST_STEPS, STEADY, MOSTLY = 50, 0.8, 0.5
#: A recording of fewer milliseconds shows no rest.
FEWEST_MS = 4000
#: Names of what passed since the reading before.
_STEPS = re.compile(r"^d_?t$|^(delta|diff)_?t(ime)?$|^t(ime)?_?(delta|diff|step)$|^interval", re.IGNORECASE)


def find(table: RawTable, assigned: set[int | None]) -> int | None:
    """The column of time: named so or, without names, the first that never falls; by its steady steps where
    its name is of no known language."""
    free = [i for i in table.numeric() if i not in assigned]
    named = [i for i in free if table.named and NAMES.search(table.columns[i].name)]
    rising = [i for i in named if _rises(table.columns[i].values)]
    if rising:
        return min(rising, key=lambda i: _unlikeness(table, i))
    # A column called travel time or uptime that falls is none where stamps of another name do not.
    in_time = [i for i in free if table.columns[i].unit in TIME_UNITS and _rises(table.columns[i].values)]
    if in_time:
        return in_time[0]
    if named:
        return named[0]
    if table.named:
        counted = [i for i in free if _COUNTER.search(table.columns[i].name) and _rises(table.columns[i].values)]
        steady = (i for i in free[:2] if _is_steady_clock(table.numbers(i)))
        steps = (i for i in free if _is_step(table.columns[i]))
        return counted[0] if counted else next(iter([*steady, *steps]), None)
    return _without_names(table, free)


def _is_step(column: RawColumn) -> bool:
    return _STEPS.search(_UNIT.sub("", column.name)) is not None and clock.are_steps(np.asarray(column.values, float))


def _without_names(table: RawTable, free: list[int]) -> int | None:
    """The first of the two columns in front that rises; a steady clock or stamps of today behind them, where that one
    now and then stands still or falls, as a coarse reading does."""
    rising = [i for i in free[:2] if _rises(table.columns[i].values)]
    if rising and (np.diff(table.numbers(rising[0])) > 0).all():
        return rising[0]
    steady = [i for i in free if _is_steady_clock(table.numbers(i)) and not is_counter(table.columns[i], named=False)]
    today = [i for i in free[2:] if clock.are_of_today(table.numbers(i)) and _rises(table.columns[i].values)]
    return next(iter([*steady, *rising, *today]), None)


def unread_time(table: RawTable) -> RawColumn | None:
    """The column of text that is named like time, whose stamps nobody could read."""
    texts = [c for c in table.columns if c.text is not None and table.named and NAMES.search(c.name)]
    return next((c for c in texts if c.text is not None and len(c.text.names) > LEAST_STEPS), None)


def _is_steady_clock(values: Floats) -> bool:
    """Whether a column that no name calls time rises at every row, most often by about one step, as no
    reading does."""
    if len(values) <= LEAST_STEPS or not np.isfinite(values).all():
        return False
    apart = np.diff(clock.repaired_ticks(values))
    if not (apart > 0).all():
        return False
    middle = float(np.median(apart))
    return bool(np.mean(np.abs(apart - middle) < STEADY * middle) > MOSTLY)


def counter(table: RawTable, assigned: list[int]) -> int | None:
    """The column whose name says that it counts readings."""
    free = [i for i in table.numeric() if i not in assigned and table.named]
    found = [i for i in free if _COUNTER.search(table.columns[i].name) and _rises(table.columns[i].values)]
    return found[0] if found else None


def _unlikeness(table: RawTable, place: int) -> tuple[bool, bool, float]:
    """What speaks against a rising column that is named so: that it counts, by its name or from row to row, and that
    it stands still."""
    column = table.columns[place]
    return is_counter(column, named=True), is_counter(column, named=False), _coarseness(table.numbers(place))


def _coarseness(values: Floats) -> float:
    """Share of readings that have the stamp of the one before."""
    return round(float(np.mean(np.diff(values) == 0)), 2) if len(values) > 1 else 0.0


def _rises(values: Array | None) -> bool:
    if values is None or len(values) < 3:
        return False
    numbers = np.asarray(values, float)
    apart = np.diff(numbers)
    seldom = 0.0 if clock.are_seconds_of_today(numbers) and (apart > 0).sum() >= clock.LEAST_CHANGES else 0.05
    return bool(np.mean(apart < 0) < 0.1 and np.mean(apart > 0) > seldom)


def _numbers_readings(column: RawColumn) -> bool:
    """Whether a column that is called time goes from 0 or 1 on by one, over fewer readings than make a recording where
    they are milliseconds."""
    values = np.asarray(column.values, float)
    if clock.unit_of_name(column.name, column.unit) is not None or len(values) > FEWEST_MS:
        return False
    return bool(values[0] in (0, 1) and len(values) > 2 and (np.diff(values) == 1).all())


def is_counter(column: RawColumn, named: bool) -> bool:
    """Whether a rising column counts readings and is no time."""
    if column.values is None or column.unit:
        return False
    if named and NAMES.search(column.name) and not _COUNTER.search(column.name):
        return _numbers_readings(column)
    apart = np.diff(np.asarray(column.values, float))
    return bool(len(apart)) and bool(np.mean(apart == 1) > 0.9)
