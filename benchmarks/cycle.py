"""The station's own time in a cycle: everything but moves, settling, dwells, the devices' flash and the wire.

    python benchmarks/cycle.py [--runs 5] [--rate 1000] [--positions 24]

Row 6. `station run --simulate` with four units, 24 positions at 1 kHz and two more for verification, on virtual time:
moves, settling, dwells, boot and flash take their time on the rig's clock and none here, so what is left on the wall
is the station's own (frames, decoding, checks, log with its fsyncs, SDO, calibration, the page's view of the run) and
the simulated rig's, which is measured apart and taken off. What the station does while it settles and dwells, it does
in time that passes anyway; that is told apart, and only what lengthens the cycle counts. The cycle is the rig's clock
from the first attempt to the last. Wall time suffers from whatever else the machine does; processor time stands beside.
"""

import argparse
import contextlib
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import figures
import yaml

GOAL = 0.01
#: Part of the station → what of it is timed, (module, owner or "", names). Functions are wrapped before they are used.
PARTS: dict[str, list[tuple[str, str, tuple[str, ...]]]] = {
    "simulated rig": [
        ("station.adapters.clock", "VirtualClock", ("settle", "advance")),
        ("station.adapters.bus.simulated", "_Channel", ("send",)),  # the wire: a copy of each frame for each endpoint
    ],
    "log, fsyncs included": [
        ("station.adapters.store.sqlite", "SqliteStore", ("begin", "event", "visit", "write", "result", "finish"))
    ],
    "decode and check frames": [("station.domain.can.decode", "", ("decode_frames", "check_sequence"))],
    "calibration": [("station.service.compute", "", ("calibrate", "verify"))],
    "SDO": [("station.adapters.canopen.sdo_client", "SdoClient", ("upload", "download"))],
    "the page's view": [("station.panel_protocol.live_state", "LiveStateWriter", ("event",))],
}
RIG, OTHER, DWELL = "simulated rig", "all else", "while it settles and dwells"


class Ledger:
    """Who has the wall clock and the processor: each moment belongs to the innermost part only."""

    def __init__(self) -> None:
        self.spent: dict[str, list[float]] = {name: [0.0, 0.0] for name in (*PARTS, OTHER, DWELL)}
        self._open = [OTHER]
        self._since = (time.perf_counter(), time.process_time())

    def settle(self) -> None:
        """Books the time since the last booking."""
        now = time.perf_counter(), time.process_time()
        for i in range(2):
            self.spent[self._open[-1]][i] += now[i] - self._since[i]
        self._since = now

    @contextlib.contextmanager
    def part(self, name: str) -> Iterator[None]:
        """From here on the time is this part's."""
        self.settle()
        self._open.append(DWELL if DWELL in self._open and name != RIG else name)
        try:
            yield
        finally:
            self.settle()
            self._open.pop()

    def begin(self) -> None:
        """Forgets what was before."""
        self.settle()
        for spent in self.spent.values():
            spent[:] = [0.0, 0.0]


def wrap(ledger: Ledger) -> None:
    """Puts the clock around every part; modules that import a function later get the wrapped one."""
    import importlib

    for name, places in PARTS.items():
        for module, owner, names in places:
            found: Any = importlib.import_module(module)
            found = getattr(found, owner) if owner else found
            for one in names:
                setattr(found, one, _timed(getattr(found, one), ledger, name))


def wrap_dwell(ledger: Ledger) -> None:
    """What goes on between two looks of a dwell is the dwell's; after the last look it lengthens the cycle."""
    from station.service.capture import Capture

    take = Capture.take

    def timed(*args: Any, **kwargs: Any) -> Generator[Any, None, Any]:
        dwelling = take(*args, **kwargs)
        while True:
            before = list(ledger.spent[DWELL])
            try:
                with ledger.part(DWELL):
                    event = next(dwelling)
            except StopIteration as done:
                for i in range(2):
                    last = ledger.spent[DWELL][i] - before[i]
                    ledger.spent[DWELL][i] -= last
                    ledger.spent[OTHER][i] += last
                return done.value
            with ledger.part(DWELL):
                yield event

    Capture.take = timed  # type: ignore[method-assign]


def _timed(work: Callable[..., Any], ledger: Ledger, name: str) -> Callable[..., Any]:
    def timed(*args: Any, **kwargs: Any) -> Any:
        with ledger.part(name):
            return work(*args, **kwargs)

    return timed


