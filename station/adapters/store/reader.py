"""Reads a log while another process writes it: what the page, the auditor and the reports ask. Changes nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.adapters.store import archive, audit_document, changes, file, search, unfinished, verify
from station.adapters.store.changes import LogChange
from station.adapters.store.search import Attempt, Query
from station.adapters.store.sqlite_errors import translate_errors
from station.adapters.store.yields import Yield, yields
from station.domain.core.types import Frames
from station.errors import LogError
from station.ports.store import LogHead, UnfinishedAttempt


@dataclass(frozen=True, slots=True)
class EventRecord:
    """One event as the log holds it; number is the cursor for the next call. attempt: "" for the station's own."""

    number: int
    attempt: str
    at_ns: int
    kind: str
    detail: str


class LogReader:
    """A log opened for reading. Every call sees what was committed before it. Errors: LogError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.db = file.open_for_reading(path)

    def close(self) -> None:
        """Closes the log; twice is harmless."""
        self.db.close()

    def __enter__(self) -> "LogReader":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def head(self) -> LogHead:
        """The newest record, to be printed on what is exported."""
        with self._told():
            number, seal = file.newest(self.db.conn, verify.log_id(self.db))
        return LogHead(number, seal.hex())

    def attempts(self, query: Query, limit: int | None = None) -> list[Attempt]:
        """Attempts that the query names, newest first."""
        with self._told():
            return list(search.attempts(self.db.conn, query, limit))

    def count(self, query: Query) -> int:
        """How many attempts the query names."""
        with self._told():
            return search.count(self.db.conn, query)

    def life(self, query: Query, limit: int | None = None) -> list[dict[str, Any]]:
        """The attempts that the query names with everything kept of them, oldest first."""
        with self._told():
            return audit_document.of_query(self.db.conn, query, limit)

    def attempt(self, attempt: Attempt) -> dict[str, Any]:
        """Everything kept of one attempt."""
        with self._told():
            return audit_document.of_attempt(self.db.conn, attempt)

    def running(self) -> Sequence[UnfinishedAttempt]:
        """Attempts that have begun and not ended, with what has been written to their devices."""
        with self._told():
            return [state for _, state in unfinished.find_unfinished(self.db.conn)]

    def events(self, after: int = 0, limit: int = 1000) -> list[EventRecord]:
        """Events with numbers beyond `after`, oldest first: call again with the last one's number."""
        query = """SELECT e.seq, coalesce(a.id, ''), e.at_ns, e.kind, e.detail FROM event e
            LEFT JOIN attempt a ON a.seq = e.attempt WHERE e.seq > ? ORDER BY e.seq LIMIT ?"""
        with self._told():
            return [EventRecord(*row) for row in self.db.execute(query, [after, limit])]

    def changes(self, after: int = 0, limit: int = 1000) -> list[LogChange]:
        """Records of attempts with numbers beyond `after`, oldest first: what a page needs to stay up to date."""
        with self._told():
            return changes.since(self.db.conn, after, limit)

    def yields(self, query: Query, by: str = "all") -> list[Yield]:
        """First-pass and final yield by station, nest, recipe, lot, operator or day."""
        with self._told():
            return yields(self.db.conn, query, by)

    def frames(self, attempt: Attempt) -> list[Frames]:
        """Raw frames of each visit of an attempt, in the order of its visits."""
        with self._told():
            return archive.frames(self.db.conn, attempt.number)

    def recipe_and_product(self, attempt: Attempt) -> tuple[str, str]:
        """The JSON of recipe and product as the attempt used them; "" where none was kept."""
        query = """SELECT coalesce(r.text, ''), coalesce(p.text, '') FROM attempt a
            LEFT JOIN document r ON r.seq = a.recipe LEFT JOIN document p ON p.seq = a.product WHERE a.seq = ?"""
        with self._told():
            recipe, product = self.db.execute(query, [attempt.number]).fetchone()
        return recipe, product

    def findings(self, trust: verify.Trust, progress: Any = None) -> Iterator[Any]:
        """Everything wrong with the log's chain."""
        yield from verify.findings(self.path, self.db, trust, progress or (lambda _number: None))

    def _told(self) -> Any:
        return translate_errors(LogError, self.path, "read")
