"""What a line tells those who serve or show its state, and what they tell it: two small files beside the log."""

import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from station.domain.cell.adjustment import UnitMode
from station.domain.cell.handover import Bin, LoadJournal
from station.domain.cell.packml import Command, State
from station.domain.cell.state_times import StateTimes
from station.domain.cell.stop_reasons import StopReason, after_change
from station.domain.cell.unit_counts import UnitCounts
from station.files.json_text import NOT_AS_EXPECTED, read_json
from station.files.replace import replace_text
from station.messages import Message
from station.panel_protocol.companion import Companion, companion_file

STATE_SCHEMA, COMMAND_SCHEMA = "station.line/1", "station.line-command/1"


class LineStateWriter:
    """Writes the file of Companion.LINE. The log is the record and this only a view of it: where it cannot be written,
    nothing stops. outcomes: of the present load, by serial; counts, mode, times_s, ideal_s: as the line has them."""

    def __init__(self, database: Path, station: str, recipe: str, nests: tuple[str, ...]) -> None:
        self._path = companion_file(database, Companion.LINE)
        self._head = {"schema": STATE_SCHEMA, "pid": os.getpid(), "station": station, "recipe": recipe}
        self._nests = nests
        self._reasons: tuple[StopReason, ...] = ()
        self.outcomes: dict[str, str] = {}
        self.counts = UnitCounts()
        self.mode = UnitMode.PRODUCE
        self.times_s: Mapping[str, float] = {}
        self.ideal_s = 0.0

    def write(self, times: StateTimes, journal: LoadJournal, loads: int, why: Message | None, now_s: float) -> None:
        """The line as it is now; now_s: on the clock of `times`."""
        at_s = time.time()
        self._reasons = after_change(self._reasons, times.state, why, at_s)
        serials = {p.nest: p.serial for p in journal.open.places} if journal.open else {}
        document = {
            **self._head,
            "at_s": at_s,
            "state": int(times.state),
            "name": times.state.label,
            "why": why.document() if why else None,
            "load": journal.open.load if journal.open else 0,
            "loads": loads,
            "nests": [
                {"nest": n, "serial": serials.get(n, ""), "outcome": self.outcomes.get(serials.get(n, ""), "")}
                for n in self._nests
            ],
            "seconds": {s.label: round(times.total_s(s, now_s), 3) for s in State if times.entries.get(s)},
            "entries": {s.label: count for s, count in times.entries.items()},
            "mode": int(self.mode),
            "times_s": dict(self.times_s),
            "ideal_s": self.ideal_s,
            "units": {b.name.lower(): [self.counts.since_start.get(b, 0), self.counts.total(b)] for b in Bin},
            "units_per_hour": self.counts.per_hour,
            "stop_reasons": [
                {"why": r.why.document(), "state": int(r.state), "began_s": r.began_s, "ended_s": r.ended_s}
                for r in self._reasons
            ],
        }
        with suppress(OSError):
            replace_text(self._path, json.dumps(document, allow_nan=False))


def read_line_state(database: Path) -> dict[str, Any] | None:
    """The line's last word; None where it has said nothing, or nothing in the shape of LineStateWriter."""
    try:
        found: dict[str, Any] = read_json(companion_file(database, Companion.LINE))
        whole = found["schema"] == STATE_SCHEMA and isinstance(found["name"], str) and isinstance(found["nests"], list)
        numbers = [found["pid"], found["load"], found["loads"], State(found["state"])]
    except (OSError, *NOT_AS_EXPECTED):
        return None
    whole = whole and all(isinstance(number, int) and 0 <= number < 2**31 for number in numbers)
    return found if whole and found["pid"] else None


def send_line_command(database: Path, command: Command) -> None:
    """Leaves a command for the line. Errors: OSError."""
    document = {"schema": COMMAND_SCHEMA, "number": time.time_ns(), "command": command.label}
    replace_text(companion_file(database, Companion.LINE_COMMAND), json.dumps(document))


class LineCommands:
    """Commands as they come; what lay there before the line began is void."""

    def __init__(self, database: Path) -> None:
        self._path = companion_file(database, Companion.LINE_COMMAND)
        self._last = self._read()[0]

    def next(self) -> Command | None:
        """A new command; None where there is none. An unknown word is none."""
        number, name = self._read()
        if number == self._last:
            return None
        self._last = number
        return next((c for c in Command if c.label == name), None)

    def _read(self) -> tuple[int, str]:
        try:
            document = read_json(self._path)
            return int(document["number"]), str(document["command"])
        except (OSError, ValueError, KeyError, TypeError):
            return 0, ""
