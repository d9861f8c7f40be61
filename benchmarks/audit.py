"""Look-up in a log of a million units: one serial's whole life, containment, yields, and the walk along the chain.

    python benchmarks/audit.py [--units 1000000] [--every 20] [--asks 2000] [--folder DIR]

Row 9. The log is made first (see bulk_log.py). Serials are asked for at random among those with all their records, so
most of what is read was not read before; the operating system's cache is as it is after the making.
"""

import argparse
import random
import sqlite3
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import bulk_log
import figures
import numpy as np

from station.adapters.store.reader import SqliteLogReader
from station.ports.log_reader import Query, Trust
from station.service.runner import Runner
from station.wiring.bench import open_bench
from station.wiring.run_order import RunOrder

DAY_NS = 86_400_000_000_000
#: Every filter of the audit page, with a value that many attempts have, one that few have, and one that none has.
FILTERS: dict[str, tuple[Any, ...]] = {
    "serial_like": ("SN*777*", "*nothing*"),
    "station": ("bench-3", "nowhere"),
    "nest": ("B", "Z"),
    "lot": ("L17", "none"),
    "operator": ("", "nobody"),
    "software": ("none",),
    "recipe_version": (1, 99),
    "recipe_hash": ("none",),
    "recipe_name": ("six-point", "none"),
    "firmware": ("1.0.0", "9.9"),
    "outcome": ("FAIL", "ABORTED"),
    "fixture": ("", "none"),
    "check": ("gain", "none"),
    "reference": ("none",),
}


def main() -> None:
    """Makes the log and prints every figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=1_000_000)
    parser.add_argument("--every", type=int, default=20, help="one unit in so many has all its records")
    parser.add_argument("--no-walk", action="store_true", help="leave out the walk along the chain")
    parser.add_argument("--asks", type=int, default=2000)
    parser.add_argument("--folder", help="where the log is made: some GB")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        path = Path(folder) / "big.db"
        begun = time.perf_counter()
        bulk_log.build(path, bulk_log.template(one_run(Path(folder)), "SN0001"), options.units, options.every)
        size = path.stat().st_size / 1e9
        print(f"sqlite {sqlite3.sqlite_version}; a log of {options.units} units, {size:.1f} GB, ", end="")
        print(f"made in {time.perf_counter() - begun:.0f} s; one unit in {options.every} has all its records")
        with SqliteLogReader(path) as log:
            serials(log, options.units, options.every, options.asks)
            containment(log, options.units)
            if not options.no_walk:
                whole(log)


def one_run(folder: Path, recipe: str = "six-point") -> Path:
    """A log of one simulated unit, by the run itself."""
    path = folder / "one.db"
    with open_bench(RunOrder(recipe=recipe, simulate=True, database=path)) as bench:
        for seats in bench.loads(["SN0001"]):
            bench.fixture.place(seats)
            for _ in Runner(bench.station, bench.job).run(seats):
                continue
    return path


def serials(log: SqliteLogReader, units: int, every: int, asks: int) -> None:
    """Row 9, first half."""
    choose = random.Random(1)
    took, records = [], 0
    for _ in range(asks):
        serial = f"SN{choose.randrange(units // every) * every:08d}"
        begun = time.perf_counter()
        (life,) = log.life(Query(serial=serial))
        took.append(time.perf_counter() - begun)
        records = sum(len(life[k]) for k in ("visits", "results", "writes", "events"))
    middle, late = np.percentile(np.array(took) * 1e3, [50, 99])
    print(f"row 9: one serial's whole life, {records} records: median {middle:.2f} ms, p99 {late:.2f} ms; {asks} asks")
    good = middle < 5 and late < 20
    print(f"  goal median < 5 ms, p99 < 20 ms: {'reached' if good else 'NOT reached'}")
    what, peer = f"audit of one serial in a log of {units:,} units", f"sqlite {sqlite3.sqlite_version}"
    figures.keep(
        *(9, what, f"median {middle:.2f} ms, p99 {late:.2f} ms; {asks} asks", peer),
        *("median < 5 ms, p99 < 20 ms", good),
    )


def containment(log: SqliteLogReader, units: int) -> None:
    """Row 9, second half."""
    middle = bulk_log.FIRST_NS + units // 2 * bulk_log.STEP_NS
    nest_b = Query(recipe_name="six-point", nest="B", since_ns=middle)
    week, month = (replace(nest_b, until_ns=middle + days * DAY_NS) for days in (7, 30))
    requested: dict[str, Callable[[], int]] = {
        "recipe, nest, a week": lambda: len(log.attempts(week)),
        "recipe, nest, a month": lambda: len(log.attempts(month)),
        "recipe and nest, all time, counted": lambda: log.count(Query(recipe_name="six-point", nest="B")),
        "a lot": lambda: len(log.attempts(Query(lot="L17"))),
        "FAIL in a month": lambda: len(
            log.attempts(Query(outcome="FAIL", since_ns=middle, until_ns=middle + 30 * DAY_NS))
        ),
        "firmware in a week": lambda: len(
            log.attempts(Query(firmware="1.0.0", since_ns=middle, until_ns=middle + 7 * DAY_NS))
        ),
        "the newest hundred": lambda: len(log.attempts(Query(), limit=100)),
        "yields of a month by nest": lambda: len(
            log.yields(Query(since_ns=middle, until_ns=middle + 30 * DAY_NS), "nest")
        ),
        **{
            f"{name} {value!r}, newest hundred": partial(_page, log, Query(**{name: value}))
            for name, values in FILTERS.items()
            for value in values
        },
    }
    slowest = 0.0
    for name, options_of in requested.items():
        took, worked = [], []
        for _ in range(3):
            begun, begun_cpu = time.perf_counter(), time.process_time()
            found = options_of()
            took.append(time.perf_counter() - begun)
            worked.append(time.process_time() - begun_cpu)
        worst = max(took)
        slowest = max(slowest, worst)
        verdict = "reached" if worst < 1 else "NOT reached"
        print(f"row 9: containment, {name}: {worst:.3f} s at worst of 3 ", end="")
        print(f"(processor {max(worked):.3f} s), {found} found; goal < 1 s: {verdict}")
    what, figure = (
        f"containment in that log, slowest of {len(requested)} questions",
        f"{slowest:.2f} s (worst of 3 each)",
    )
    figures.keep(9, what, figure, f"sqlite {sqlite3.sqlite_version}", "< 1 s", slowest < 1)


def _page(log: SqliteLogReader, query: Query) -> int:
    """As the audit page asks."""
    return len(log.attempts(query, limit=101))


def whole(log: SqliteLogReader) -> None:
    """The walk along the chain."""
    begun = time.perf_counter()
    findings = list(log.findings(Trust()))
    took, records = time.perf_counter() - begun, log.head().number
    speed = f"{records} records, {took:.0f} s, {records / took:.0f} a second"
    print(f"walk along the chain: {speed}; {len(findings)} findings")


if __name__ == "__main__":
    main()
