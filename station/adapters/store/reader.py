"""Reads a log while another process writes it: what the page, the auditor and the reports ask. Changes nothing."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Self

from station.adapters.store import (
    archive,
    audit_document,
    changes,
    file,
    line_records,
    recent,
    reduced,
    sealed_rows,
    search,
    unfinished,
    verify,
)
from station.adapters.store.log_anchors import acknowledgements
from station.adapters.store.sqlite_errors import translate_errors
from station.adapters.store.yields import yields
from station.domain.core.types import Frames
from station.domain.records.chain import IntegrityFinding
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
from station.ports.store import LogHead, StoredCalibration, UnfinishedAttempt


class SqliteLogReader:
    """A log opened for reading. Every call sees what was committed before it. Errors: LogError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.location = str(path)
        self.db = file.open_for_reading(path)

    def close(self) -> None:
        """Closes the log; twice is harmless."""
        self.db.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def head(self) -> LogHead:
        """The newest record, to be printed on what is exported."""
        with self._errors_named():
            number, seal = file.newest(self.db.conn, verify.log_id(self.db))
        return LogHead(number, seal.hex())

    def attempts(self, query: Query, limit: int | None = None) -> list[Attempt]:
        """Attempts that the query names, newest first."""
        with self._errors_named():
            return list(search.attempts(self.db.conn, query, limit))

    def count(self, query: Query) -> int:
        """How many attempts the query names."""
        with self._errors_named():
            return search.count(self.db.conn, query)

    def life(self, query: Query, limit: int | None = None) -> list[dict[str, Any]]:
        """The attempts that the query names with everything kept of them, oldest first."""
        with self._errors_named():
            return audit_document.of_query(self.db.conn, query, limit)

    def attempt(self, attempt: Attempt) -> dict[str, Any]:
        """Everything kept of one attempt."""
        with self._errors_named():
            return audit_document.of_attempt(self.db.conn, attempt)

    def lives(self, attempts: Sequence[Attempt]) -> list[dict[str, Any]]:
        """Everything kept of each attempt."""
        with self._errors_named():
            return [audit_document.of_attempt(self.db.conn, attempt) for attempt in attempts]

    def running(self) -> Sequence[UnfinishedAttempt]:
        """Attempts that have begun and not ended, with what has been written to their devices."""
        with self._errors_named():
            return [state for _, state in unfinished.find_unfinished(self.db.conn)]

    def events(self, after: int = 0, limit: int = 1000) -> list[EventRecord]:
        """Events with numbers beyond `after`, oldest first: call again with the last one's number."""
        query = """SELECT e.seq, coalesce(a.id, ''), e.at_ns, e.kind, e.detail FROM event e
            LEFT JOIN attempt a ON a.seq = e.attempt WHERE e.seq > ? ORDER BY e.seq LIMIT ?"""
        with self._errors_named():
            return [EventRecord(*row) for row in self.db.execute(query, [after, limit])]

    def station_events(self, kind: str, newest: int) -> list[EventRecord]:
        """The newest events of the station itself of one kind, oldest first."""
        with self._errors_named():
            return line_records.newest_events(self.db.conn, kind, newest)

    def changes(self, after: int = 0, limit: int = 1000) -> list[LogChange]:
        """Records of attempts with numbers beyond `after`, oldest first: what a page needs to stay up to date."""
        with self._errors_named():
            return changes.since(self.db.conn, after, limit)

    def changed_days(self, after: int) -> frozenset[int]:
        """Days since 1970 (UTC) whose yields the records beyond `after` may have altered."""
        with self._errors_named():
            return changes.changed_days(self.db.conn, after)

    def yields(self, query: Query, by: str = "all") -> list[Yield]:
        """First-pass and final yield by station, nest, recipe, lot, operator or day."""
        with self._errors_named():
            return yields(self.db.conn, query, by)

    def frames(self, attempt: Attempt) -> list[Frames]:
        """Raw frames of each visit of an attempt, in the order of its visits."""
        with self._errors_named():
            return archive.frames(self.db.conn, attempt.number)

    def recipe_and_product(self, attempt: Attempt) -> tuple[str, str]:
        """The JSON of recipe and product as the attempt used them; "" where none was kept."""
        query = """SELECT coalesce(r.text, ''), coalesce(p.text, '') FROM attempt a
            LEFT JOIN document r ON r.seq = a.recipe LEFT JOIN document p ON p.seq = a.product WHERE a.seq = ?"""
        with self._errors_named():
            recipe, product = self.db.execute(query, [attempt.number]).fetchone()
        return recipe, product

    def reasons(self, numbers: Sequence[int]) -> dict[int, list[dict[str, Any]]]:
        """The reasons of the verdicts of those attempts, by their record numbers."""
        with self._errors_named():
            return search.verdict_reasons(self.db.conn, numbers)

    def records(self, attempt: Attempt) -> list[LogRecord]:
        """Every sealed record of that attempt, and the documents that it names, in the order of their numbers."""
        with self._errors_named():
            return sorted(sealed_rows.of_attempt(self.db.conn, attempt), key=lambda record: record.number)

    def config(self, attempt: Attempt) -> str:
        """The JSON of the settings of that attempt; "" where none was kept."""
        query = "SELECT text FROM document WHERE kind = 'config' AND sha256 = ?"
        with self._errors_named():
            row = self.db.execute(query, [attempt.config_hash]).fetchone()
        return row[0] if row else ""

    def recent(self, units: int, visits: int) -> RecentFigures:
        """Figures of the newest so many units that passed and of the newest so many visits."""
        with self._errors_named():
            return recent.figures(self.db.conn, units, visits)

    def reduced(self, numbers: Sequence[int]) -> list[ReducedAttempt]:
        """Those of the attempts that came to a calibration, in the order of their records."""
        with self._errors_named():
            return reduced.read(self.db.conn, numbers)

    def calibrations(self, recipe_hash: str, newest: int) -> list[StoredCalibration]:
        """Of the newest so many attempts with this recipe those that came to a calibration, oldest first."""
        with self._errors_named():
            return reduced.read_calibrations(self.db.conn, recipe_hash, newest)

    def document(self, number: int) -> str:
        """The text that a document record holds."""
        with self._errors_named():
            return reduced.document(self.db.conn, number)

    def selection(self, query: Query) -> Iterator[SelectedAttempt]:
        """Attempts that the query names and that have ended, one at a time, in the order of their records."""
        with self._errors_named():
            yield from search.selection(self.db.conn, query)

    def recipes(self, query: Query) -> list[str]:
        """The JSON of every recipe that those attempts were made with; "" where none was kept."""
        with self._errors_named():
            return search.recipes(self.db.conn, query)

    def anchors(self, trust: Trust = NO_EXTRA_TRUST) -> dict[str, AnchorState]:
        """What each place that keeps a head of the log says of it, the file beside it first."""
        with self._errors_named():
            return verify.compared(self.db, verify.anchors_of(self.path, trust))

    def acknowledgements(self) -> list[dict[str, Any]]:
        """Every time that somebody went on with the log against its heads: at_ns, by, reason, findings."""
        with self._errors_named():
            return acknowledgements(self.db.conn)

    def findings(
        self, trust: Trust = NO_EXTRA_TRUST, progress: Callable[[int], None] = ignore_progress
    ) -> Iterator[IntegrityFinding]:
        """Everything wrong with the log's chain; progress is called with the record's number now and then."""
        yield from verify.findings(self.path, self.db, trust, progress)

    def _errors_named(self) -> AbstractContextManager[None]:
        return translate_errors(LogError, self.path, "read")
