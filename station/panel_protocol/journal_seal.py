"""The page's journal sealed into the log: whoever cuts or edits it afterwards is found by `station audit --verify`.

Each line of the journal holds the hash of the one before, so the hash of one line vouches for all up to it. The newest
line is sealed as an event of the station: when a page or a run begins and ends, with each signature, and in between so
that no line waits long.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from station.domain.records.chain import IntegrityFinding
from station.errors import LogError, StationError
from station.messages import Message
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.journal import Journal
from station.ports.log_reader import LogReader
from station.ports.store import Store

SEALED_EVENT = "journal-sealed"
#: So much of what was written since the last seal is looked at; that holds more than as many lines as may wait.
_MOST_LOOKED_AT = 1 << 20
#: More seals than any log holds.
_ALL = 1 << 40


#: A line is sealed so long after it was written at the latest, or when so many wait.
LONGEST_UNSEALED_S, MOST_UNSEALED_LINES = 60.0, 50


@dataclass(frozen=True, slots=True)
class JournalState:
    """lines: how many the journal has; sealed: how many of them the log vouches for."""

    lines: int
    sealed: int


@dataclass(slots=True)
class UnsealedLines:
    """How many lines the journal got since it was sealed, and since when."""

    database: Path
    _sealed_bytes: int = 0
    _since_s: float | None = None

    def due(self, now_s: float) -> bool:
        """Whether the journal is to be sealed. now_s: of a clock that does not step back."""
        lines = self._count()
        if not lines:
            self._since_s = None
            return False
        self._since_s = now_s if self._since_s is None else self._since_s
        return lines >= MOST_UNSEALED_LINES or now_s - self._since_s >= LONGEST_UNSEALED_S

    def size(self) -> int:
        """Bytes of the journal as it is, for `sealed`."""
        with suppress(OSError):
            return companion_file(self.database, Companion.JOURNAL).stat().st_size
        return 0

    def sealed(self, size: int) -> None:
        """Everything up to there is sealed."""
        self._sealed_bytes, self._since_s = size, None

    def _count(self) -> int:
        path = companion_file(self.database, Companion.JOURNAL)
        with suppress(OSError):
            if path.is_file():
                with path.open("rb") as file:
                    file.seek(self._sealed_bytes)
                    return file.read(_MOST_LOOKED_AT).count(b"\n")
        return 0


@dataclass(frozen=True, slots=True)
class JournalSealer:
    """Seals the journal while this process has the log open."""

    store: Store
    database: Path
    unsealed: UnsealedLines

    def seal(self) -> None:
        """Seals now. Errors: StoreFault."""
        size = self.unsealed.size()
        seal_journal(self.store, self.database)
        self.unsealed.sealed(size)

    def step(self, now_s: float) -> None:
        """Seals when it is due. now_s: of a clock that does not step back."""
        if self.unsealed.due(now_s):
            with suppress(StationError):  # a log that cannot be written says so itself
                self.seal()


@contextmanager
def sealing_journal(store: Store, database: Path) -> Iterator[JournalSealer]:
    """Seals the journal now and at the end, while the log is open. Errors: StoreFault of the beginning."""
    sealer = JournalSealer(store, database, UnsealedLines(database))
    sealer.seal()
    try:
        yield sealer
    finally:
        with suppress(StationError):  # a log that cannot be written has said so already
            sealer.seal()


def seal_journal(store: Store, database: Path) -> None:
    """Seals the newest line, where there is a new one. Errors: StoreFault."""
    hashes = list(_hashes(companion_file(database, Companion.JOURNAL)))
    newest = {"lines": len(hashes), "sha256": hashes[-1] if hashes else ""}
    before = store.station_events(SEALED_EVENT, 1)
    if dict(before[-1][2] if before else {"lines": 0, "sha256": ""}) != newest:
        store.event("", SEALED_EVENT, newest)


def journal_findings(log: LogReader, database: Path) -> tuple[JournalState, list[IntegrityFinding]]:
    """How far the log vouches for the journal, and where the journal is not what was sealed. Errors: LogError."""
    path = companion_file(database, Companion.JOURNAL)
    hashes = list(_hashes(path))
    seals = [(event.number, _detail(event.detail)) for event in log.station_events(SEALED_EVENT, _ALL)]
    found = [*_chain(path), *(f for number, seal in seals for f in _against(path, number, seal, hashes))]
    sealed = max((seal["lines"] for _, seal in seals), default=0)
    return JournalState(len(hashes), min(sealed, len(hashes))), found[:1]  # the others follow from the first


def _chain(path: Path) -> Iterator[IntegrityFinding]:
    """The journal against itself."""
    try:
        for _ in Journal(path).lines():
            pass
    except LogError as error:
        yield IntegrityFinding("edited", "journal", 0, error.message)


def _against(path: Path, number: int, seal: Mapping[str, Any], hashes: list[str]) -> Iterator[IntegrityFinding]:
    """The journal against one seal, of that record."""
    lines = seal["lines"]
    where = {"file": str(path), "lines": lines, "number": number}
    if lines > len(hashes):
        yield IntegrityFinding("truncated", "journal", number, Message("journal-cut", **where, left=len(hashes)))
    elif lines and hashes[lines - 1] != seal["sha256"]:
        yield IntegrityFinding("edited", "journal", number, Message("journal-not-as-sealed", **where))


def _detail(text: str) -> dict[str, Any]:
    stored = json.loads(text)
    return {"lines": int(stored["lines"]), "sha256": str(stored["sha256"])}


def _hashes(path: Path) -> Iterator[str]:
    """SHA-256 of each whole line."""
    if not path.is_file():
        return
    with suppress(FileNotFoundError), path.open("rb") as file:
        for line in file:
            if line.endswith(b"\n"):
                yield hashlib.sha256(line).hexdigest()
