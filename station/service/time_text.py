"""Times as people write and read them: one meaning in the command line and on the page, local with the zone's name."""

import math
from datetime import UTC, datetime, timedelta

#: Nanoseconds in 64 bits reach so far from 1970.
FURTHEST_TIME_S = 9.2e9
_AGE_UNITS = {"m": "minutes", "h": "hours", "d": "days", "w": "weeks"}
_DAY_LENGTH = len("2026-11-21")


class NoTime(ValueError):
    """The text is no time."""


def parse_ns(text: str, *, end: bool) -> int:
    """`2026-11-21`, `2026-11-21T13:00` or `7d` ago, since 1970 in ns; local time unless it names a zone.

    end: the text ends a span, and a day counts whole then. Errors: NoTime, OverflowError.
    """
    moment = _moment(text.strip())
    try:
        if end and len(text.strip()) == _DAY_LENGTH:
            moment += timedelta(days=1)
        since_1970_s = moment.astimezone().timestamp()
    except (OverflowError, ValueError):
        since_1970_s = math.inf
    if not abs(since_1970_s) < FURTHEST_TIME_S:
        raise OverflowError(text)
    return int(since_1970_s * 1e9)


def _moment(text: str) -> datetime:
    if text[-1:] in _AGE_UNITS and text[:-1].isdecimal() and len(text) < 8:
        return datetime.now().astimezone() - timedelta(**{_AGE_UNITS[text[-1]]: int(text[:-1])})
    try:
        return datetime.fromisoformat(text)
    except ValueError as exc:
        raise NoTime(text) from exc


def local(time_ns: int) -> str:
    """A time for a person: local, with the zone, and UTC beside it where that is another time."""
    moment = datetime.fromtimestamp(time_ns / 1e9, UTC)
    here = moment.astimezone()
    if not here.utcoffset():
        return f"{here:%Y-%m-%d %H:%M:%S %Z}"
    return f"{here:%Y-%m-%d %H:%M:%S %Z} ({moment:%H:%M:%S} UTC)"


def local_short(time_ns: int) -> str:
    """The same without UTC, for a column whose head names the zone."""
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC).astimezone():%Y-%m-%d %H:%M:%S}"


def zone() -> str:
    """Name of the local zone."""
    return datetime.now().astimezone().tzname() or "UTC"
