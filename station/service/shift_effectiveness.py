"""Effectiveness of the line's shifts, from the events that it left in the log."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from station.domain.cell.effectiveness import Effectiveness, Made, by_shift
from station.domain.cell.packml import State
from station.domain.cell.state_times import stays
from station.ports.log_reader import Attempt, EventRecord, LogReader, Query

#: Kinds of the station's events: each change of the outer state; the start of a line, with its shifts.
STATE_EVENT, START_EVENT = "packml", "line-started"
#: So many changes and attempts are looked at.
MOST_CHANGES, MOST_ATTEMPTS = 20_000, 5_000


def shift_effectiveness(log: LogReader, query: Query) -> tuple[Effectiveness, ...]:
    """One entry a shift since the query's beginning; none where no line ran. Errors: LogError."""
    starts = log.station_events(START_EVENT, 1)
    if not starts:
        return ()
    settings = json.loads(starts[-1].detail)
    changes = state_changes(
        log.station_events(STATE_EVENT, MOST_CHANGES), log.station_events(START_EVENT, MOST_CHANGES)
    )
    since_s = (query.since_ns or 0) / 1e9
    attempts = log.attempts(query, MOST_ATTEMPTS)
    ended = [a.ended_ns / 1e9 for a in attempts if a.ended_ns is not None]
    until_s = max([*(at_s for at_s, _ in changes), *ended], default=0.0)
    found = [stay for stay in stays(changes, until_s) if stay.until_s >= since_s]
    return tuple(
        by_shift(
            found,
            made(attempts),
            3600.0 * settings["shift_h"],
            3600.0 * settings["shift_begins_h"],
            float(settings["ideal_s"]),
        )
    )


def state_changes(entered: Sequence[EventRecord], starts: Sequence[EventRecord]) -> list[tuple[float, State]]:
    """Changes in their order. A line that died in the middle of a state was in it up to its last word, then aborted."""
    marks: list[tuple[int, int, Mapping[str, Any], bool]] = [
        *((e.number, e.at_ns, json.loads(e.detail), False) for e in entered),
        *((e.number, e.at_ns, json.loads(e.detail), True) for e in starts),
    ]
    found: list[tuple[float, State]] = []
    for _, at_ns, detail, begins in sorted(marks, key=lambda mark: mark[0]):
        state = State(detail["state"])
        if begins and state is State.ABORTED and found:
            found.append((found[-1][0], State.ABORTED))  # nobody knows how long it still worked
        found.append((at_ns / 1e9, state))
    return found


def made(attempts: Sequence[Attempt]) -> list[Made]:
    """Finished attempts, newest first as the log gives them; the oldest of a serial among them counts as its first."""
    first: dict[str, str] = {a.serial: a.attempt for a in attempts if a.outcome is not None}
    return [
        Made(a.ended_ns / 1e9, passed=a.outcome == "PASS", first=first[a.serial] == a.attempt)
        for a in attempts
        if a.outcome is not None and a.ended_ns is not None
    ]
