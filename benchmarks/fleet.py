"""Who shares a cause, over growing fleets: time against units, memory, and whether the hidden groups are named.

    python benchmarks/fleet.py [--units 12500 25000 50000 100000] [--processes 1] [--folder DIR]
    python benchmarks/fleet.py --quiet 100 [--seed 1] [--units 1000]

Units are drawn by tests/fakes/shared_fleet.py, without the station's simulation: nest B of two stations tilts by 2 mrad
from 60 % of the units on, one lot of sixteen is bent. Each size runs in a process of its own. --quiet: so many fleets
in which nothing is shared, a seed each: how many of them have a finding.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy import stats

from station.config.recipes import load_recipe
from station.ports.fleet import Columns
from station.ports.log_reader import Query
from station.service import fleet_diagnosis
from station.service.fleet import FleetJob, InProcess, compute_missing, plan_portions
from station.wiring.fleet import openers
from tests.fakes import shared_fleet

GOAL_BYTES, GOAL_EXPONENT = 2e9, 1.05
HIDDEN = {("bench-3", "B", None), ("bench-9", "B", None), (None, None, "L07")}


def main() -> None:
    """Makes the fleets and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, nargs="+")
    parser.add_argument("--quiet", type=int, metavar="FLEETS")
    parser.add_argument("--seed", type=int, default=1, help="of the first quiet fleet")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--folder", help="where the tables are made: some hundred MB")
    options = parser.parse_args()
    if options.quiet:
        _quiet(range(options.seed, options.seed + options.quiet), (options.units or [1000])[0], options.folder)
        return
    sizes, took = options.units or [12_500, 25_000, 50_000, 100_000], []
    for units in sizes:
        with tempfile.TemporaryDirectory(dir=options.folder) as folder:
            shared_fleet.write(Path(folder) / "fleet", units, _worn(units), 1)
            took.append(_measure(Path(folder), units, options.processes))
    if len(took) > 1:
        pairs = zip(pairwise(sizes), pairwise(took), strict=True)
        each = [np.log(t2 / t1) / np.log(n2 / n1) for (n1, n2), (t1, t2) in pairs]
        whole = np.log(took[-1] / took[0]) / np.log(sizes[-1] / sizes[0])
        shown = ", ".join(f"{value:.2f}" for value in each)
        print(f"exponent of processor time {whole:.2f} ({shown}); goal {GOAL_EXPONENT}")


def _quiet(seeds: range, units: int, place: str | None) -> None:
    """Fleets without a shared cause, computed in this process."""
    wrong = []
    for seed in seeds:
        with tempfile.TemporaryDirectory(dir=place) as folder:
            shared_fleet.write(Path(folder) / "fleet", units, lambda *_: shared_fleet.NOTHING, seed)
            findings = _findings(Path(folder) / "fleet")
        if findings:
            wrong.append(seed)
            print(f"  seed {seed}: {'; '.join(findings)}", flush=True)
    n, k = len(seeds), len(wrong)
    high = float(stats.beta.ppf(0.95, k + 1, n - k))
    print(f"{k} of {n} fleets of {units} units had a finding, at most {high:.3f} with 95 % confidence; stated .01")


class _InMemory:
    """Results of portions (PortionResults)."""

    def __init__(self) -> None:
        self._columns: dict[str, Columns] = {}

    def has(self, key: str) -> bool:
        return key in self._columns

    def write(self, key: str, columns: Columns) -> None:
        self._columns[key] = columns

    def read(self, key: str) -> Columns:
        return self._columns[key]

    def retain(self, keys: Sequence[str]) -> None:
        """All stay."""


def _findings(fleet: Path) -> list[str]:
    recipe, sources, results = load_recipe("six-point"), openers([fleet]), _InMemory()
    query = Query(recipe_name=recipe.name)
    bank = fleet_diagnosis.learn_bank(recipe, query, sources)
    planned = plan_portions(FleetJob("diagnose", recipe, query, "", given=bank.digest), sources)
    compute_missing(planned, partial(fleet_diagnosis.moments_portion, bank), InProcess(), results)
    found = fleet_diagnosis.search_fleet(bank, planned, results)
    return [f"{f.candidate.cause.effect} {f.candidate.level} {f.nats:.1f} nats" for f in found.findings]


def _worn(units: int) -> shared_fleet.Wrong:
    def wrong(number: int, station: str, nest: str, lot: str) -> tuple[np.ndarray, np.ndarray, float]:
        tilted = nest == "B" and station in ("bench-3", "bench-9") and number >= 0.6 * units
        return np.array([2e-3 * tilted, 0.0, 0.0]), np.zeros(3), 5e-4 * (lot == "L07")

    return wrong


def _measure(folder: Path, units: int, processes: int) -> float:
    """Processor seconds of one diagnosis."""
    words = [sys.executable, "-m", "station", "diagnose", "--shared", "--recipe", "six-point", "--json", "-"]
    words += ["--db", str(folder / "fleet"), "--processes", str(processes)]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(words, check=False, capture_output=True, text=True, env=environment)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - began
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found = {(f["station"], f["nest"], f["lot"]) for f in json.loads(done.stdout)["findings"]}
    memory = after.ru_maxrss * 1024
    print(
        f"{units} units: processor {used:.1f} s, wall {wall:.1f} s, memory {memory / 1e6:.0f} MB (goal "
        f"{GOAL_BYTES / 1e6:.0f}); named {len(found & HIDDEN)} of {len(HIDDEN)}, {len(found - HIDDEN)} others; "
        f"load {os.getloadavg()[0]:.1f}",
        flush=True,
    )
    return used


if __name__ == "__main__":
    main()
