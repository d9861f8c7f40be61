"""Retentive memory of a simulated PLC as a file, replaced whole: what a power failure leaves."""

import json
from pathlib import Path

from station.adapters.simulated_plc.loads import CellLoads, Handed
from station.files.replace import replace_text


class RetentiveFile:
    """starts: how often the PLC has started, this time included. The parts lie where they lie: nests are kept too."""

    def __init__(self, path: Path) -> None:
        self._path, self._stored = path, ""
        self.starts = 1

    def restore(self, loads: CellLoads) -> None:
        """What was kept, into the cell. A file that is not there is an empty memory."""
        if not self._path.exists():
            return
        found = json.loads(self._path.read_text(encoding="utf-8"))
        loads.nests, loads.load = tuple(found["nests"]), found["load"]
        loads.taken, loads.bins_taken = found["taken"], found["bins_taken"]
        loads.handed = [Handed(h["load"], tuple(h["serials"]), h["bins"]) for h in found["handed"]]
        self.starts = found["starts"] + 1

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
