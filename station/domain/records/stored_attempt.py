"""Looks into a stored attempt: the document that a log reader makes of everything kept of it."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

#: What the software of an attempt ends with when rig and devices were simulated.
SIMULATED = "+simulated"
#: What the encoders of the fixture's axes read at a visit: a key of its statistics, degrees, outer axis first.
AXIS_ANGLES = "axis_angles_deg"
#: Kind of the event that holds a person's signature under an attempt.
SIGNED = "signed"


#: The mark of what was simulated, in every file that leaves the log.
MARK = "SIMULATED"


def is_simulated(software: str) -> bool:
    """Whether rig and devices were simulated, by an attempt's software."""
    return software.endswith(SIMULATED)


def mark_of(software: str) -> str:
    """MARK, or nothing for what is real."""
    return MARK if is_simulated(software) else ""


def result(stored: Mapping[str, Any], name: str) -> Any:
    """The newest result of that name in a stored attempt, or None."""
    return next((r["document"] for r in reversed(stored["results"]) if r["name"] == name), None)


def signatures(stored: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Who signed a stored attempt, oldest first: at_ns, by, role, meaning, comment; record and seal of the end."""
    return [{"at_ns": e["at_ns"], **e["detail"]} for e in stored["events"] if e["kind"] == SIGNED]


def utc(time_ns: int) -> str:
    """A time stamp for a person, UTC; time_ns: since 1970."""
    return datetime.fromtimestamp(time_ns / 1e9, UTC).isoformat(timespec="milliseconds")


def utc_day(time_ns: int) -> str:
    """The ISO day that due dates, records and certificates count by, the same wherever a station stands."""
    return utc(time_ns)[:10]
