"""The log: commit of one visit against a bare SQLite insert, and raw frames at rest against candump + zstd and BLF.

    python benchmarks/store.py [--rows 7 8] [--stops 300] [--units 4] [--folder DIR]

Row 7: the same bytes (plain frames and statistics of four nests) go through `SqliteStore.visit` and through bare
`INSERT`s in one transaction, in turn, with the same settings: WAL, synchronous FULL. As in a run, the frames were laid
out and hashed before, look by look, while the dwell went on; what that takes is told beside it. The bare insert's
write-ahead log grows for the first 4 MB, that of the station has its length from its opening on: the last third of the
stops, told apart, is where neither grows (at 100 Hz with 300 stops or more). Row 8: all frames of a
unit, 24 stops, as the log packs them, against its candump log compressed by zstd -19 and its BLF file; time stamps as
a kernel gives them, to the nanosecond, with 20 µs of jitter, and cut to whole microseconds, as candump keeps them.
"""

import argparse
import sqlite3
import tempfile
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import can
import figures
import numpy as np
import zstandard

from station.adapters.bus import write_log
from station.adapters.dbc import read_layouts
from station.adapters.store.sqlite import SqliteStore
from station.domain.can.encode import sample_frames, temperature_frames
from station.domain.can.sensor_layout import FrameMap, SensorLayout, resolve
from station.domain.core.types import Frames
from station.domain.records import plain_json
from station.domain.records.framepack import codec
from station.domain.records.framepack import plain as raw
from station.ports.store import AttemptStart, VisitRecord

DBC = Path(__file__).resolve().parents[1] / "dbc" / "accelerometer.dbc"
ROLES = {
    "dbc": DBC.name,
    "sample": {
        **{"message": "ACCELERATION", "x": "X", "y": "Y", "z": "Z"},
        **{"counter": "COUNTER", "status": "STATUS", "crc": "CRC"},
    },
    "temperature": {"message": "TEMPERATURE", "signal": "TEMPERATURE"},
    "e2e": {"profile": "P01", "data_id": 0x1A00, "data_id_plus_node": True},
}
NESTS = 4
POSITIONS = 24
#: Looks of a stop of 1.3 s: 0.05 s apart while it settles, 0.2 s while it dwells.
LOOKS_S = (*np.arange(0.05, 0.3001, 0.05), *np.arange(0.5, 1.3001, 0.2))
#: Noise density of the shipped simulated sensor, g/√Hz.
NOISE = 1e-4


