"""Takes many units through one opened station in virtual time, and watches what should not grow.

    python tests/endurance/torture_lasting.py [--units 10000] [--after 500] [--seed 1] [--json]

Each unit is a fixture load of its own: identified, measured in one position, its twelve coefficients written, saved,
reset, verified and logged.
Growth of memory (resident) is from the `after`-th unit to the last; threads and open files likewise; the write-ahead
log is the largest that was seen. Goals: < 5 %, 0, 0; the log of writes under 64 MiB, at which SQLite cuts it.
"""

import argparse
import gc
import json
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

sys.path.insert(0, str(Path(__file__).parents[2]))

from station.config.search_path import shipped_folder
from station.domain.core.types import Outcome
from station.service.runner import Runner
from station.wiring.bench import Bench, open_bench
from station.wiring.run_order import RunOrder

GOAL, WAL_MIB = 0.05, 64
#: The shortest run there is: what could grow does so by the unit, not by the second.
SHORT = {
    "settle": {"time_s": 0.1},
    "dwell": {"time_s": 0.3},
    "limits": {"rule": "simple", "offset": 0.2},
    "verify": {"limit": 0.2, "positions": [{"name": "verify-x", "up": "+x"}]},
}
QUICK = {"kind": "simulated", "speed_deg_s": 2000, "acceleration_deg_s2": 20000}


@dataclass(frozen=True, slots=True)
class Held:
    """What this process holds: resident memory in kB, threads, open files."""

    memory_kb: int
    threads: int
    files: int


def held() -> Held:
    """Now, with the garbage collected."""
    gc.collect()
    status = Path("/proc/self/status").read_text()
    memory = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    return Held(memory, threading.active_count(), len(list(Path("/proc/self/fd").iterdir())))


def one_load(bench: Bench, first: int) -> int:
    """One fixture load of new units; how many passed."""
    names = [f"SN{first + i:06d}" for i in range(len(bench.station.settings.nests))]
    (seats,) = bench.loads(names)
    bench.fixture.place(seats)
    results = list(Runner(bench.station, bench.job).run(seats))[-1].results  # type: ignore[attr-defined]
    return sum(r.outcome is Outcome.PASS for r in results)


def order(folder: Path, seed: int) -> RunOrder:
    """A simulated station with the short recipe and a quick positioner."""
    recipe, config = (
        yaml.safe_load((shipped_folder() / f).read_text()) for f in ("recipes/one-point.yaml", "config.yaml")
    )
    files = {"recipe.yaml": recipe | SHORT, "config.yaml": config | {"positioner": QUICK, "nests": config["nests"][:1]}}
    for name, document in files.items():
        (folder / name).write_text(yaml.safe_dump(document))
    given = {"recipe": str(folder / "recipe.yaml"), "config": folder / "config.yaml"}
    return RunOrder(simulate=True, database=folder / "station.db", seed=seed, **given)  # type: ignore[arg-type]


def lasting(units: int, after: int, seed: int) -> dict[str, Any]:
    """The figures."""
    begun_s, largest_wal, passed, done, early = time.monotonic(), 0, 0, 0, held()
    with tempfile.TemporaryDirectory() as name:
        wal = Path(name) / "station.db-wal"
        with open_bench(order(Path(name), seed)) as bench:
            while done < units:
                passed += one_load(bench, done)
                done += len(bench.station.settings.nests)
                largest_wal = max(largest_wal, wal.stat().st_size if wal.exists() else 0)
                if done <= after:
                    early = held()
                if done % 1000 == 0:
                    print(f"{done} units: {held().memory_kb / 1024:.1f} MiB", file=sys.stderr, flush=True)
            late = held()
    return {
        "units": done,
        "passed": passed,
        "after": after,
        "memory_growth": late.memory_kb / early.memory_kb - 1,
        "memory_mib": late.memory_kb / 1024,
        "threads_growth": late.threads - early.threads,
        "files_growth": late.files - early.files,
        "wal_mib": largest_wal / 2**20,
        "cpu_s": time.process_time(),
        "seed": seed,
        "lasted_s": time.monotonic() - begun_s,
    }


def main() -> int:
    """Prints the figures; 1 when one of them is not as it must be."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--units", type=int, default=10_000)
    parser.add_argument("--after", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    shown = lasting(given.units, given.after, given.seed)
    grown = shown["memory_growth"] >= GOAL or shown["threads_growth"] > 0 or shown["files_growth"] > 0
    bad = grown or shown["wal_mib"] >= WAL_MIB or shown["passed"] < shown["units"]
    if given.json:
        print(json.dumps(shown))
        return int(bad)
    print(
        f"{shown['units']} units in virtual time, {shown['passed']} passed: memory after the first {shown['after']} "
        f"{100 * shown['memory_growth']:+.1f} % (goal < {100 * GOAL:g} %), threads {shown['threads_growth']:+d}, open "
        f"files {shown['files_growth']:+d} (goal 0), WAL at most {shown['wal_mib']:.1f} MiB (goal < {WAL_MIB})"
    )
    print(
        f"  {shown['memory_mib']:.0f} MiB resident; {shown['lasted_s']:.0f} s, {shown['cpu_s']:.0f} s of them computing"
    )
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
