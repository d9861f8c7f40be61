"""Texts that are times: of day, with a date in any order of marks, of a stopwatch → seconds."""

import re
from datetime import date

import numpy as np

from station.domain.core.types import Array, Floats

#: A time of day, with what may stand before and behind it.
_CLOCK = re.compile(
    r"^(?:.*[ T])?(\d{1,2}):(\d{2}):(\d{2}(?:[.,:]\d+)?) ?(?:([AP])M)?"
    r"(?:Z|[+-]\d{2}:?\d{2}| ?[A-Z]{3,4}| \d{4})?(?: ?\[[\w/+-]+\])?$",
    re.IGNORECASE,
)
_STOPWATCH = re.compile(r"^(\d{1,4}):(\d{2}[.,]\d+)$")
#: Year, month, day, hour, minute and second with any marks or none between.
_COMPACT = re.compile(
    r"^((?:19|20)\d\d)[-_/.]?(0[1-9]|1[0-2])[-_/.]?(0[1-9]|[12]\d|3[01])[-_ T.]?"
    r"([01]\d|2[0-3])[-_.:h]?([0-5]\d)[-_.:m]?([0-5]\d)[-_.,:]?(\d{0,9})s?Z?$"
)
#: Whole numbers that are such a date have so many digits.
DIGITS = (14, 17, 20)


def are_stamps(cells: list[str]) -> bool:
    return bool(cells) and all(_seconds_or_none(c.strip()) is not None for c in cells)


def seconds(cells: Array) -> Floats:
    """Seconds (n) since midnight, or since New Year where a date stands without marks; NaN where it is no time."""
    found = (_seconds_or_none(str(c).strip()) for c in cells)
    return np.array([np.nan if s is None else s for s in found], float)


def are_dates(values: Array) -> bool:
    """Whether whole numbers are years, months, days, hours, minutes and seconds in one: 20240305145930123."""
    if values.dtype.kind not in "iu" or not len(values):
        return False
    sample = [str(v) for v in values[:200].tolist()]
    return all(len(s) in DIGITS for s in sample) and are_stamps(sample)


def _seconds_or_none(cell: str) -> float | None:
    if found := _CLOCK.match(cell):
        hours = int(found[1]) % 12 + (12 if found[4].upper() == "P" else 0) if found[4] else int(found[1])
        return hours * 3600 + int(found[2]) * 60 + float(found[3].replace(",", ".").replace(":", "."))
    if found := _STOPWATCH.match(cell):
        return int(found[1]) * 60 + float(found[2].replace(",", "."))
    if found := _COMPACT.match(cell):
        year, month, day, hours, minutes, whole = (int(found[i]) for i in range(1, 7))
        try:
            days = date(year, month, day).toordinal() - date(year, 1, 1).toordinal()
        except ValueError:
            return None
        return days * 86_400 + hours * 3600 + minutes * 60 + whole + float(f"0.{found[7] or 0}")
    return None
