"""The log as a SQLite file: every method of the store port is one durable transaction of sealed records."""

import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from station.adapters.store import anchor, archive, column_values, file, ids, keys, line_records, reduced, unfinished
from station.adapters.store.anchor import AnchorPlace, WitnessPlace
from station.adapters.store.log_anchors import (
    ACKNOWLEDGED_EVENT,
    NOTED_CLOCK_BACK_S,
    PLACES_EVENT,
    Acknowledgement,
    LogAnchors,
    StoredLogEnd,
    check_clock,
    clock_step_s,
    detail_of,
    known_places,
    last_witnessed,
)
from station.adapters.store.record_writer import RecordWriter
from station.adapters.store.schema import COLUMNS
from station.adapters.store.sqlite_errors import translate_errors
from station.domain.records import plain_json
from station.domain.records.framepack import plain as raw
from station.domain.records.head import AnchorFinding
from station.domain.records.key_schedule import rotation_statement
from station.domain.records.merkle import Tree
from station.domain.records.tree_head import WITNESSED_EVENT
from station.errors import StationError, StoreFault
from station.files.owner import OwnerLock
from station.files.real_path import real_path
from station.files.system_errors import os_error_reason
from station.messages import Message, render
from station.ports.store import (
    AttemptStart,
    LogHead,
    StoredCalibration,
    SuspectAttempt,
    UnfinishedAttempt,
    VisitRecord,
    WriteRecord,
)