def main() -> None:
    """Prints both rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, nargs="+", default=[7, 8], choices=[7, 8])
    parser.add_argument("--stops", type=int, default=300)
    parser.add_argument("--units", type=int, default=4)
    parser.add_argument("--folder", help="where the logs of row 7 are written: the disk that is measured")
    options = parser.parse_args()
    layout = resolve(FrameMap.model_validate(ROLES), read_layouts(DBC))
    print(f"sqlite {sqlite3.sqlite_version}, python-can {can.__version__}, zstandard {zstandard.__version__}")
    if 7 in options.rows:
        for rate_hz in (100, 1000):
            row_7(layout, rate_hz, options.stops, options.folder)
    if 8 in options.rows:
        for rate_hz in (100, 1000):
            for whole_us in (False, True):
                row_8(layout, rate_hz, whole_us, options.units)


def stop(layout: SensorLayout, rng: np.random.Generator, rate_hz: int, begun_ns: int, *, whole_us: bool) -> Frames:
    """Frames of one visit of one unit: 0.3 s of settling and 1 s of dwell in a random direction."""
    n = int(1.3 * rate_hz)
    direction = rng.normal(size=3)
    xyz = direction / np.linalg.norm(direction) + rng.normal(0, NOISE * np.sqrt(rate_hz / 2), (n, 3))
    time_ns = begun_ns + np.arange(n) * (10**9 // rate_hz) + rng.integers(0, 20_000, n)
    warm_ns = begun_ns + np.array([400_000_000]) + rng.integers(0, 20_000, 1)
    if whole_us:
        time_ns, warm_ns = time_ns // 1000 * 1000, warm_ns // 1000 * 1000
    readings = sample_frames(layout, 17, time_ns, xyz, first_count=int(rng.integers(15)))
    joined = Frames.join([readings, temperature_frames(layout, 17, warm_ns, np.array([24.3]))])
    return joined[np.argsort(joined.time_ns, kind="stable")]


def row_7(layout: SensorLayout, rate_hz: int, stops: int, folder: str | None) -> None:
    """Commit of one visit."""
    rng = np.random.default_rng(1)
    frames = [stop(layout, rng, rate_hz, 1_767_225_600_000_000_000, whole_us=False) for _ in range(NESTS)]
    statistics = [_statistics(rng) for _ in frames]
    ahead_s, placed = _placed(frames)
    ours, bare = list[float](), list[float]()
    used = (list[float](), list[float]())
    with tempfile.TemporaryDirectory(dir=folder) as place, SqliteStore(Path(place) / "station.db") as store:
        attempts = [store.begin(_begin(n)) for n in range(NESTS)]
        peer = sqlite3.connect(Path(place) / "bare.db", isolation_level=None)
        for setting in ("journal_mode = WAL", "synchronous = FULL"):
            peer.execute(f"PRAGMA {setting}")
        peer.execute("CREATE TABLE visit (id INTEGER PRIMARY KEY, statistics TEXT, frames BLOB)")
        same = [(plain_json.document(s), raw.to_bytes(f)) for s, f in zip(statistics, frames, strict=True)]
        for number in range(stops):
            records = [
                VisitRecord(0, number, "z-up", "home", "tumble", 1, 2, f, s, stored)
                for f, s, stored in zip(frames, statistics, placed, strict=True)
            ]
            for turn in (0, 1) if number % 2 else (1, 0):
                begun, busy = time.perf_counter(), time.process_time()
                if turn:
                    store.visit(attempts, records)
                else:
                    _bare(peer, same)
                (ours if turn else bare).append(time.perf_counter() - begun)
                used[turn].append(time.process_time() - busy)
        peer.close()
    kib = sum(len(s) + len(f) for s, f in same) / 1024
    what = f"commit of one visit, {NESTS} nests at {rate_hz} Hz ({kib:.0f} KiB)"
    ahead = f"frames laid out and hashed in the dwell, {ahead_s * 1e3:.2f} ms"
    print(f"row 7: {what}: {_middle(ours)} against a bare insert's {_middle(bare)}")
    print(f"  before it: {ahead} of processor in {len(LOOKS_S)} looks")
    print(f"  processor {np.median(used[1]) * 1e3:.2f} ms against {np.median(used[0]) * 1e3:.2f} ms")
    ratio, calm = np.median(ours) / np.median(bare), np.percentile(ours, 10) / np.percentile(bare, 10)
    late = np.median(ours[stops * 2 // 3 :]) / np.median(bare[stops * 2 // 3 :])
    mean = np.mean(ours) / np.mean(bare)
    how = f"medians of {stops}; last third {late:.2f}; calmest tenth {calm:.2f}; means {mean:.2f}"
    _ratio(ratio, 1.3, how)
    against = f"bare insert of the same bytes, sqlite {sqlite3.sqlite_version}, {np.median(bare) * 1e3:.2f} ms"
    figures.keep(7, f"{what}; {ahead}", f"{ratio:.2f} × ({how})", against, "<= 1.3 ×", bool(ratio <= 1.3))


def _placed(frames: Sequence[Frames]) -> tuple[float, list[raw.PlainFrames]]:
    """Median processor time, s, of laying out and hashing the frames of all nests look by look; what they come to."""
    used: list[float] = []
    placed: list[raw.PlainFrames] = []
    for _ in range(20):
        begun, placed = time.process_time(), []
        for one in frames:
            laying = raw.PlainFramesBuilder()
            cuts = np.searchsorted(one.time_ns, one.time_ns[0] + np.array(LOOKS_S[:-1]) * 1e9)
            for first, last in pairwise((0, *cuts.tolist(), len(one))):
                laying.add(one[first:last])
            placed.append(laying.done())
        used.append(time.process_time() - begun)
    return float(np.median(used)), placed


def _bare(peer: sqlite3.Connection, rows: Sequence[tuple[str, bytes]]) -> None:
    peer.execute("BEGIN IMMEDIATE")
    for row in rows:
        peer.execute("INSERT INTO visit (statistics, frames) VALUES (?, ?)", row)
    peer.execute("COMMIT")


def row_8(layout: SensorLayout, rate_hz: int, whole_us: bool, units: int) -> None:
    """Raw frames at rest."""
    ratios, sizes, count = [], np.zeros(3), 0
    for seed in range(units):
        rng = np.random.default_rng(seed)
        begun = 1_767_225_600_000_000_000
        parts = [stop(layout, rng, rate_hz, begun + v * 4 * 10**9, whole_us=whole_us) for v in range(POSITIONS)]
        size = np.array([len(codec.pack(parts)), *_peers(Frames.join(parts))])
        ratios.append(size[0] / size[1:].min())
        sizes += size
        count += sum(len(p) for p in parts)
    each = sizes / count
    stamps = "µs" if whole_us else "ns (candump's cut to µs)"
    print(
        f"row 8: raw frames at {rate_hz} Hz, time stamps in {stamps}: {each[0]:.2f} bytes a frame; "
        f"candump + zstd -19 {each[1]:.2f}, BLF {each[2]:.2f}"
    )
    ratio, how = float(np.median(ratios)), f"{units} units, {min(ratios):.3f} to {max(ratios):.3f}"
    _ratio(ratio, 0.5, f"median of {how}")
    peer = f"candump + zstd {zstandard.__version__} -19 {each[1]:.2f}, BLF {each[2]:.2f} bytes a frame"
    what = f"raw frames at rest, {rate_hz} Hz, time stamps in {stamps}"
    figures.keep(8, what, f"{ratio:.3f} × ({how}); {each[0]:.2f} bytes a frame", peer, "<= 0.5 ×", ratio <= 0.5)


def _peers(frames: Frames) -> tuple[int, int]:
    with tempfile.TemporaryDirectory() as folder:
        log, blf = Path(folder) / "unit.log", Path(folder) / "unit.blf"
        write_log(log, frames)
        write_log(blf, frames)
        return len(zstandard.ZstdCompressor(level=19).compress(log.read_bytes())), blf.stat().st_size


def _begin(nest: int) -> AttemptStart:
    same: dict[str, Any] = {
        "recipe_hash": "",
        "recipe_json": "",
        "config_hash": "",
        "software": "",
        "operator": "",
        "started_ns": 1,
    }
    return AttemptStart(f"SN{nest}", "bench", str(nest), 17 + nest, "tilt-24", 1, **same)


def _statistics(rng: np.random.Generator) -> dict[str, object]:
    floats = {name: rng.normal(size=3).tolist() for name in ("mean", "std")}
    counts = dict.fromkeys(("count", "frames", "gaps", "lost", "late", "repeats", "crc_errors", "kernel_drops"), 100)
    window = {"from_ns": 1_767_225_600_300_000_000, "to_ns": 1_767_225_601_300_000_000}
    return {**floats, **counts, **window, "temperature_degC": 24.31, "emergencies": [], "reasons": []}


def _middle(seconds: Sequence[float]) -> str:
    low, middle, high = np.percentile(np.array(seconds) * 1e3, [10, 50, 90])
    return f"{middle:.2f} ms (10-90 %: {low:.2f} to {high:.2f})"


def _ratio(ratio: float, goal: float, how: str) -> None:
    verdict = "reached" if ratio <= goal else "NOT reached"
    print(f"  ratio {ratio:.3f}   goal <= {goal}: {verdict}   ({how})")


if __name__ == "__main__":
    main()
