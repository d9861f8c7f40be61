"""A plant: records checked and kept a second, the drain of an outage, what shipping costs, and how fast it answers.

    python benchmarks/plant.py [--rows receive cost ask] [--units 400] [--attempts 1000000] [--repeats 3]

receive: signed records of a station's own log go through the receiver into a real PostgreSQL (from the wheel that the
tests use), portion by portion. Time of the receiving process and of PostgreSQL's is told apart; "per core" counts both.
From it follows how long 8 stations take to catch up after 24 hours, on two cores.
cost: commits of a stop with and without a shipment that follows the log, in turn.
ask: a plant of so many attempts (copied by SQL from one real attempt): a serial's whole life, containment of a lot in
a nest, and the figures of the dashboard.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from cryptography.hazmat.primitives import serialization

from station.adapters.clock import SystemClock
from station.cli.app import main as main_of_station
from station.domain.records.wire import decode, encode
from station.ports.log_reader import Query
from station.ports.plant import Claim
from station.service.line_statistics import gather_statistics
from station.service.shipping import Shipment, ShippingStatus
from tests.fakes import logs
from tests.fakes.plant import DirectReceiver, FakePlant, FakeStation, Server

#: A line of 8 stations, each 4 nests in a cycle of 40 s, around the clock; a unit of `six-point` leaves 62 records.
STATIONS, UNITS_A_DAY, RECORDS_A_UNIT = 8, 4 * 86_400 // 40, 62
PORTION_BYTES = 1_048_576
DAY_NS = 86_400 * 10**9


def main() -> None:
    """Prints the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", nargs="+", default=["receive", "cost", "ask"], choices=["receive", "cost", "ask"])
    parser.add_argument("--units", type=int, default=400)
    parser.add_argument("--attempts", type=int, default=1_000_000)
    parser.add_argument("--stops", type=int, default=400)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="station-bench-", ignore_cleanup_errors=True) as place:
        server = Server(Path(place) / "pg")
        server.folder.mkdir()
        server.start()
        folder = Path(place) / "logs"
        folder.mkdir()
        try:
            if "receive" in options.rows:
                receive(server, folder, options.units, options.repeats)
            if "cost" in options.rows:
                cost(server, folder, options.stops)
            if "ask" in options.rows:
                ask(server, folder, options.attempts)
        finally:
            server.stop()


def receive(server: Server, folder: Path, units: int, repeats: int) -> None:
    """Records a second and core."""
    station = _station(folder, "bench-1", units)
    records = station.records()
    portions, at = list[bytes](), 0
    with station.outbox() as outbox:
        while part := outbox.read(at, PORTION_BYTES):
            portions.append(encode(part))
            at = part[-1].number
    ours, both = list[float](), list[float]()
    for turn in range(repeats):
        plant = FakePlant(server.database(), folder / f"objects-{turn}")
        log_id, claim = station.log_id(), Claim(records[-1].number, "")
        begun, own, theirs = time.perf_counter(), time.process_time(), _server_seconds(server)
        for data in portions:
            standing = plant.receiver.receive(station.registered, log_id, decode(data), claim)
            assert standing.refusal is None
        wall, own, theirs = time.perf_counter() - begun, time.process_time() - own, _server_seconds(server) - theirs
        plant.connections.close()
        ours.append(len(records) / own)
        both.append(len(records) / (own + theirs))
        print(
            f"  {len(records)} records in {wall:.2f} s: plant {own / len(records) * 1e6:.0f} µs, "
            f"PostgreSQL {theirs / len(records) * 1e6:.0f} µs of processor a record"
        )
    _figure("verified signed records a second and core, plant process", ours, 5000, at_least=True)
    _figure("the same, PostgreSQL's processor counted too", both, 5000, at_least=True)
    day = STATIONS * UNITS_A_DAY * RECORDS_A_UNIT
    drained = [day / (2 * rate) / 60 for rate in both]
    print(f"  a day of {STATIONS} stations: {STATIONS * UNITS_A_DAY} units, {day / 1e6:.2f} M records")
    _figure("24 h outage of 8 stations drained by two cores, min (from the rate)", drained, 10, at_least=False)


