"""Kills workers and the command itself during a job over a fleet, at random instants, until it comes to its end.

    python tests/endurance/torture_fleet.py [--units 16384] [--kills 20] [--seed 1] [--folder DIR]

Each start goes on with what earlier ones left. In the end every portion must be there, with the bits of one process,
and no portion that was there may have been computed again.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.fakes import shared_fleet


def main() -> None:
    """Runs and prints what was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=16_384)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        shared_fleet.write(folder / "fleet", options.units, lambda *_: shared_fleet.NOTHING, options.seed)
        _start(folder, "whole", 1).wait()
        kills = {"worker": 0, "command": 0}
        again = starts = 0
        code = 1
        while code != 0:
            before = _portions(folder / "killed")
            command = _start(folder, "killed", 2)
            starts += 1
            while command.poll() is None and sum(kills.values()) < options.kills:
                time.sleep(rng.uniform(0.5, 6.0))
                victim = rng.choice(["worker", "worker", "command"])
                if _kill(command, victim, rng):
                    kills[victim] += 1
            code = command.wait()
            again += sum(_portions(folder / "killed").get(path) != stamp for path, stamp in before.items())
        whole, killed = ({p.name: p.read_bytes() for p in (folder / n).rglob("*.parquet")} for n in ("whole", "killed"))
        different = sum(whole[name] != killed.get(name) for name in whole)
    print(f"seed {options.seed}: {options.units} units in {len(whole)} portions, {starts} starts, {kills} killed")
    print(f"portions missing or different {different}, too many {len(killed) - len(whole)}, computed again {again}")
    raise SystemExit(different or len(killed) != len(whole) or again)


def _start(folder: Path, results: str, processes: int) -> "subprocess.Popen[bytes]":
    words = [sys.executable, "-m", "station", "diagnose", "--shared", "--recipe", "six-point", "--quiet"]
    words += ["--db", str(folder / "fleet"), "--results", str(folder / results), "--processes", str(processes)]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(words, stdout=quiet, stderr=quiet, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})


def _kill(command: "subprocess.Popen[bytes]", victim: str, rng: random.Random) -> bool:
    """SIGKILL to the command or to one of its processes; whether there was one."""
    if command.poll() is not None:
        return False
    if victim == "command":
        command.kill()
        return True
    try:
        # Each thread of the command has children of its own.
        lists = sorted(Path(f"/proc/{command.pid}/task").glob("*/children"))
        children = [pid for path in lists for pid in path.read_text(encoding="ascii").split()]
        workers = [pid for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        if workers:
            os.kill(int(rng.choice(workers)), signal.SIGKILL)
        return bool(workers)
    except (FileNotFoundError, ProcessLookupError):  # ended meanwhile
        return False


def _portions(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("portion-*.parquet")}


if __name__ == "__main__":
    main()
