"""A line whose station and PLC die: kills them and asks whether every unit came back once, into the right bin.

    python tests/endurance/torture_line.py [--crashes N] [--kills N] [--seed S] [--json]

--crashes: in one process, at random calls of the ports and on virtual time, with the real hand-over and the real PLC
program. --kills: SIGKILL at random instants of a real `station line` that speaks to a real PLC process over Modbus TCP
and to its scanner over TCP; every fourth kill takes the PLC, whose retentive memory is a file. What must never be:

* twice: a unit with two verdicts of one presentation; skipped: handed back without an attempt;
* lost: a load that came and never went back, or went twice; wrong: in another bin than its verdict in the log.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from station.adapters.store.reader import SqliteLogReader
from station.domain.cell.handover import MOST_INTERRUPTED, Bin
from station.ports.log_reader import Query
from tests.fakes import crashing_cell
from tests.fakes.waiting import until

ROOT = Path(__file__).parents[2]
CONFIG = """schema: station.config/1
station: line-1
bus: {{interface: simulated, channel: v}}
nests: [{{name: A, node: 0x11}}, {{name: B, node: 0x12}}]
positioner: {{kind: simulated}}
recipe: offset-gain
database: station.db
line:
  cell: {{kind: plc, host: 127.0.0.1, port: {plc}}}
  scanner: {{kind: network, port: {scanner}, trigger: "LON {{nest}}\\\\r"}}
  after_crash: continue
  lost_s: 1
"""


@dataclass(frozen=True, slots=True)
class LineTrial:
    """What a torture of real processes came to."""

    kills_station: int
    kills_plc: int
    loads: int
    units: int
    twice: int
    skipped: int
    lost: int
    wrong: int


def _executes(folder: Path, before: int) -> bool:
    return "execute" in _log_text(folder)[before:]


def kill_processes(kills: int, seed: int) -> LineTrial:
    """Until so many kills; then the line goes on until every load that came is back."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name, ExitStack() as opened:
        folder = Path(name)
        ports = _free_ports()
        (folder / "config.yaml").write_text(CONFIG.format(plc=ports[0], scanner=ports[1]), encoding="utf-8")
        plc = opened.enter_context(_plc(folder, ports, loads=10_000))
        line = _line(folder)
        killed, size = [0, 0], 0
        while sum(killed) < kills:
            until(partial(_executes, folder, size), "the state execute")
            time.sleep(rng.choice([0.5, 2.0, 8.0]) * rng.random())  # the kill comes at any instant of a load
            if sum(killed) % 4 == 3:
                plc.send_signal(signal.SIGKILL)
                plc.wait()
                time.sleep(rng.random() * 2)
                plc = opened.enter_context(_plc(folder, ports, loads=10_000))
                killed[1] += 1
            elif line.poll() is None:
                line.send_signal(signal.SIGKILL)
                line.wait()
                size, line = len(_log_text(folder)), _line(folder)
                killed[0] += 1
            else:
                size, line = len(_log_text(folder)), _line(folder)
        plc.send_signal(signal.SIGKILL)
        plc.wait()
        came = json.loads((folder / "plc.json").read_text(encoding="utf-8"))["load"]
        opened.enter_context(_plc(folder, ports, loads=came + 1))
        until(lambda: _handed(folder) > came, "every load handed back", 120.0)
        line.send_signal(signal.SIGINT)
        line.wait(30)
        return _judge(folder, killed)


def _log_text(folder: Path) -> str:
    return (folder / "line.log").read_text(encoding="utf-8")


def _handed(folder: Path) -> int:
    return len(json.loads((folder / "plc.json").read_text(encoding="utf-8"))["handed"])


def _judge(folder: Path, killed: list[int]) -> LineTrial:
    state = json.loads((folder / "plc.json").read_text(encoding="utf-8"))
    twice = skipped = wrong = units = 0
    with SqliteLogReader(folder / "station.db") as log:
        for handed in state["handed"]:
            for place, serial in enumerate(handed["serials"]):
                units += 1
                outcomes = [a.outcome for a in reversed(log.attempts(Query(serial=serial)))]
                decided = [o for o in outcomes if o not in ("INTERRUPTED", None)]
                twice += len(decided) > 1
                skipped += not decided and len(outcomes) < MOST_INTERRUPTED
                best = decided[0] if decided else "INTERRUPTED"
                right = {"PASS": Bin.GOOD, "FAIL": Bin.REJECT}.get(str(best), Bin.AGAIN)
                wrong += handed["bins"] >> 2 * place & 3 != right
    numbers = [h["load"] for h in state["handed"]]
    present = {state["load"]} if state["nests"] else set()
    lost = len(set(range(1, state["load"] + 1)) - set(numbers) - present) + len(numbers) - len(set(numbers))
    return LineTrial(killed[0], killed[1], len(numbers), units, twice, skipped, lost, wrong)


def _free_ports() -> list[int]:
    import socket

    with ExitStack() as opened:
        sockets = [opened.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(2)]
        return [int(s.getsockname()[1]) for s in sockets]


@contextmanager
def _plc(folder: Path, ports: list[int], loads: int) -> Iterator[subprocess.Popen[str]]:
    command = ["rig", "--simulate", "plc", "--port", str(ports[0]), "--scanner-port", str(ports[1])]
    command += ["--nests", "2", "--loads", str(loads), "--memory", "plc.json", "--change-s", "0.2"]
    process = subprocess.Popen(
        [sys.executable, "-m", "station", *command],
        cwd=folder,
        env=_environment(),
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        process.stdout.readline()  # it listens
        yield process
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _line(folder: Path) -> subprocess.Popen[str]:
    with (folder / "line.log").open("a", encoding="utf-8") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "station", "line", "--simulate"],
            cwd=folder,
            env=_environment(),
            stdout=log,
            stderr=log,
            text=True,
        )


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}


def main() -> int:
    """See the top of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--crashes", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found: dict[str, Any] = {"seed": given.seed}
    if given.crashes:
        found["in process"] = asdict(crashing_cell.endure(given.crashes, given.seed))
    if given.kills:
        found["processes"] = asdict(kill_processes(given.kills, given.seed))
    print(json.dumps(found) if given.json else json.dumps(found, indent=1))
    bad = sum(found[part][k] for part in found if part != "seed" for k in ("twice", "skipped", "lost", "wrong"))
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
