"""What a screen shows of `station line`: its outer state, lamps and counts, while its process lives."""

import time
from pathlib import Path
from typing import Any

from station.domain.cell.lamps import lamps
from station.domain.cell.packml import State
from station.panel_protocol.line_state import read_line_state
from station.wiring.line_servers import is_alive

#: So often the line's file is read, s.
LINE_POLL_S = 0.2
#: Lamps of a line in the order in which they matter to who stands before it → colour of the page's stack light.
_COLOURS = {"red": "red", "blue": "blue", "yellow": "amber", "green": "green", "white": "white"}


class LineGlance:
    """Looks at the line's file, at most every LINE_POLL_S."""

    def __init__(self, database: Path) -> None:
        self._database = database
        self._read_s = -LINE_POLL_S
        self._shown: dict[str, Any] = {}

    def shown(self) -> dict[str, Any]:
        """state, lamp, load, loads, held_s, why (a message's document or None); empty where no line runs."""
        now_s = time.monotonic()
        if now_s - self._read_s > LINE_POLL_S:
            self._read_s = now_s
            self._shown = self._read()
        return self._shown

    def _read(self) -> dict[str, Any]:
        found = read_line_state(self._database)
        if found is None or not is_alive(int(found["pid"])):
            return {}
        lit = lamps(State(found["state"]))
        return {
            "state": str(found["name"]),
            "lamp": next(colour for lamp, colour in _COLOURS.items() if lamp in lit),
            "load": int(found["load"]),
            "loads": int(found["loads"]),
            "why": found.get("why"),
        }
