"""`station run`, stopped by real signals from a chosen instant on, as often as one presses, and what came of it."""

import contextlib
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.clock import VirtualClock
from station.adapters.positioner.simulated import SimulatedPositioner
from station.adapters.store.sqlite import SqliteStore
from station.cli.app import main
from tests.fakes.fixture_run import Ran, serials

#: Where the station meets the world: every call of these is an instant, the sleeps inside moves and parking too.
INSTANTS: tuple[tuple[type, tuple[str, ...]], ...] = (
    (CanopenDevice, ("upload", "download", "nmt", "wait_boot_up")),
    (SimulatedPositioner, ("move", "park")),
    (SqliteStore, ("begin", "event", "visit", "write", "result", "finish")),
    (VirtualClock, ("sleep",)),
)


@dataclass(slots=True)
class Presses:
    """Presses at the calls from number `at` on, until `left` is used up; calls: how many there were; fixture: what the
    positioner did, in order."""

    at: int
    left: int
    calls: int = 0
    fixture: list[str] = field(default_factory=list)

    def instant(self) -> None:
        """One more call."""
        self.calls += 1
        if self.calls > self.at and self.left > 0:
            self.left -= 1
            signal.raise_signal(signal.SIGINT)


@contextlib.contextmanager
def _patched(presses: Presses) -> Iterator[None]:
    before = [(owner, name, getattr(owner, name)) for owner, names in INSTANTS for name in names]
    for owner, name, call in before:
        setattr(owner, name, _counted(call, name, presses))
    try:
        yield
    finally:
        for owner, name, call in before:
            setattr(owner, name, call)


def _counted(call: Callable[..., Any], name: str, presses: Presses) -> Callable[..., Any]:
    @wraps(call)
    def counted(*args: Any, **kwargs: Any) -> Any:
        presses.instant()
        done = call(*args, **kwargs)
        if name in ("move", "park"):
            presses.fixture.append(name)
        return done

    return counted


def run_and_press(
    folder: Path, at: int, presses: int, units: int = 2, recipe: str = "six-point"
) -> tuple[int, Presses]:
    """Exit code of a run in `folder` that is stopped from its call number `at` on, so often."""
    pressing = Presses(at, presses)
    chosen = [word for serial in serials(units) for word in ("--serial", serial)]
    words = ["run", "--simulate", "--recipe", recipe, *chosen, "--db", str(folder / "station.db")]
    with _patched(pressing):
        try:
            main([*words, "--device-state", str(folder / "devices"), "--json"])
        except SystemExit as done:
            return int(done.code or 0), pressing
    raise AssertionError("a command ends with an exit code")


def faults_of(folder: Path, code: int, pressing: Presses, units: int = 2) -> list[str]:
    """What is not as it must be after a stop: parked, put back, every record finished and true."""
    wrong = [] if code in (0, 4) else [f"exit code {code}"]
    if "move" in pressing.fixture and pressing.fixture[-1] != "park":
        wrong.append("not parked")
    ran = Ran(folder)
    for serial in serials(units) if (folder / "station.db").exists() else []:
        for life in ran.lives(serial):
            if life["outcome"] not in ("PASS", "ABORTED"):
                wrong.append(f"{serial}: {life['outcome']}")
            if any(event["kind"] == "not-left-as-found" for event in life["events"]):
                wrong.append(f"{serial}: not left as found")
            states = [r["document"]["state"] for r in life["results"] if r["name"] == "device-state"]
            held = len(ran.coefficients(serial))
            if held != (12 if states[-1:] == ["new"] else 0):
                wrong.append(f"{serial}: {held} coefficients in flash, but the record says {states}")
    return wrong
