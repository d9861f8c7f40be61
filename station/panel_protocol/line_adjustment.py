"""What a line controller adjusts of a running line, in a small file beside the log. What lay there before is void."""

import json
import time
from collections.abc import Mapping
from pathlib import Path

from station.domain.cell.adjustment import ADJUSTABLE, LineAdjustment, UnitMode
from station.files.json_text import NOT_AS_EXPECTED, read_json
from station.files.replace import replace_text
from station.panel_protocol.companion import Companion, companion_file

ADJUSTMENT_SCHEMA = "station.line-adjustment/1"


def send_line_adjustment(database: Path, adjustment: LineAdjustment) -> None:
    """Leaves it for the line, all of it: it replaces what was adjusted before. Errors: OSError."""
    document = {
        "schema": ADJUSTMENT_SCHEMA,
        "number": time.time_ns(),
        "mode": adjustment.mode.label,
        "times_s": dict(adjustment.times_s),
    }
    replace_text(companion_file(database, Companion.LINE_ADJUSTMENT), json.dumps(document, allow_nan=False))


class LineAdjustments:
    """Adjustments as they come."""

    def __init__(self, database: Path) -> None:
        self._path = companion_file(database, Companion.LINE_ADJUSTMENT)
        self._last = self._read()[0]

    def next(self) -> LineAdjustment | None:
        """A new one; None where there is none, or what is there is none."""
        number, found = self._read()
        if number == self._last:
            return None
        self._last = number
        return found

    def _read(self) -> tuple[int, LineAdjustment | None]:
        try:
            document = read_json(self._path)
            mode = UnitMode[str(document["mode"]).upper()]
            return int(document["number"]), LineAdjustment(mode, _times(document["times_s"]))
        except (OSError, *NOT_AS_EXPECTED):
            return 0, None


def _times(document: Mapping[str, object]) -> dict[str, float]:
    """Those within their limits. Errors: NOT_AS_EXPECTED."""
    limits = {time_.name: time_ for time_ in ADJUSTABLE.values()}
    given = {name: float(str(value)) for name, value in document.items()}
    return {n: s for n, s in given.items() if limits[n].least_s <= s <= limits[n].most_s}
