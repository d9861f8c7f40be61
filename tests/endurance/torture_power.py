"""Cuts the power at every fsync of a run: the log's files as they then stand on the disk must open, whole.

    python tests/endurance/torture_power.py [--every 1] [--seed 1] [--careless] [--json]

A simulated run of two units works with a library loaded before the C library (power_cut.c), which copies the log's
folder at each fsync and fdatasync. From the copies the files are restored in three ways: as last synced, each; with
all that had been written by then; and with a random choice of 512-byte sectors of what was written and not synced.
Faulty: the log cannot be opened, its chain is broken, or a record is missing whose call had returned before.
--careless lets SQLite commit without an fsync, which this must find.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "vcan")]

from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.errors import StationError
from station.ports.log_reader import Trust

NAME, SECTOR = "station.db", 512
#: What belongs to a disk: the index of the write-ahead log is shared memory, the lock is the process's.
SIDES = ("", "-wal", ".head")
MADE = ".new"
WAYS = ("synced", "written", "torn")
CALLS = ("begin", "event", "visit", "write", "result", "finish", "tidy")
Files = dict[str, bytes]


def work(folder: Path, out: Path, *, careless: bool) -> None:
    """The run, in the process that is watched: tells after each call of the store how far the log has come."""
    from tests.fakes import fixture_run

    def telling(name: str) -> None:
        call = getattr(SqliteStore, name)

        def shown(store: SqliteStore, *args: Any, **kwargs: Any) -> Any:
            returned = call(store, *args, **kwargs)
            print(len(list(out.glob("*.synced"))), store.head().number, flush=True)
            return returned

        setattr(SqliteStore, name, shown)

    def carelessly(store: SqliteStore) -> None:
        check(store)
        if careless:
            store._db.execute("PRAGMA synchronous = NORMAL")

    for name in CALLS:
        telling(name)
    store_class: Any = SqliteStore
    check, store_class._name_places = SqliteStore._name_places, carelessly
    fixture_run.run(folder, units=2, device_state=None)


def watched(folder: Path, out: Path, *, careless: bool) -> list[tuple[int, int]]:
    """Runs it with the library; (fsyncs so far, newest record) after each call of the store."""
    library = folder.parent / "power_cut.so"
    compiler = shutil.which("cc") or shutil.which("gcc")
    environment = dict(os.environ)
    if compiler is None:
        from vcan_harness import toolchain

        environment |= toolchain.compiler(folder.parent)
        compiler = environment["CC"]
    source = Path(__file__).with_name("power_cut.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl"], check=True)
    environment |= {"LD_PRELOAD": str(library), "POWER_CUT_FOLDER": str(folder), "POWER_CUT_OUT": str(out)}
    command = [sys.executable, __file__, "--work", str(folder), "--out", str(out), *["--careless"] * careless]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"the watched run broke off: {done.stderr[-2000:]}")
    return [(int(a), int(b)) for a, b in (line.split() for line in done.stdout.splitlines())]


def states(out: Path) -> Iterator[tuple[int, Files, Files]]:
    """At each fsync: its number, every file as last synced, and every file as written by then."""
    synced, made = Files(), b""
    for note in sorted(out.glob("*.synced")):
        copy = out / note.stem
        written = {side: (copy / f"{NAME}{side}").read_bytes() for side in SIDES if (copy / f"{NAME}{side}").exists()}
        side = note.read_text().removeprefix(NAME)
        if side == MADE:  # a new log is synced under this name; the folder's sync makes its own name durable
            made = (copy / f"{NAME}{MADE}").read_bytes()
        if side in written:
            synced = {**synced, side: written[side]}
        elif not side and written and "" not in synced:
            synced[""] = made
        yield int(note.stem), dict(synced), written


def torn(synced: Mapping[str, bytes], written: Files, rng: np.random.Generator) -> Files:
    """Any sectors of what was written since each file's last sync may have reached the disk."""
    files = {}
    for side, new in written.items():
        old = synced.get(side, b"")
        size = len(old) if rng.random() < 0.5 else len(new)
        data = bytearray(old.ljust(size, b"\0")[:size])
        for at in range(0, min(size, len(new)), SECTOR):
            if rng.random() < 0.5:
                data[at : at + SECTOR] = new[at : at + SECTOR][: size - at]
        files[side] = bytes(data)
    return files


def fault(files: Files, least: int, folder: Path) -> str:
    """'' when the restored log opens whole and holds its first `least` records; else what is wrong."""
    for side, data in files.items():
        (folder / f"{NAME}{side}").write_bytes(data)
    path = folder / NAME
    try:
        with SqliteStore(path) as store:
            number = store.head().number
        with SqliteLogReader(path) as log:
            found = [f.what for f in log.findings(Trust())]
    except StationError as error:
        return f"it does not open: {error.sentence}"
    if found:
        return f"its chain is broken: {found[:3]}"
    return f"{least - number} records are missing" if number < least else ""


def torture(every: int, seed: int, *, careless: bool) -> dict[str, Any]:
    """The counts."""
    begun_s = time.monotonic()
    rng = np.random.default_rng(seed)
    tried: Counter[str] = Counter()
    printed = []
    with tempfile.TemporaryDirectory() as name:
        folder, out = (Path(name) / part for part in ("run", "copies"))
        folder.mkdir()
        out.mkdir()
        acknowledged = watched(folder, out, careless=careless)
        every_state = list(states(out))
        for number, synced, written in every_state[seed % every :: every]:
            least = max((record for at, record in acknowledged if at <= number), default=0)
            if not acknowledged or acknowledged[0][0] > number:
                continue  # the log was not open yet: nothing was promised
            for way, files in zip(WAYS, (synced, written, torn(synced, written, rng)), strict=True):
                restored = Path(name) / "restored"
                restored.mkdir()
                if wrong := fault(files, least, restored):
                    printed.append(f"power cut at fsync {number}, {way}: {wrong}")
                shutil.rmtree(restored)
                tried[way] += 1
    return {
        "fsyncs": len(every_state),
        "tried": dict(tried),
        "faulty": len(printed),
        "seed": seed,
        "lasted_s": round(time.monotonic() - begun_s, 1),
        "said": printed,
    }


def main() -> int:
    """Prints the counts; 1 when a log was faulty."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--careless", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work:
        work(given.work, given.out, careless=given.careless)
        return 0
    shown = torture(given.every, given.seed, careless=given.careless)
    if given.json:
        print(json.dumps(shown))
        return int(shown["faulty"] > 0)
    cuts = sum(shown["tried"].values())
    print(f"power cuts at {shown['fsyncs']} fsyncs, {cuts} restored logs that lost a record, broke or did not open: "
          f"{shown['faulty']}   goal: 0   seed {shown['seed']}")  # fmt: skip
    print(f"  {shown['lasted_s']:.0f} s; {shown['tried']}")
    for line in shown["said"][:20]:
        print(f"  {line}")
    return int(shown["faulty"] > 0)


if __name__ == "__main__":
    sys.exit(main())
