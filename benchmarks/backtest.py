"""A whole fleet computed again under another recipe, against one unit at a time by `audit --recompute`.

    python benchmarks/backtest.py [--units 100000] [--processes 2] [--folder DIR] [--engines]

Row 11. The log holds that many units with all that a backtest reads: reduced stops, calibration, beginning and end.
--engines: also the bare loop over the portions in one process, Dask with one worker and with two, in turns; their start
is not counted.
"""

import argparse
import os
import resource
import statistics
import tempfile
import time
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import bulk_log
import figures
import yaml
from audit import one_run

from station.adapters.fleet.dask_engine import DaskEngine
from station.adapters.fleet.results import ParquetResults
from station.adapters.store.reader import SqliteLogReader
from station.cli._fleet import FleetRequest, computed
from station.config.recipes import load_recipe
from station.config.search_path import shipped_folder
from station.ports.fleet import PortionEngine
from station.ports.log_reader import Query
from station.service import backtest
from station.service.fleet import FleetJob, InProcess, compute_missing, plan_portions
from station.service.recompute import recompute
from station.wiring.fleet import code_version, openers

GOAL_S, GOAL_MILLION_S = 120, 200
#: Times that each engine is measured.
TURNS = 3
STORED = {"attempt", "finish"}
RESULTS = {"stops", "calibration"}


def main() -> None:
    """Makes the log and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=100_000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--folder", help="where the log is made: some GB")
    parser.add_argument("--engines", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        name = once_round(Path(folder))
        recipe = load_recipe(name)
        tighter = recipe.model_copy(update={"limits": recipe.limits.model_copy(update={"offset": 0.04})})
        one, path = one_run(Path(folder), name), Path(folder) / "fleet.db"
        peer_s = single(one)
        whole = bulk_log.template(one, "SN0001")
        rows = tuple((t, v) for t, v in whole.rows if t in STORED or (t == "result" and v[2] in RESULTS))
        bulk_log.build(path, bulk_log.Template(rows, whole.documents), options.units, 1)
        visits = sum(table == "visit" for table, _ in whole.rows)
        size = path.stat().st_size / 1e9
        print(f"{options.units} units of recipe {recipe.name}, {visits} stops each; {size:.1f} GB")
        begun, used = time.perf_counter(), _cpu_s()
        job = FleetJob("backtest", tighter, Query(), code_version())
        request = FleetRequest((path,), options.processes)
        with computed(request, job, backtest.compare_portion, backtest.COLUMNS) as (planned, results):
            found = backtest.sum_backtest(planned, results)
        took, used = time.perf_counter() - begun, _cpu_s() - used
        if options.engines:
            engines(path, job, options.units)
    each = took / options.units
    print(f"row 11: {options.units} units on {options.processes} processes: {took:.0f} s, {each * 1e3:.2f} ms a unit")
    print(f"  processor time {used:.0f} s, {used / options.units * 1e3:.2f} ms a unit; load {os.getloadavg()[0]:.1f}")
    print(f"  1,000,000 units: {each * 1e6:.0f} s, goal <= {GOAL_MILLION_S} s")
    print(f"  goal < {GOAL_S} s for 100000: {'reached' if each * 100_000 < GOAL_S else 'NOT reached'}")
    print(f"  one unit at a time by audit --recompute: {peer_s * 1e3:.0f} ms a unit, {peer_s / each:.0f} times as long")
    what = f"backtest of {options.units:,} units, {options.processes} processes"
    figures.keep(
        *(11, what, f"{took:.0f} s, {each * 1e3:.2f} ms a unit (processor {used / options.units * 1e3:.2f}); 1 run"),
        f"one at a time by audit --recompute: {peer_s * 1e3:.0f} ms a unit, {peer_s / each:.0f} × as long",
        *("100,000 in < 120 s", each * 100_000 < GOAL_S),
    )
    print(f"  {len(found.changes)} verdicts would change")


def once_round(folder: Path) -> str:
    """tilt-24 for the simulated product, each of its 24 positions once."""
    printed = yaml.safe_load((shipped_folder() / "recipes" / "tilt-24.yaml").read_text(encoding="utf-8"))
    sheet = yaml.safe_load((shipped_folder() / "recipes" / "six-point.yaml").read_text(encoding="utf-8"))
    printed |= {"product": sheet["product"], "device": sheet["device"], "runs": [{"seating": "home"}], "limits": {}}
    path = folder / "tilt-24-once.yaml"
    path.write_text(yaml.safe_dump(printed), encoding="utf-8")
    return str(path)


def engines(path: Path, job: FleetJob, units: int) -> None:
    """Wall time of the same portions by each engine: median of some turns."""
    took: dict[str, list[float]] = {}
    for _ in range(TURNS):
        for name, workers in (("bare loop", 0), ("1 worker", 1), ("2 workers", 2)):
            opened: AbstractContextManager[PortionEngine] = (
                DaskEngine(workers=workers) if workers else nullcontext(InProcess())
            )
            with tempfile.TemporaryDirectory() as folder, opened as engine:
                results = ParquetResults(Path(folder), "bench", backtest.COLUMNS, {})
                planned, begun = plan_portions(job, openers([path])), time.perf_counter()
                compute_missing(planned, backtest.compare_portion, engine, results)
                took.setdefault(name, []).append(time.perf_counter() - begun)
    middle = {name: statistics.median(each) for name, each in took.items()}
    for name, each in took.items():
        print(f"  {name}: {middle[name] / units * 1e3:.2f} ms a unit ({min(each):.1f} to {max(each):.1f} s)")
    print(f"  2 workers ÷ 1: {middle['1 worker'] / middle['2 workers']:.2f}, goal >= 1.8")
    print(f"  Dask over the bare loop: {middle['1 worker'] / middle['bare loop'] - 1:+.1%}, goal <= 10 %")
    print(f"  load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


def _cpu_s() -> float:
    """Processor time of this process and of those it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def single(path: Path) -> float:
    """Seconds for one unit from its raw frames: the median of nine."""
    took = []
    with SqliteLogReader(path) as log:
        (attempt,) = log.attempts(Query())
        for _ in range(9):
            begun = time.perf_counter()
            assert recompute(log, attempt).identical
            took.append(time.perf_counter() - begun)
    return sorted(took)[4]


if __name__ == "__main__":
    main()
