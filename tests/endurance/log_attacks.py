"""Intelligent edits of a signed log by somebody with its files, with and without its key: found, and refused.

    python tests/endurance/log_attacks.py [--trials 2000] [--seed 1] [--json]

Each trial takes a log of eight loads with one anchor folder elsewhere, does one thing to it behind the station's back,
and asks twice: does `--verify` find it with that anchor and the pinned key; does the next run refuse the log? A clock
that was set back leaves nothing in the log to be found: of it only the run's refusal counts.
"""

import argparse
import json
import shutil
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

sys.path[:0] = [str(Path(__file__).parents[2])]

from station.adapters.store import schema
from station.adapters.store.anchor import AnchorFolder, head_file_path
from station.adapters.store.keys import Signer
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.domain.records import chain
from station.domain.records.head import SealedHead
from station.errors import StationError
from station.ports.log_reader import Trust
from tests.fakes import logs

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
SIGNER = Signer(KEY.sign, KEY.public_key().public_bytes_raw())
FORGER_KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(1, 33)))
FORGER = Signer(FORGER_KEY.sign, FORGER_KEY.public_key().public_bytes_raw())
LOADS = 8
#: What the fixture's station last wrote (tests.fakes.logs).
YEAR_NS = 365 * 86_400 * 10**9


@dataclass
class Place:
    """One trial's copy: the log, the anchor elsewhere, states of earlier days, another station's log, one that somebody
    made with a key of their own; signer, epoch_ns: with what the next run comes."""

    log: Path
    share: AnchorFolder
    earlier: list[Path]
    other: Path
    forged: Path
    signer: Signer = SIGNER
    epoch_ns: Callable[[], int] = time.time_ns


def prepare(folder: Path) -> None:
    """The log after each load, and a stranger's."""
    line, share = folder / "line", folder / "share"
    line.mkdir(parents=True)
    share.mkdir()
    anchor = AnchorFolder(share, "bench-station")
    for number in range(LOADS):
        with SqliteStore(line / "station.db", "bench", signer=SIGNER, anchors=[anchor]) as store:
            for unit in range(2):
                logs.unit(store, f"SN{number}{unit}", outcome="PASS" if unit else "FAIL")
            store.tidy()
            shutil.copy(line / "station.db-wal", folder / f"{number}.wal")
        shutil.copytree(line, folder / "earlier" / str(number))
        shutil.move(folder / f"{number}.wal", folder / "earlier" / str(number) / "wal-of-then")
    for name, signer in (("other", SIGNER), ("forged", FORGER)):
        (folder / name).mkdir()
        with SqliteStore(folder / name / "station.db", "bench", signer=signer) as store:
            for number in range(20):
                logs.unit(store, f"X{number}")


@contextmanager
def trial(template: Path) -> Iterator[Place]:
    """A fresh copy of everything."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "t"
        shutil.copytree(template, folder)
        earlier = sorted((folder / "earlier").iterdir(), key=lambda p: int(p.name))
        share = AnchorFolder(folder / "share", "bench-station")
        yield Place(folder / "line" / "station.db", share, earlier, folder / "other", folder / "forged")


@contextmanager
def unguarded(path: Path) -> Iterator[sqlite3.Connection]:
    """The log without its triggers, which are put back exactly."""
    db = sqlite3.connect(path, isolation_level=None)
    triggers = db.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
    for name, _ in triggers:
        db.execute(f"DROP TRIGGER {name}")
    try:
        yield db
    finally:
        for _, sql in triggers:
            db.execute(sql)
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        db.close()


def records(db: sqlite3.Connection) -> list[tuple[int, str]]:
    """Number and table of every record, in order."""
    parts = (f"SELECT seq, '{table}' FROM {table}" for table in schema.COLUMNS)
    return db.execute(f"{' UNION ALL '.join(parts)} ORDER BY 1").fetchall()


def rebuild(db: sqlite3.Connection, first: int, *, signed: bool) -> tuple[int, bytes, bytes]:
    """The chain made anew from a record on; the newest number, seal and signature."""
    before = [number for number, _ in records(db) if number < first]
    seal = seal_of(db, before[-1]) if before else genesis(db)
    signature, number = b"", first - 1
    for number, table in records(db):
        if number < first:
            continue
        names = schema.COLUMNS[table]
        values = db.execute(f"SELECT {', '.join(names)} FROM {table} WHERE seq = ?", (number,)).fetchone()
        previous, seal = seal, chain.link(seal, chain.canonical(table, names, values))
        old = db.execute(f"SELECT signature FROM {table} WHERE seq = ?", (number,)).fetchone()[0]
        signature = KEY.sign(seal) if signed else old
        row = (previous, seal, signature, number)
        db.execute(f"UPDATE {table} SET previous = ?, hash = ?, signature = ? WHERE seq = ?", row)
    note(db)
    return number, seal, signature


def genesis(db: sqlite3.Connection) -> bytes:
    return chain.genesis(db.execute("SELECT value FROM meta WHERE key = 'log_id'").fetchone()[0])


def seal_of(db: sqlite3.Connection, number: int) -> bytes:
    table = dict(records(db))[number]
    return bytes(db.execute(f"SELECT hash FROM {table} WHERE seq = ?", (number,)).fetchone()[0])


def note(db: sqlite3.Connection) -> None:
    """The log's own note of how far it has come, made to agree."""
    number = db.execute("SELECT max(seq) FROM (SELECT seq FROM attempt UNION SELECT seq FROM finish)").fetchone()[0]
    db.execute("UPDATE head SET number = ?, hash = ?", (number, seal_of(db, number)))


