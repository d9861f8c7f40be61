"""The records of a plant, or of those stations and products that the reader may see, through the log-reader port."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Any, Self

from station.adapters.postgres import questions, search, verify
from station.adapters.postgres.connections import connect, translate_errors, without_password
from station.domain.core.types import Frames
from station.domain.records.chain import IntegrityFinding
from station.domain.records.framepack import codec
from station.errors import LogError
from station.ports.log_reader import (
    NO_EXTRA_TRUST,
    AnchorState,
    Attempt,
    EventRecord,
    LogChange,
    LogRecord,
    Query,
    RecentFigures,
    ReducedAttempt,
    SelectedAttempt,
    Trust,
    Yield,
    ignore_progress,
)
from station.ports.objects import ObjectStore
from station.ports.store import LogHead, StoredCalibration, UnfinishedAttempt, WriteRecord

_NEWEST_PORTION = "SELECT first_seq + last - first, seal FROM batch ORDER BY first_seq DESC LIMIT 1"
_EVENTS = """SELECT e.seq, coalesce(a.id, ''), e.at_ns, e.kind, e.detail FROM event e
    LEFT JOIN attempt a ON a.seq = e.attempt WHERE e.seq > %s ORDER BY e.seq LIMIT %s"""
_DOCUMENTS = """SELECT coalesce(r.text, ''), coalesce(p.text, '') FROM attempt a
    LEFT JOIN document r ON r.seq = a.recipe LEFT JOIN document p ON p.seq = a.product WHERE a.seq = %s"""
_RUNNING = """SELECT a.seq, a.id, a.serial, a.station, a.nest, a.node, a.started_ns, coalesce(d.text, ''),
    coalesce((SELECT kind FROM event WHERE attempt = a.seq ORDER BY seq DESC LIMIT 1), ''),
    (SELECT count(*) FROM visit WHERE attempt = a.seq)
    FROM attempt a LEFT JOIN document d ON d.seq = a.product
    WHERE NOT EXISTS (SELECT 1 FROM finish f WHERE f.attempt = a.seq) ORDER BY a.seq"""
_REASONS = """SELECT DISTINCT ON (attempt) attempt, document::json -> 'reasons' FROM result
    WHERE attempt = ANY(%s) AND name = 'verdict' ORDER BY attempt, seq DESC"""
_WRITES = """SELECT object, sub, name, old, written, read_back, value, stage FROM write
    WHERE attempt = %s ORDER BY seq"""


class PostgresLogReader:
    """A plant opened for reading. open_objects: the store of raw frames at an address. Errors: LogError."""

    def __init__(self, address: str, open_objects: Callable[[str], ObjectStore]) -> None:
        self.location = without_password(address)
        self._open_objects = open_objects
        with self._errors_named():
            self.db = connect(address, read_only=True)
        try:
            with self._errors_named():
                known = self.db.execute("SELECT to_regclass('schema_version') IS NOT NULL").fetchone()
            if known != (True,):
                raise LogError("plant-schema-older", location=self.location)
        except LogError:
            self.db.close()
            raise

    def close(self) -> None:
        """Closes the connection; twice is harmless."""
        self.db.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def head(self) -> LogHead:
        """The plant's newest record and its seal."""
        with self._errors_named():
            row = self.db.execute(_NEWEST_PORTION).fetchone()
        return LogHead(int(row[0]), bytes(row[1]).hex()) if row else LogHead(0, "")

    def attempts(self, query: Query, limit: int | None = None) -> list[Attempt]:
        """Attempts that the query names, newest first."""
        with self._errors_named():
            return list(search.attempts(self.db, query, limit))

    def count(self, query: Query) -> int:
        """How many attempts the query names."""
        with self._errors_named():
            return search.count(self.db, query)

    def life(self, query: Query, limit: int | None = None) -> list[dict[str, Any]]:
        """The attempts that the query names with everything kept of them, oldest first."""
        with self._errors_named():
            return questions.lives_of(self.db, list(search.attempts(self.db, query, limit))[::-1])

    def attempt(self, attempt: Attempt) -> dict[str, Any]:
        """Everything kept of one attempt."""
        with self._errors_named():
            return questions.lives_of(self.db, [attempt])[0]

    def lives(self, attempts: Sequence[Attempt]) -> list[dict[str, Any]]:
        """Everything kept of each attempt."""
        with self._errors_named():
            return questions.lives_of(self.db, attempts)

    def reasons(self, numbers: Sequence[int]) -> dict[int, list[dict[str, Any]]]:
        """The reasons of the verdicts of those attempts, by their record numbers."""
        with self._errors_named():
            rows = self.db.execute(_REASONS, [list(numbers)]).fetchall()
        return {int(number): reasons for number, reasons in rows if reasons}

    def config(self, attempt: Attempt) -> str:
        """The JSON of the settings of that attempt; "" where none was kept."""
        query = "SELECT text FROM document WHERE kind = 'config' AND sha256 = %s LIMIT 1"
        with self._errors_named():
            row = self.db.execute(query, [attempt.config_hash]).fetchone()
        return str(row[0]) if row else ""

    def records(self, attempt: Attempt) -> list[LogRecord]:
        """LogError: the seals of single records follow each other in the station's own log."""
        raise LogError("evidence-at-station", attempt=attempt.attempt, station=attempt.station)

    def running(self) -> Sequence[UnfinishedAttempt]:
        """Attempts that have begun and not ended, with what has been written to their devices."""
        with self._errors_named():
            return [self._unfinished(*row) for row in self.db.execute(_RUNNING).fetchall()]

    def _unfinished(self, number: int, *columns: Any) -> UnfinishedAttempt:
        *begun, product, event, visits = columns
        writes = tuple(WriteRecord(*row) for row in self.db.execute(_WRITES, [number]).fetchall())
        attempt, serial, station, nest, node, started_ns = begun
        return UnfinishedAttempt(attempt, serial, station, nest, node, started_ns, event, visits, writes, product)

    def events(self, after: int = 0, limit: int = 1000) -> list[EventRecord]:
        """Events with numbers beyond `after`, oldest first: call again with the last one's number."""
        with self._errors_named():
            return [EventRecord(*row) for row in self.db.execute(_EVENTS, [after, limit])]

    def station_events(self, kind: str, newest: int) -> list[EventRecord]:  # noqa: ARG002
        """None: a plant holds many stations, and their states mixed would be nobody's."""
        return []

    def changes(self, after: int = 0, limit: int = 1000) -> list[LogChange]:
        """Records of attempts with numbers beyond `after`, oldest first: what a page needs to stay up to date."""
        with self._errors_named():
            return questions.changes(self.db, after, limit)

    def changed_days(self, after: int) -> frozenset[int]:
        """Days since 1970 (UTC) whose yields the records beyond `after` may have altered."""
        with self._errors_named():
            return questions.changed_days(self.db, after)

    def yields(self, query: Query, by: str = "all") -> list[Yield]:
        """First-pass and final yield by station, nest, recipe, lot, operator or day."""
        with self._errors_named():
            return questions.yields(self.db, query, by)

    def recent(self, units: int, visits: int) -> RecentFigures:
        """Figures of the newest so many units that passed and of the newest so many visits."""
        with self._errors_named():
            return questions.recent(self.db, units, visits)

    def frames(self, attempt: Attempt) -> list[Frames]:
        """Raw frames of each visit of an attempt, in the order of its visits."""
        with self._errors_named():
            row = self.db.execute("SELECT data FROM archive WHERE attempt = %s", [attempt.number]).fetchone()
        if row is None:
            raise LogError("plant-frames-later", attempt=attempt.attempt)
        return codec.unpack(self._objects().get(bytes(row[0])))

    def recipe_and_product(self, attempt: Attempt) -> tuple[str, str]:
        """The JSON of recipe and product as the attempt used them; "" where none was kept."""
        with self._errors_named():
            row = self.db.execute(_DOCUMENTS, [attempt.number]).fetchone()
        return (row[0], row[1]) if row else ("", "")

    def reduced(self, numbers: Sequence[int]) -> list[ReducedAttempt]:
        """Those of the attempts that came to a calibration, in the order of their records."""
        with self._errors_named():
            return list(questions.reduced(self.db, numbers))

    def calibrations(self, recipe_hash: str, newest: int) -> list[StoredCalibration]:
        """Of the newest so many attempts with this recipe those that came to a calibration, oldest first."""
        with self._errors_named():
            return questions.query_calibrations(self.db, recipe_hash, newest)

    def document(self, number: int) -> str:
        """The text that a document record holds."""
        with self._errors_named():
            row = self.db.execute("SELECT text FROM document WHERE seq = %s", [number]).fetchone()
        return str(row[0]) if row else ""

    def selection(self, query: Query) -> Iterator[SelectedAttempt]:
        """Attempts that the query names and that have ended, one at a time, in the order of their records."""
        with self._errors_named():
            yield from search.selection(self.db, query)

    def recipes(self, query: Query) -> list[str]:
        """The JSON of every recipe that those attempts were made with; "" where none was kept."""
        with self._errors_named():
            return search.recipes(self.db, query)

    def anchors(self, trust: Trust = NO_EXTRA_TRUST) -> dict[str, AnchorState]:  # noqa: ARG002
        """Nothing: a plant's anchors are the stations' logs, which are compared whenever records come."""
        return {}

    def acknowledgements(self) -> list[dict[str, Any]]:
        """Every time that somebody went on with a log against its heads: at_ns, by, reason, findings."""
        query = "SELECT at_ns, detail FROM event WHERE attempt IS NULL AND kind = 'log-acknowledged' ORDER BY seq"
        with self._errors_named():
            return [{"at_ns": at_ns} | json.loads(detail) for at_ns, detail in self.db.execute(query)]

    def findings(
        self,
        trust: Trust = NO_EXTRA_TRUST,  # noqa: ARG002
        progress: Callable[[int], None] = ignore_progress,
    ) -> Iterator[IntegrityFinding]:
        """Everything wrong with the chains of all stations; progress is called with a record's number now and then."""
        with self._errors_named():
            yield from verify.findings(self.db, self._objects(), progress)

    def _objects(self) -> ObjectStore:
        row = self.db.execute("SELECT value FROM setting WHERE name = 'objects'").fetchone()
        return self._open_objects(str(row[0]) if row else "frames")

    def _errors_named(self) -> AbstractContextManager[None]:
        return translate_errors(LogError, self.location, "plant-database-read")
