"""What every screen shows at one instant belongs together, whoever scans meanwhile."""

from pathlib import Path

from station.config.settings import load_settings
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.queue import LoadQueue, QueueState, WaitingUnit
from station.web.run_launcher import LaunchOptions, RunLauncher
from station.web.screen import Screen
from station.wiring.jobs import load_job

NESTS = ("A", "B", "C", "D")


class BusyQueue(LoadQueue):
    """After each look at it, another page scans a unit."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._other = LoadQueue(path)

    @property
    def state(self) -> QueueState:
        found = super().state
        free = [nest for nest in NESTS if nest not in found.waiting]
        self._other.put({nest: WaitingUnit(f"SN{nest}") for nest in free[:1]})
        return found


def test_a_unit_scanned_during_a_look_is_shown_everywhere_or_nowhere(tmp_path: Path) -> None:
    database = tmp_path / "s.db"
    runs = RunLauncher(LaunchOptions(database=database, recipe="six-point", simulate=True))
    job, _ = load_job("six-point")
    queue = BusyQueue(companion_file(database, Companion.QUEUE))
    screen = Screen(load_settings(), job.recipe, runs, queue)
    for _ in NESTS:
        screen._looked_s = 0.0
        shown = screen.shown()
        in_nests = {n: shown[f"nest {n}"]["serial"] for n in NESTS if shown[f"nest {n}"]["serial"]}
        assert in_nests == shown["waiting"]
        assert shown["view"]["turn"] == next((n for n in NESTS if n not in in_nests), "")
        if len(in_nests) == len(NESTS):
            break
    assert queue.state.serials