def cost(server: Server, folder: Path, stops: int) -> None:
    """Commit of a stop of four nests, with a shipment that follows the log and without, in turns of ten."""
    plant, station = FakePlant(server.database(), folder / "objects-cost"), FakeStation("cost", folder)
    rng = np.random.default_rng(1)
    with station.store() as store:
        follower = os.fork()
        if follower == 0:
            _follow(station, plant.address, folder)
        took: tuple[list[float], list[float]] = ([], [])
        used: tuple[list[float], list[float]] = ([], [])
        attempts = [store.begin(logs.begin(f"SN{n}", station="cost", node=n + 1)) for n in range(4)]
        switch = folder / "ship"
        for number in range(stops):
            shipping = number // 10 % 2
            switch.touch() if shipping else switch.unlink(missing_ok=True)
            visits = [replace(logs.visit(number, rng), position=f"p{number}") for _ in range(4)]
            begun, busy = time.perf_counter(), time.process_time()
            store.visit(attempts, visits)
            took[shipping].append(time.perf_counter() - begun)
            used[shipping].append(time.process_time() - busy)
            time.sleep(0.02)
        os.kill(follower, 9)
        os.waitpid(follower, 0)
    plant.connections.close()
    without, with_ = (statistics.median(t) for t in took)
    spread = statistics.stdev(took[0]) / without / len(took[0]) ** 0.5 * 1.25
    print(
        f"  commit of a stop: {without * 1e3:.3f} ms without, {with_ * 1e3:.3f} ms with shipping (medians of {stops})"
    )
    _figure("cost of shipping on a stop's commit, %", [(with_ / without - 1) * 100], 1, at_least=False)
    print(f"  (standard error of the comparison {spread * 141:.1f} %)")
    own = [statistics.median(u) for u in used]
    print(f"  processor of the same commits: {own[0] * 1e6:.0f} µs without, {own[1] * 1e6:.0f} µs with shipping")
    _figure("the same on a cycle of 28 s with 24 stops, %", [(with_ - without) * 24 / 28 * 100], 0.1, at_least=False)


def _follow(station: FakeStation, address: str, folder: Path) -> None:
    """The other process: ships whenever the switch is on. It never returns."""
    os.nice(10)
    plant = FakePlant(address, folder / "objects-cost")
    with station.outbox() as outbox:
        shipment = Shipment(outbox, DirectReceiver(plant, station), SystemClock(), ShippingStatus("plant"), 1 << 20)
        while True:
            rest_s = shipment.step() if (folder / "ship").exists() else 0.05
            time.sleep(rest_s)


