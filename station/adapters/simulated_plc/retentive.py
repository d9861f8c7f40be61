"""Retentive memory of a simulated PLC as a file, replaced whole: what a power failure leaves."""

import json
from pathlib import Path

from station.adapters.simulated_plc.loads import CellLoads, Handed
from station.errors import ConfigError
from station.files.replace import replace_text


class RetentiveFile:
    """starts: how often the PLC has started, this time included. The parts lie where they lie: nests are kept too."""

    def __init__(self, path: Path) -> None:
        self._path, self._stored = path, ""
        self.starts = 1

    def restore(self, loads: CellLoads) -> None:
        """What was kept, into the cell. A file that is not there is an empty memory. Errors: ConfigError."""
        if not self._path.exists():
            return
        try:
            found = json.loads(self._path.read_text(encoding="utf-8"))
            nests, load, taken, bins_taken = (found[name] for name in ("nests", "load", "taken", "bins_taken"))
            handed = [Handed(h["load"], tuple(h["serials"]), h["bins"]) for h in found["handed"]]
            starts = int(found["starts"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as exc:
            raise ConfigError("plc-memory-damaged", file=str(self._path)) from exc
        loads.nests, loads.load, loads.taken, loads.bins_taken = tuple(nests), int(load), taken, bins_taken
        loads.handed, self.starts = handed, starts + 1

    def keep(self, loads: CellLoads) -> None:
        """Writes it where it has changed."""
        handed = [{"load": h.load, "serials": h.serials, "bins": h.bins} for h in loads.handed]
        text = json.dumps(
            {
                "nests": loads.nests,
                "load": loads.load,
                "taken": loads.taken,
                "bins_taken": loads.bins_taken,
                "handed": handed,
                "starts": self.starts,
            }
        )
        if text != self._stored:
            self._stored = text
            replace_text(self._path, text)
