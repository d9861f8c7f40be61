"""A whole fleet computed again under another recipe, against one unit at a time by `audit --recompute`.

    python benchmarks/backtest.py [--units 100000] [--processes 2] [--folder DIR] [--engines [--turns 5]]

Row 11. The log holds that many units with all that a backtest reads: reduced stops, calibration, beginning and end.
--engines: also the bare loop over the portions in one process, Dask with one worker and with two, in turns; their start
is not counted, and every run is printed.
"""

import argparse
import multiprocessing
import os
import resource
import statistics
import tempfile
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
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
from station.wiring.process_memory import retain_freed_memory

GOAL_S, GOAL_MILLION_S = 120, 200
STORED = {"attempt", "finish"}
RESULTS = {"stops", "calibration"}


def main() -> None:
    """Makes the log and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=100_000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--folder", help="where the log is made: some GB")
    parser.add_argument("--engines", action="store_true")
    parser.add_argument("--turns", type=int, default=5, help="times that each engine is measured")
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
            engines(path, job, options.units, options.turns)
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


def engines(path: Path, job: FleetJob, units: int, turns: int) -> None:
    """Time by the clock and processor's time of the same portions by each engine, in turns, every run of them."""
    retain_freed_memory()  # as `open_engine` does for a bare loop
    took: dict[str, list[tuple[float, float]]] = {}
    for _ in range(turns):
        for name, workers in (("bare loop", 0), ("1 worker", 1), ("2 workers", 2)):
            took.setdefault(name, []).append(engine_run(path, job, workers))
    for place, what in enumerate(("clock", "processor")):
        each = {name: [1e3 * run[place] / units for run in runs] for name, runs in took.items()}
        middle = {name: statistics.median(runs) for name, runs in each.items()}
        print(f"  {what}, ms a unit:")
        for name, runs in each.items():
            print(f"    {name}: median {middle[name]:.3f}; " + ", ".join(f"{run:.3f}" for run in runs))
        over, share = middle["1 worker"] / middle["bare loop"] - 1, middle["1 worker"] / middle["2 workers"]
        print(f"    Dask with one worker over the bare loop: {over:+.1%}, goal <= 10 %")
        print(f"    2 workers over 1: {share:.2f} times as fast, goal >= 1.8 by the clock")
    print(f"  load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")


def engine_run(path: Path, job: FleetJob, workers: int) -> tuple[float, float]:
    """Seconds by the clock and of the processor that the portions take. Not among them: the engine's start and end, and
    two portions a worker, in which it imports what it needs."""
    opened: AbstractContextManager[PortionEngine] = DaskEngine(workers=workers) if workers else nullcontext(InProcess())
    with tempfile.TemporaryDirectory() as folder, opened as engine:
        results = ParquetResults(Path(folder), "bench", backtest.COLUMNS, {})
        first = plan_portions(replace(job, code="first"), openers([path])).portions[: max(2 * workers, 1)]
        list(engine.compute(backtest.compare_portion, first))
        begun, used = time.perf_counter(), _cpu_now_s()
        compute_missing(plan_portions(job, openers([path])), backtest.compare_portion, engine, results)
        return time.perf_counter() - begun, _cpu_now_s() - used


def _cpu_now_s() -> float:
    """Processor time until now of this process and of those that it has running."""
    running = [child.pid for child in multiprocessing.active_children()]
    stat = (Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2] for pid in (os.getpid(), *running))
    return sum(sum(map(int, line.split()[11:13])) for line in stat) / os.sysconf("SC_CLK_TCK")


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