def keep_head(log: Path, number: int, seal: bytes, signature: bytes) -> None:
    """The head file, made to agree."""
    old = SealedHead.parse(head_file_path(log).read_text())
    head_file_path(log).write_text(SealedHead(old.log_id, old.station, number, seal.hex(), signature.hex()).line())


def cut_tail(place: Place, rng: np.random.Generator, *, whole_attempts: bool = True) -> None:
    """The newest attempts deleted, with an older genuine head: no key needed."""
    with unguarded(place.log) as db:
        starts = [n for n, table in records(db) if table == "attempt"]
        first = int(starts[-int(rng.integers(1, 6))]) + (0 if whole_attempts else 2)
        gone = [(n, table) for n, table in records(db) if n >= first]
        for number, table in reversed(gone):
            db.execute(f"DELETE FROM {table} WHERE seq = ?", (number,))
        last, table = records(db)[-1]
        signature = db.execute(f"SELECT signature FROM {table} WHERE seq = ?", (last,)).fetchone()[0]
        note(db)
        keep_head(place.log, last, seal_of(db, last), signature)


def edit_and_rebuild(place: Place, rng: np.random.Generator, *, signed: bool) -> None:
    """A verdict, a name or a time altered, and the chain made anew from there on."""
    edits = (
        ("finish", "outcome", "'PASS'", "outcome = 'FAIL'"),
        ("attempt", "operator", "'nobody'", "1"),
        ("attempt", "started_ns", "started_ns - 86400000000000", "1"),
        ("result", "document", "'{}'", "name = 'verdict'"),
        ("visit", "statistics", "'{}'", "1"),
    )
    table, column, value, where = edits[int(rng.integers(len(edits)))]
    with unguarded(place.log) as db:
        numbers = [n for (n,) in db.execute(f"SELECT seq FROM {table} WHERE {where}")]
        number = int(numbers[int(rng.integers(len(numbers)))])
        db.execute(f"UPDATE {table} SET {column} = {value} WHERE seq = ?", (number,))
        keep_head(place.log, *rebuild(db, number, signed=signed))


def drop_record(place: Place, rng: np.random.Generator) -> None:
    """With the key: a result or visit taken out of the middle, and everything after it signed again."""
    with unguarded(place.log) as db:
        own = [(n, table) for n, table in records(db) if table in ("result", "visit", "write")]
        number, table = own[int(rng.integers(len(own)))]
        db.execute(f"DELETE FROM {table} WHERE seq = ?", (number,))
        keep_head(place.log, *rebuild(db, number + 1, signed=True))


def restore(place: Place, rng: np.random.Generator, *, head: bool) -> None:
    """The state of an earlier day put back, with or without its head file."""
    day = place.earlier[int(rng.integers(LOADS - 1))]
    for file in place.log.parent.glob("station.db*"):
        if head or not file.name.endswith(".head"):
            file.unlink()
    for file in day.glob("station.db*"):
        if head or not file.name.endswith(".head"):
            shutil.copy(file, place.log.parent)


