"""What header and tiles know from the log: today's count, yield and cycle time, and a unit's earlier attempts."""

import time
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

from station.domain.records.stored_attempt import result
from station.errors import StationError
from station.ports.log_reader import LogReader, Query
from station.web.load_view import DECIDED

#: So often the log is asked, s; between two records it is not asked at all.
_POLL_S = 5.0
#: The cycle time is the mean of so many of the newest units that passed.
_CYCLE_UNITS = 20
#: Of a unit so many attempts are counted at most.
_MOST_ATTEMPTS = 20
NOTHING: dict[str, Any] = {"units": 0, "yield": None, "cycle_s": None}


class LogGlance:
    """Answers from the log, remembered until the log grows. open_log: opens it; Errors of it: answers stay empty."""

    def __init__(self, open_log: Callable[[], LogReader]) -> None:
        self._open = open_log
        self._read_s = -_POLL_S
        self._stamp: tuple[int, int] = (-1, -1)
        self._today = NOTHING
        self._previous: dict[str, dict[str, Any]] = {}
        self._ended: dict[tuple[str, str], str | None] = {}

    def today(self) -> dict[str, Any]:
        """`units` finished since midnight (local time), `yield` of those (share that passed in the end), `cycle_s`."""
        if time.monotonic() - self._read_s > _POLL_S:
            self._read_s = time.monotonic()
            try:
                with self._open() as log:
                    self._read(log)
            except StationError:
                self._today, self._stamp = NOTHING, (-1, -1)
        return self._today

    def previous(self, serial: str) -> dict[str, Any]:
        """`attempts` of the unit so far, and of the newest: `outcome`, `at_s` and its first reason as `reason`."""
        if serial not in self._previous:
            try:
                with self._open() as log:
                    self._previous[serial] = _previous(log, serial)
            except StationError:
                return {"attempts": 0}
        return self._previous[serial]

    def bears_out(self, nest: Mapping[str, Any]) -> bool:
        """Whether the log ended the attempt of a nest as that says (station.live/1).

        So too where nothing is decided, and where the log knows no ended attempt of the unit or cannot be read.
        """
        serial, attempt, outcome = nest["serial"], nest.get("attempt", ""), nest["outcome"]
        if outcome not in DECIDED:
            return True
        if (serial, attempt) not in self._ended:
            try:
                with self._open() as log:
                    self._ended[serial, attempt] = _ended(log, serial, attempt)
            except StationError:
                return True
        return self._ended[serial, attempt] in (None, outcome)

    def forget(self) -> None:
        """A load has begun or ended: what was remembered of units may be another."""
        self._previous.clear()
        self._ended.clear()
        self._read_s = -_POLL_S

    def _read(self, log: LogReader) -> None:
        midnight = datetime.now().astimezone().replace(hour=0, minute=0, second=0, microsecond=0)
        stamp = (log.head().number, int(midnight.timestamp()))
        if stamp == self._stamp:
            return
        self._stamp = stamp
        found = log.yields(Query(since_ns=stamp[1] * 10**9))
        recent = log.recent(_CYCLE_UNITS, 0)
        whole = found[0] if found else None
        self._today = {
            "units": whole.final if whole else 0,
            "yield": round(whole.final_yield, 4) if whole and whole.final else None,
            "cycle_s": None if recent.cycle_s is None else round(recent.cycle_s, 1),
        }


def _ended(log: LogReader, serial: str, attempt: str) -> str | None:
    """How that attempt ended, '' where it did not; None where none of the unit's has."""
    found = {a.attempt: a.outcome for a in log.attempts(Query(serial=serial), _MOST_ATTEMPTS) if a.outcome is not None}
    return str(found.get(attempt, "")) if found else None


def _previous(log: LogReader, serial: str) -> dict[str, Any]:
    found = [a for a in log.attempts(Query(serial=serial), _MOST_ATTEMPTS) if a.outcome is not None]
    if not found:
        return {"attempts": 0}
    newest = found[0]
    verdict = result(log.attempt(newest), "verdict") or {}
    reasons = verdict.get("reasons") or []
    shown = {"attempts": len(found), "outcome": newest.outcome or "", "at_s": newest.started_ns / 1e9}
    return {**shown, "reason": reasons[0] if reasons else None}