def ask(server: Server, folder: Path, attempts: int) -> None:
    """Questions to a plant of so many attempts."""
    plant, station = FakePlant(server.database(), folder / "objects-ask"), _real_station(folder)
    plant.take_all(station)
    begun = time.perf_counter()
    _multiply(plant, attempts)
    print(f"  {attempts} attempts made in {time.perf_counter() - begun:.0f} s")
    rng = np.random.default_rng(3)
    with plant.reader() as log:
        serials = [f"SN{n:08d}" for n in rng.integers(1, attempts, 300)]
        _figure(
            "serial, its whole life, p99, ms", [_p99(lambda s: log.life(Query(serial=s)), serials)], 20, at_least=False
        )
        busy = time.process_time() + _server_seconds(server)
        for serial in serials:
            log.life(Query(serial=serial))
        busy = time.process_time() + _server_seconds(server) - busy
        print(f"  processor of such a question, PostgreSQL's too: {busy / len(serials) * 1e3:.1f} ms")
        lots = [Query(lot=f"L{n}", nest="B") for n in range(1, 6)]
        lot = [_timed(partial(log.attempts, query)) for query in lots]
        found = len(log.attempts(Query(lot="L1", nest="B")))
        _figure(f"containment: a lot in a nest ({found} attempts), s", lot, 1, at_least=False)
        newest = log.attempts(Query(), 1)[0]
        # As the page asks: whole days up to now, a day's attempts of eight stations at least.
        week = Query(since_ns=(newest.started_ns // DAY_NS - 1) * DAY_NS)
        count = log.count(week)
        counted = [_timed(lambda: log.yields(week, "cell")) for _ in range(3)]
        print(f"  of which the yields: {statistics.median(counted):.3f} s")
        shown = [_timed(lambda: gather_statistics(log, week, 200)) for _ in range(3)]
        _figure(f"dashboard of the last day ({count} attempts), s", shown, 1, at_least=False)
        recent = [_timed(lambda: log.recent(50, 200)) for _ in range(3)]
        _figure("figures for the monitor, s", recent, 1, at_least=False)
    plant.connections.close()


_MULTIPLY = """
INSERT INTO {table} SELECT %(first)s + (i * %(step)s) + (t.seq - %(base)s), t.log, t.number, t.hash, t.signature,
    {columns}
FROM generate_series(%(from)s::bigint, %(to)s::bigint - 1) i, {table} t WHERE t.seq BETWEEN %(base)s AND %(last)s
    AND ({keep})"""


def _multiply(plant: FakePlant, attempts: int) -> None:
    """Attempts with identity, verdict and end like the first one's, other serials, lots, nests, stations and times."""
    with plant.connections.one() as db:
        row = db.execute("SELECT a.seq, f.seq FROM attempt a JOIN finish f ON f.attempt = a.seq").fetchone()
        assert row
        base, last = int(row[0]), int(row[1])
        top = db.execute("SELECT last FROM counter").fetchone()
        assert top
        step, first = last - base + 1, int(top[0]) + 1
        db.execute("SELECT make_room(%s)", [first + step * attempts])
        db.execute("UPDATE counter SET last = %s", [first + step * attempts])
        of = f"{first} + i * {step}"
        columns = {
            "attempt": """t.id || i, 'SN' || lpad(i::text, 8, '0'), 'bench-' || i %% 8,
                substr('ABCD', (i / 8 %% 4)::int + 1, 1), t.node, 'L' || i / 5000, t.recipe_name, t.recipe_version,
                t.recipe_hash, t.recipe, t.product, t.config_hash, t.software, t.operator,
                t.started_ns + i * 1000000000::bigint, t.product_name""",
            "result": f"{of}, t.at_ns + i * 1000000000::bigint, t.name, t.document",
            "finish": f"{of}, CASE WHEN i %% 41 = 0 THEN 'FAIL' ELSE 'PASS' END, t.ended_ns + i * 1000000000::bigint",
        }
        values = {"first": first, "step": step, "base": base, "last": last, "from": 1, "to": attempts}
        for table, made in columns.items():
            keep = "t.name IN ('identity', 'verdict', 'calibration')" if table == "result" else "true"
            db.execute(_MULTIPLY.format(table=table, columns=made, keep=keep).encode(), values)
        db.execute("SELECT count_yields(%s, %s)", [first, first + step * attempts])
        db.execute("ANALYZE")


def _station(folder: Path, name: str, units: int) -> FakeStation:
    station = FakeStation(name, folder)
    with station.store() as store:
        for number in range(units):
            logs.unit(store, f"SN{number:08d}", station=name)
    return station


def _real_station(folder: Path) -> FakeStation:
    """A log of one unit as a run writes it, signed."""
    station = FakeStation("bench-0", folder)
    pem = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    (folder / "key.pem").write_bytes(station.key.private_bytes(*pem))
    (folder / "config.yaml").write_text(
        f"schema: station.config/1\nstation: bench-0\nnests: [{{name: A, node: 17}}]\n"
        f"database: {station.path}\nsigning_key: {folder / 'key.pem'}\n"
    )
    with suppress(SystemExit):
        main_of_station(["run", "--simulate", "--quiet", "--seed", "3", "--config", str(folder / "config.yaml")])
    return station


def _server_seconds(server: Server) -> float:
    """Processor time of PostgreSQL's processes, those that ended included."""
    process = server._process
    assert process is not None
    ticks, total = os.sysconf("SC_CLK_TCK"), 0
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(entry.name) == process.pid:
                total += sum(map(int, fields[11:15]))
            elif int(fields[1]) == process.pid:
                total += sum(map(int, fields[11:13]))
    return total / ticks


def _timed(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def _p99(work: Callable[[str], object], serials: list[str]) -> float:
    work(serials[0])
    return float(np.percentile([_timed(partial(work, serial)) for serial in serials], 99) * 1e3)


def _figure(name: str, values: list[float], goal: float, *, at_least: bool) -> None:
    middle = statistics.median(values)
    reached = middle >= goal if at_least else middle <= goal
    spread = f", {min(values):.4g} … {max(values):.4g} in {len(values)} runs" if len(values) > 1 else ""
    print(
        f"{name}: {middle:.4g} (goal {'≥' if at_least else '≤'} {goal:g}: {'reached' if reached else 'missed'}{spread})"
    )


if __name__ == "__main__":
    main()