def recipe(folder: Path, rate_hz: int, positions: int) -> Path:
    """tilt-24 once round, for the simulated product, at this rate."""
    from station.config.search_path import shipped_folder

    tilt, six = (
        yaml.safe_load((shipped_folder() / "recipes" / f"{n}.yaml").read_text(encoding="utf-8"))
        for n in ("tilt-24", "six-point")
    )
    same = {k: six[k] for k in ("product", "settle", "limits", "verify")}
    printed = {**tilt, **same, "device": {**six["device"], "rate_hz": rate_hz}, "runs": [{"seating": "home"}]}
    printed["positions"] = tilt["positions"][:positions]
    path = folder / "cycle.yaml"
    path.write_text(yaml.safe_dump(printed), encoding="utf-8")
    return path


def one_run(ledger: Ledger, rate_hz: int, positions: int) -> tuple[float, dict[str, list[float]]]:
    """Seconds of the cycle on the rig's clock, and what each part took of this machine: wall and processor, s."""
    from station.adapters.clock import VirtualClock
    from station.cli.app import main
    from station.domain.run.progress import LoadDone, LoadStarted
    from station.service.load import Load

    observed: list[float] = []
    clocks: list[VirtualClock] = []
    made, run = VirtualClock.__init__, Load.run

    def watched(self: VirtualClock, *args: Any) -> None:
        made(self, *args)
        clocks.append(self)

    def shown(self: Load, seats: Any) -> Iterator[Any]:
        for event in run(self, seats):
            if isinstance(event, LoadStarted):
                ledger.begin()
            if isinstance(event, LoadStarted | LoadDone):
                observed.append(clocks[-1].monotonic_s())
                ledger.settle()
                stored.update({k: list(v) for k, v in ledger.spent.items()})
            yield event

    stored: dict[str, list[float]] = {}
    clock_class: Any = VirtualClock
    load_class: Any = Load
    clock_class.__init__, load_class.run = watched, shown
    try:
        with tempfile.TemporaryDirectory() as folder, Path(os.devnull).open("w") as nowhere:
            path, log = recipe(Path(folder), rate_hz, positions), Path(folder) / "station.db"
            command = ["run", "--simulate", "--units", "4", "--recipe", str(path), "--db", str(log), "--json"]
            with contextlib.redirect_stdout(nowhere), contextlib.suppress(SystemExit):
                main(command)
    finally:
        VirtualClock.__init__, Load.run = made, run  # type: ignore[method-assign]
    return observed[-1] - observed[0], stored


def main() -> None:
    """Prints the share with its goal, and where it goes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--rate", type=int, default=1000)
    parser.add_argument("--positions", type=int, default=24)
    given = parser.parse_args()
    ledger = Ledger()
    wrap(ledger)
    wrap_dwell(ledger)
    one_run(ledger, given.rate, min(given.positions, 6))  # imports and caches
    found = [one_run(ledger, given.rate, given.positions) for _ in range(given.runs)]
    cycle_s = statistics.median(cycle for cycle, _ in found)
    print(f"python {sys.version.split()[0]}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"four nests, {given.positions} positions and 2 to verify, {given.rate} Hz: a cycle of {cycle_s:.1f} s")
    for name in (*PARTS, OTHER, DWELL):
        wall, used = (statistics.median(parts[name][i] for _, parts in found) * 1e3 for i in range(2))
        print(f"  {name:<28} {wall:7.0f} ms, processor {used:7.0f} ms")
    shares = [
        [sum(v[i] for k, v in parts.items() if k not in (RIG, DWELL)) / c for c, parts in found] for i in range(2)
    ]
    wall, used = (statistics.median(s) for s in shares)
    spread = f"{min(shares[0]):.2%} to {max(shares[0]):.2%} in {len(found)} runs"
    shown = f"software time {wall:.2%} of the cycle ({spread}), processor alone {used:.2%}"
    print(f"row 6: {shown}; goal <= {GOAL:.0%}: {'reached' if wall <= GOAL else 'NOT reached'}")
    what = f"software in a cycle, four nests, {given.positions} positions, {given.rate} Hz"
    figures.keep(
        6, what, f"{wall:.2%} ({spread}); processor {used:.2%}", f"cycle of {cycle_s:.0f} s", "<= 1 %", wall <= GOAL
    )


if __name__ == "__main__":
    main()