def exchange(place: Place, rng: np.random.Generator, *, head: bool) -> None:
    """Another log under this one's name."""
    for file in place.log.parent.glob("station.db*"):
        if head or not file.name.endswith(".head"):
            file.unlink()
    for file in place.other.iterdir():
        if head or not file.name.endswith(".head"):
            shutil.copy(file, place.log.parent)


def spoil_head(place: Place, rng: np.random.Generator) -> None:
    """The head file lost, emptied, zero, foreign, unsigned, older or nonsense."""
    path = head_file_path(place.log)
    head = SealedHead.parse(path.read_text())
    older = SealedHead.parse((place.earlier[int(rng.integers(LOADS - 2))] / "station.db.head").read_text())
    texts = (
        None,
        "",
        "{}",
        SealedHead(head.log_id, head.station, 0, "00" * 32).line(),
        SealedHead("another", head.station, head.number, head.hash, head.signature).line(),
        SealedHead(head.log_id, head.station, head.number, head.hash).line(),
        SealedHead(head.log_id, head.station, head.number + 3, head.hash, head.signature).line(),
        older.line(),
    )
    text = texts[int(rng.integers(len(texts)))]
    if text is None:
        path.unlink()
    else:
        path.write_text(text)


def spoil_schema(place: Place, rng: np.random.Generator) -> None:
    """A trigger, view or index added, or a guard exchanged."""
    table = list(schema.COLUMNS)[int(rng.integers(len(schema.COLUMNS)))]
    statements = (
        f"CREATE TRIGGER t BEFORE INSERT ON {table} BEGIN SELECT RAISE(IGNORE); END",
        f"CREATE TRIGGER t AFTER INSERT ON {table} BEGIN DELETE FROM {table} WHERE seq = NEW.seq; END",
        f"CREATE VIEW v AS SELECT * FROM {table}",
        f"CREATE INDEX i ON {table}(hash)",
        f"DROP TRIGGER {table}_no_update",
        f"DROP TRIGGER {table}_no_delete;CREATE TRIGGER {table}_no_delete BEFORE DELETE ON {table} BEGIN SELECT 1; END",
        "CREATE TABLE shadow (a)",
    )
    db = sqlite3.connect(place.log)
    db.executescript(statements[int(rng.integers(len(statements)))])
    db.close()


def vanish(place: Place, rng: np.random.Generator) -> None:
    """The log removed or emptied, its head left."""
    for ending in ("-wal", "-shm"):
        place.log.with_name(place.log.name + ending).unlink(missing_ok=True)
    if rng.integers(2):
        place.log.unlink()
    else:
        place.log.write_bytes(b"")


def exchange_with_key(place: Place, rng: np.random.Generator) -> None:
    """Log, head and the station's key, all of somebody's own making."""
    for file in place.log.parent.glob("station.db*"):
        file.unlink()
    for file in place.forged.iterdir():
        shutil.copy(file, place.log.parent)
    place.signer = FORGER


def old_wal(place: Place, rng: np.random.Generator) -> None:
    """The write-ahead log of an earlier day laid beside today's log: SQLite takes any that is whole in itself."""
    shutil.copy(place.earlier[int(rng.integers(LOADS - 1))] / "wal-of-then", f"{place.log}-wal")


def old_wal_and_head(place: Place, rng: np.random.Generator) -> None:
    """The same with the log and the head of that day."""
    restore(place, rng, head=True)
    old_wal(place, rng)


def folder_by_link(place: Place, rng: np.random.Generator) -> None:
    """The log's folder exchanged for a link to an earlier day's."""
    place.log.parent.rename(place.log.parent.with_name("line-of-today"))
    place.log.parent.symlink_to(place.earlier[int(rng.integers(LOADS - 1))])


def swap_roots(place: Place, rng: np.random.Generator) -> None:
    """Two indices exchanged by the pages where they begin: no definition changes, and questions go astray."""
    db = sqlite3.connect(place.log)
    rows = db.execute("SELECT name, rootpage FROM sqlite_master WHERE type = 'index' AND sql <> ''").fetchall()
    first, second = (rows[int(i)] for i in rng.choice(len(rows), 2, replace=False))
    db.execute("PRAGMA writable_schema = ON")
    for (name, _), (_, page) in ((first, second), (second, first)):
        db.execute("UPDATE sqlite_master SET rootpage = ? WHERE name = ?", (page, name))
    db.commit()
    db.close()