class SqliteStore:
    """Implements `ports.store.Store` on one file, which belongs to this process until `close`.

    owner: the station's name, which the lock tells a second process. epoch_ns: the clock of events, results and writes.
    signer: the station's key, or None. anchors: where its head is kept beside `<log>.head`. A log that a head speaks
    against is refused unless an engineer's acknowledgement is sealed into it. brief: owned for a moment only. Safe to
    call from several threads. Errors: StoreFault.
    """

    def __init__(
        self,
        path: Path,
        owner: str = "station",
        epoch_ns: Callable[[], int] = time.time_ns,
        signer: keys.Signer | None = None,
        busy_s: float = 5.0,
        anchors: Sequence[AnchorPlace] = (),
        acknowledgement: Acknowledgement | None = None,
        witness: WitnessPlace | None = None,
        old_signer: keys.Signer | None = None,
        *,
        brief: bool = False,
    ) -> None:
        self.path = path = real_path(path)  # one log, one owner, by whatever link it is reached
        self._epoch_ns, self._signer = epoch_ns, signer
        self._open: dict[str, int] = {}
        with ExitStack() as opened, translate_errors(StoreFault, path, "opened"):
            if not path.name:
                raise StoreFault("log-not-opened", path=str(path), reason=Message("log-is-folder"))
            lock = path.with_name(path.name + ".lock")
            owned = Message("owned-log", path=str(path))
            opened.callback(OwnerLock(lock, owned, owner, time.time_ns(), brief=brief).release)
            inode = opened.enter_context(ExitStack())  # let go after the database: closing a handle ends SQLite's locks
            self._db = file.open_for_writing(path, busy_s)
            opened.callback(self._db.close)
            inode.callback(os.close, file.own_inode(path))
            self._head_file = anchor.HeadFile(path)
            self._anchors = LogAnchors((self._head_file, *anchors, *([witness] if witness else ())))
            self._witness, self._tree = witness, Tree(partial(file.seals, self._db))
            self._witnessed, self._replaces = last_witnessed(self._db), ""
            keep = partial(self._anchors.keep, durable=False)
            self._records = RecordWriter(path, self._db, owner, signer, epoch_ns, keep)
            found = self._anchors.check(self._db, self._records.log_id)
            found += [*keys.check_signer(self._db, signer, old_signer), *check_clock(self._db, epoch_ns())]
            if found and acknowledgement is None:
                raise _refusal(path, found)
            self._refuse_without_head(self._head_file.open)
            opened.callback(self._head_file.close)
            self._opened = opened.pop_all()
        if found and acknowledgement:  # before any head is written over: they are the evidence
            with self._records.transaction():
                self._name_key(old_signer)
                self._records.event(None, ACKNOWLEDGED_EVENT, detail_of(acknowledgement, found))
            self._replaces = self._anchors.end_known_to(witness)
        self._keep_head(durable=True)
        with self._records.transaction():
            self._name_key(old_signer)
        self._name_places()
        if (behind_s := clock_step_s(self._db, epoch_ns())) > NOTED_CLOCK_BACK_S:
            self.event("", "clock-back", {"seconds": behind_s})
        self.tidy()

    def _refuse_without_head(self, step: Callable[[], None]) -> None:
        try:
            step()
        except OSError as exc:
            raise StoreFault("head-file-not-written", path=str(self.path), reason=os_error_reason(exc)) from exc

    def begin(self, begin: AttemptStart) -> str:
        """Creates the attempt before the device is touched; returns its UUIDv7."""
        self._keep_head(durable=False)
        self._refuse_without_head(self._head_file.check_in_place)
        if fault := self._anchors.faults.get(self._head_file.name):
            raise StoreFault("head-file-not-written", path=str(self.path), reason=fault)
        attempt = ids.uuid7(self._epoch_ns())
        with self._records.transaction():
            recipe = self._document("recipe", begin.recipe_json)
            product = self._document("product", begin.product_json)
            self._document("config", begin.config_json)
            columns = column_values.columns(begin, attempt, recipe, product)
            number = self._records.append("attempt", *(columns[name] for name in COLUMNS["attempt"]))
            self._records.note_head()
        self._open[attempt] = number
        return attempt

    def event(self, attempt: str, kind: str, detail: Mapping[str, Any]) -> None:
        """Appends an event, which may still come after the finish; attempt "": it is about the station."""
        with self._records.transaction():
            of = self._of(attempt) if attempt else None
            self._records.event(of, kind, detail)

    def visit(self, attempts: Sequence[str], visits: Sequence[VisitRecord]) -> None:
        """Keeps one visit of every nest, in one transaction."""
        packed = [v.encoded or raw.to_plain(v.frames) for v in visits]
        rows = [column_values.visit(v, plain) for v, plain in zip(visits, packed, strict=True)]
        with self._records.transaction():
            visits_of = [(self._running(a), *row) for a, row in zip(attempts, rows, strict=True)]
            numbers = self._records.append_all("visit", visits_of)
            frames = [(number, one.data) for number, one in zip(numbers, packed, strict=True)]
            self._records.insert("frames", "INSERT INTO frames VALUES (?, ?)", frames)

    def write(self, attempt: str, *stages: WriteRecord) -> None:
        """Keeps stages of object writes: the intent before, the fact after, and with it the intent of the next."""
        with self._records.transaction():
            for one in stages:
                self._records.append(
                    "write",
                    *(self._running(attempt), self._epoch_ns(), one.index, one.sub, plain_json.text(one.name)),
                    *(one.stage, plain_json.number(one.value), one.old, one.written, one.read_back),
                )

    def result(self, attempt: str, name: str, document: Mapping[str, Any]) -> None:
        """Keeps a named result."""
        with self._records.transaction():
            self._records.append(
                "result",
                self._running(attempt),
                self._epoch_ns(),
                plain_json.text(name),
                plain_json.document(document),
            )

    def finish(self, attempt: str, outcome: str, ended_ns: int) -> None:
        """Closes the attempt; when this returns, the record is on the disk."""
        with self._records.transaction():
            number = self._records.append("finish", self._running(attempt), str(outcome), ended_ns)
            seal = self._records.hash
            self._records.note_head()
        self._read_back(number, seal)
        del self._open[attempt]
        self._keep_head(durable=True)

    def _read_back(self, number: int, seal: bytes) -> None:
        """The record stands in the file as it was sealed: nothing is shown as passed on the word of a commit alone."""
        with self._records.turn():
            row = self._db.execute("SELECT hash FROM finish WHERE seq = ?", (number,)).fetchone()
        self._records.check_in_place()
        if row is None or bytes(row[0]) != seal:
            raise StoreFault("log-finish-missing", path=str(self.path), number=number)

    def tidy(self) -> None:
        """Packs the raw frames of finished attempts. What fails stays plain, and the next call tries again."""
        with self._records.turn():
            waiting = archive.unpacked_attempts(self._db)
        for attempt in waiting:
            with suppress(StationError):
                self._archive(attempt)
        if self._witness and self._signer and (self._replaces or self._ended_beyond(self._witnessed)):
            self._show_witness(self._witness)

    def unfinished(self) -> tuple[UnfinishedAttempt, ...]:
        """Attempts without an end, oldest first; they may be written to and finished like any other."""
        with self._records.turn():
            open_attempts = unfinished.find_unfinished(self._db)
        self._open.update({u.attempt: number for number, u in open_attempts})
        return tuple(u for _, u in open_attempts)

    def suspect(self, serial: str) -> SuspectAttempt | None:
        """The unit's last attempt that may have left it half written."""
        with self._records.turn():
            return unfinished.find_suspect(self._db, plain_json.text(serial))

    def dwells(self, recipe_hash: str, newest: int) -> Sequence[Mapping[str, Any]]:
        """Results `dwell` of the newest attempts with a recipe, oldest first."""
        with self._records.turn():
            return reduced.dwells(self._db, recipe_hash, newest)

    def calibrations(self, recipe_hash: str, newest: int) -> Sequence[StoredCalibration]:
        """Calibrations of the newest attempts with a recipe, oldest first."""
        with self._records.turn():
            return reduced.read_calibrations(self._db, recipe_hash, newest)

    def station_events(self, kind: str, newest: int) -> Sequence[tuple[int, int, Mapping[str, Any]]]:
        """The newest events of the station itself of one kind, oldest first."""
        with self._records.turn():
            found = line_records.newest_events(self._db, plain_json.text(kind), newest)
        return [(event.number, event.at_ns, json.loads(event.detail)) for event in found]

    def outcomes(self, serial: str, nest: str, beyond: int) -> Sequence[str]:
        """Outcomes of the unit's finished attempts in that nest after that record, oldest first."""
        with self._records.turn():
            return line_records.outcomes(self._db, plain_json.text(serial), plain_json.text(nest), beyond)

    def head(self) -> LogHead:
        """The newest record's number and seal."""
        return LogHead(self._records.number, self._records.hash.hex())

    def close(self) -> None:
        """Folds the write-ahead log into the file and gives the log free; twice is harmless."""
        with self._records.turn():
            self._opened.close()

    def __enter__(self) -> "SqliteStore":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _document(self, kind: str, text: str) -> int | None:
        """The record that holds this text, made when it is the first time."""
        if not text:
            return None
        key = hashlib.sha256(text.encode()).hexdigest()
        row = self._db.execute("SELECT seq FROM document WHERE sha256 = ?", (key,)).fetchone()
        if row is not None:
            return int(row[0])
        return self._records.append("document", key, kind, text)

    def _name_key(self, old: keys.Signer | None) -> None:
        """Inside the open transaction: the log says once, as a record, with what key it is signed from here on."""
        if self._signer is None:
            return
        named = keys.named_public_key(self._db)
        if named != self._signer.public_key or not keys.signs_heads(self._db):
            detail = {"public_key": self._signer.public_key.hex(), "heads": True}
            if old and named and named != self._signer.public_key:
                statement = rotation_statement(self._records.log_id, named, self._signer.public_key)
                detail["by_old"] = old.sign(statement).hex()
            self._records.event(None, keys.KEY_EVENT, detail)

    def _archive(self, attempt: int) -> None:
        """Packs an attempt's raw frames into one record, in place of the plain ones."""
        with self._records.turn():
            data = archive.pack_frames(self._db, attempt)
        if data is None:
            return
        with self._records.transaction():
            self._records.append("archive", attempt, archive.count_visits(self._db, attempt), data)
            archive.drop_plain(self._db, attempt)

    def _of(self, attempt: str) -> int:
        number = self._open.get(attempt)
        if number is None:
            row = self._db.execute("SELECT seq FROM attempt WHERE id = ?", (attempt,)).fetchone()
            if row is None:
                raise StoreFault("log-no-attempt", path=str(self.path), attempt=attempt)
            number = int(row[0])
        return number

    def _running(self, attempt: str) -> int:
        if attempt not in self._open:
            raise StoreFault("log-attempt-not-running", path=str(self.path), attempt=attempt)
        return self._open[attempt]

    def _ended_beyond(self, number: int) -> int:
        with self._records.turn():
            return StoredLogEnd(self._db, self._records.log_id).finishes_beyond(number)

    def _show_witness(self, witness: WitnessPlace) -> None:
        """In the pause after a load; the receipt becomes a record. A witness that is away is shown more next time."""
        with self._records.turn():
            head = self._records.head()
        try:
            receipt = witness.submit(head, self._tree, self._replaces)
        except OSError as error:
            if witness.name not in self._anchors.faults:
                self._anchors.faults[witness.name] = Message.text(str(error))
                self.event("", "anchor-unwritten", {"place": witness.name, "reason": str(error)})
            return
        self._anchors.faults.pop(witness.name, None)
        self._replaces = ""
        self.event("", WITNESSED_EVENT, {"place": witness.name} | asdict(receipt))
        self._witnessed = self._records.number

    def _name_places(self) -> None:
        """The log says, as a record, in what folders its heads are kept: one that is emptied then shows."""
        places = frozenset(place.name for place in self._anchors.places if place.lags)
        if places != known_places(self._db):
            self.event("", PLACES_EVENT, {"places": sorted(places)})

    def _keep_head(self, *, durable: bool) -> None:
        """The record is kept already and a head that lags is still true: a fault stops only the next begin."""
        with self._records.turn():
            failed = self._anchors.keep(self._records.head(), durable=durable)
        for place in failed:
            if place != self._head_file.name:
                self.event("", "anchor-unwritten", {"place": place, "reason": render(self._anchors.faults[place])})


def _refusal(path: Path, found: Sequence[AnchorFinding]) -> StoreFault:
    return StoreFault("log-against-anchors", path=str(path), findings=[f.message for f in found])
