"""`python -m tests.fakes.slow_fixture FOLDER`: `station run` with a positioner in real time that tells its deeds.

FOLDER/deeds gets a line for each deed as it begins and ends: moving, moved, parking, parked.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

from station.adapters.positioner.simulated import SimulatedPositioner
from station.cli import app

MOVE_S, PARK_S = 0.4, 0.7


def slow(deed: str, done: str, lasts_s: float, call: Callable[..., None], actions: Path) -> Callable[..., None]:
    """The call, taking so long and told in the file."""

    def slowly(*args: object) -> None:
        _say(actions, deed)
        until_s = time.monotonic() + lasts_s
        while time.monotonic() < until_s:  # as a drive that is polled: a signal does not shorten it
            time.sleep(0.02)
        call(*args)
        _say(actions, done)

    return slowly


def _say(actions: Path, line: str) -> None:
    with actions.open("a") as file:
        file.write(line + "\n")


def main() -> None:
    """See the top of the file."""
    folder = Path(sys.argv[1])
    actions = folder / "deeds"
    SimulatedPositioner.move = slow("moving", "moved", MOVE_S, SimulatedPositioner.move, actions)  # type: ignore[method-assign]
    SimulatedPositioner.park = slow("parking", "parked", PARK_S, SimulatedPositioner.park, actions)  # type: ignore[method-assign]
    log, devices = str(folder / "station.db"), str(folder / "devices")
    app.main(["run", "--simulate", "--serial", "SN0001", "--db", log, "--device-state", devices])


if __name__ == "__main__":
    main()