def set_clock_back(place: Place, rng: np.random.Generator) -> None:
    """The next run comes years before the newest record."""
    years = int(rng.integers(1, 11))
    place.epoch_ns = lambda: logs.begin().started_ns - years * YEAR_NS


Attack = Callable[[Place, np.random.Generator], None]
ATTACKS: dict[str, Attack] = {
    "tail cut, older genuine head": cut_tail,
    "tail cut within an attempt": lambda p, r: cut_tail(p, r, whole_attempts=False),
    "backup restored with its head": lambda p, r: restore(p, r, head=True),
    "backup restored, head of today": lambda p, r: restore(p, r, head=False),
    "edited, chain rebuilt, old signatures": lambda p, r: edit_and_rebuild(p, r, signed=False),
    "edited, chain rebuilt, with the key": lambda p, r: edit_and_rebuild(p, r, signed=True),
    "record dropped, chain rebuilt, with the key": drop_record,
    "another log with its head": lambda p, r: exchange(p, r, head=True),
    "another log under this head": lambda p, r: exchange(p, r, head=False),
    "head file spoilt": spoil_head,
    "schema altered": spoil_schema,
    "log removed or emptied": vanish,
    "log, head and key of somebody's own making": exchange_with_key,
    "old write-ahead log, log of today": old_wal,
    "old write-ahead log, log and head of then": old_wal_and_head,
    "folder a link to an earlier day's": folder_by_link,
    "indices exchanged by their pages": swap_roots,
    "clock set back by years": set_clock_back,
}
#: They leave nothing in the log.
ONLY_REFUSED = frozenset({"clock set back by years"})


def found(place: Place) -> bool:
    """Whether `--verify` says anything, with the anchor elsewhere and the pinned key."""
    try:
        with SqliteLogReader(place.log) as log:
            heads = {place.share.name: place.share.read()}
            return any(True for _ in log.findings(Trust(public_key=SIGNER.public_key, anchors=heads)))
    except StationError:
        return True


def refused(place: Place) -> bool:
    """Whether the next run refuses the log."""
    try:
        SqliteStore(place.log, "bench", place.epoch_ns, place.signer, anchors=[place.share]).close()
    except StationError:
        return True
    return False


def attack(trials: int, seed: int) -> dict[str, tuple[int, int, int]]:
    """By kind: trials, found, refused."""
    rng = np.random.default_rng(seed)
    counts = {name: [0, 0, 0] for name in ATTACKS}
    with tempfile.TemporaryDirectory() as name:
        template = Path(name) / "template"
        prepare(template)
        for number in range(trials):
            kind = list(ATTACKS)[number % len(ATTACKS)]
            with trial(template) as place:
                ATTACKS[kind](place, rng)
                row = counts[kind]
                row[0] += 1
                row[1] += kind in ONLY_REFUSED or found(place)
                row[2] += refused(place)
    return {kind: (row[0], row[1], row[2]) for kind, row in counts.items()}


def main() -> int:
    """Prints the table; 1 where anything stayed unseen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    began_s = time.monotonic()
    rows = attack(options.trials, options.seed)
    total = [sum(row[i] for row in rows.values()) for i in range(3)]
    if options.json:
        missed = [f"{kind}: {row}" for kind, row in rows.items() if len(set(row)) > 1]
        print(json.dumps(dict(zip(("trials", "found", "refused"), total, strict=True)) | {"said": missed}))
        return int(bool(missed))
    for kind, (count, observed, stopped) in rows.items():
        print(f"{kind:45s} {count:5d} tried {observed:5d} found {stopped:5d} refused")
    print(f"{'all, goal: all found, all refused':45s} {total[0]:5d} tried {total[1]:5d} found {total[2]:5d} refused")
    print(f"seed {options.seed}, {time.monotonic() - began_s:.0f} s")
    return 0 if total[0] == total[1] == total[2] else 1


if __name__ == "__main__":
    sys.exit(main())
