"""A log against the heads that are kept of it: checked at each opening, renewed after each commit."""

import json
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from station.adapters.store import anchor, file, keys
from station.adapters.store.anchor import AnchorPlace
from station.domain.records.head import AnchorFinding, SealedHead
from station.domain.records.json_object import json_object
from station.domain.records.tree_head import WITNESSED_EVENT, log_end
from station.files.system_errors import os_error_reason
from station.messages import Message

#: Beyond this, a clock that was set back stops the run; a smaller step of over a minute is an event.
MOST_CLOCK_BACK_NS, NOTED_CLOCK_BACK_S = 24 * 3600 * 10**9, 60.0
#: Event of the station that names the places where heads are kept from here on.
PLACES_EVENT = "anchors"
#: Event by which an engineer takes note of what the heads say against the log, with a reason.
ACKNOWLEDGED_EVENT = "log-acknowledged"


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Who goes on with a log that its heads speak against, and why."""

    by: str
    reason: str


class StoredLogEnd:
    """What an open log says of itself to a head (domain.records.head.LogEnd)."""

    def __init__(self, connection: sqlite3.Connection, log_id: str) -> None:
        self._connection, self.log_id = connection, log_id
        self.number = file.newest(connection, log_id)[0]
        self.verify: Callable[[int, bytes, bytes], bool] | None = None
        if keys.signs_heads(connection):
            self.verify = keys.schedule(connection, log_id).check

    def seal(self, number: int) -> bytes | None:
        """The seal of that record."""
        return file.seal_of(self._connection, number)

    def finishes_beyond(self, number: int) -> int:
        """How many attempts ended after that record."""
        return int(self._connection.execute("SELECT count(*) FROM finish WHERE seq > ?", (number,)).fetchone()[0])


@dataclass(slots=True)
class LogAnchors:
    """The places of one log. faults: why the newest head could not be kept, by place."""

    places: Sequence[AnchorPlace]
    faults: dict[str, Message] = field(default_factory=dict)

    def check(self, connection: sqlite3.Connection, log_id: str) -> list[AnchorFinding]:
        """What they say against the log."""
        return anchor.compare(self.places, StoredLogEnd(connection, log_id), known_places(connection))

    def end_known_to(self, place: AnchorPlace | None) -> str:
        """The end of the log whose head a place keeps; "" where it cannot be reached or keeps none."""
        try:
            head = place.read() if place else None
        except (OSError, ValueError):
            return ""
        return log_end(head.log_id, head.number, head.hash) if head else ""

    def keep(self, head: SealedHead, *, durable: bool) -> list[str]:
        """Writes the head everywhere; the names of places where that failed for the first time."""
        failed = []
        for place in self.places:
            try:
                place.write(head, durable=durable)
            except OSError as error:
                failed += [place.name] if place.name not in self.faults else []
                self.faults[place.name] = os_error_reason(error)
            else:
                if durable or not place.lags:
                    self.faults.pop(place.name, None)
        return failed


def known_places(connection: sqlite3.Connection) -> frozenset[str]:
    """Names of the folders in which heads of this log were kept when it was last opened."""
    newest = _newest_event(connection, PLACES_EVENT)
    return frozenset(newest.get("places", ())) if newest else frozenset()


def last_witnessed(connection: sqlite3.Connection) -> int:
    """The number of the newest record that holds a witness' receipt; 0 where there is none."""
    query = "SELECT coalesce(max(seq), 0) FROM event WHERE attempt IS NULL AND kind = ?"
    return int(connection.execute(query, (WITNESSED_EVENT,)).fetchone()[0])


def acknowledgements(connection: sqlite3.Connection) -> list[dict[str, Any]]:
    """Every time that somebody went on with a log against its heads: at_ns, by, reason, findings; oldest first."""
    query = "SELECT at_ns, detail FROM event WHERE attempt IS NULL AND kind = ? ORDER BY seq"
    return [{"at_ns": at_ns} | json.loads(detail) for at_ns, detail in connection.execute(query, (ACKNOWLEDGED_EVENT,))]


def detail_of(acknowledgement: Acknowledgement, found: Sequence[AnchorFinding]) -> Mapping[str, Any]:
    """As the log seals it."""
    rows = [{"what": f.what, "place": f.place, "number": f.number, "message": f.message.document()} for f in found]
    return {"by": acknowledgement.by, "reason": acknowledgement.reason, "findings": rows}


def _newest_event(connection: sqlite3.Connection, kind: str) -> dict[str, Any] | None:
    query = "SELECT detail FROM event WHERE attempt IS NULL AND kind = ? ORDER BY seq DESC LIMIT 1"
    row = connection.execute(query, (kind,)).fetchone()
    try:
        return json_object(row[0]) if row else None
    except ValueError:
        return None


def check_clock(connection: sqlite3.Connection, now_ns: int) -> list[AnchorFinding]:
    """A clock that stands far before the newest attempt since somebody last took note of it."""
    newest = _newest_start(connection)
    if newest is None or now_ns >= newest[1] - MOST_CLOCK_BACK_NS:
        return []
    behind_h = (newest[1] - now_ns) / 3.6e12
    return [AnchorFinding("clock-back", "clock", newest[0], Message("clock-back", hours=behind_h, number=newest[0]))]


def clock_step_s(connection: sqlite3.Connection, now_ns: int) -> float:
    """By how many seconds the clock stands before the newest attempt's beginning; 0 where it does not."""
    newest = _newest_start(connection)
    return 0.0 if newest is None else max(0.0, (newest[1] - now_ns) / 1e9)


def _newest_start(connection: sqlite3.Connection) -> tuple[int, int] | None:
    """Number and beginning of the latest attempt after the newest acknowledgement."""
    since = "SELECT coalesce(max(seq), 0) FROM event WHERE attempt IS NULL AND kind = ?"
    query = f"SELECT seq, started_ns FROM attempt WHERE seq > ({since}) ORDER BY started_ns DESC LIMIT 1"
    row = connection.execute(query, (ACKNOWLEDGED_EVENT,)).fetchone()
    return None if row is None else (int(row[0]), int(row[1]))
