"""What people did at the page: an append-only file of JSON lines, each holding the hash of the one before."""

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from station.errors import LogError, StoreFault
from station.files import lock
from station.files.json_text import parse_json
from station.files.ordinary import open_ordinary
from station.messages import system_reason

SCHEMA = "station.panel-journal/1"
_FIRST_PREVIOUS = "0" * 64


@dataclass(frozen=True, slots=True)
class Journal:
    """The page's own record; runs write theirs into the log. now: the clock."""

    path: Path
    now: Callable[[], datetime] = lambda: datetime.now(UTC)

    def add(self, person: str, deed: str, **detail: Any) -> None:
        """Appends one line and waits until it is on the disk. Errors: StoreFault: what cannot be kept is not done."""
        try:
            handle = open_ordinary(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
            with os.fdopen(handle, "a+b", buffering=0) as file:
                lock.wait_for(file.fileno())
                _end_torn_line(file)
                line = {
                    "schema": SCHEMA,
                    "at": self.now().isoformat(timespec="milliseconds"),
                    "person": person,
                    "deed": deed,
                    "detail": detail,
                    "previous": _last_hash(file.fileno()),
                }
                file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
                os.fsync(file.fileno())
        except OSError as exc:
            raise StoreFault("file-not-written", file=str(self.path), why=system_reason(exc)) from exc

    def lines(self) -> Iterator[dict[str, Any]]:
        """Every line, oldest first; what a power cut left of one comes as the deed `torn`.

        Errors: LogError at the first line that does not follow from the one before.
        """
        previous = _FIRST_PREVIOUS
        if not self.path.is_file():
            return
        with self.path.open("rb") as file:
            for number, raw in enumerate(file, 1):
                line = _parse_line(raw, previous)
                if line["previous"] != previous:
                    raise LogError("journal-edited", file=str(self.path), line=number)
                previous = hashlib.sha256(raw).hexdigest()
                yield line


def _parse_line(raw: bytes, previous: str) -> dict[str, Any]:
    """A line; one that is none stands as torn, and whether it always did, the line after it tells."""
    try:
        line: dict[str, Any] = parse_json(raw)
        return {"at": "", "person": "", "deed": "", "detail": {}, "previous": "", **line}
    except (ValueError, TypeError):
        text = raw.decode("utf-8", "replace")[:200]
        return {"at": "", "person": "", "deed": "torn", "detail": {"text": text}, "previous": previous}


def _end_torn_line(file: IO[bytes]) -> None:
    """What a power cut left of a line keeps its place in the chain; the next one begins on its own."""
    size = os.fstat(file.fileno()).st_size
    if size and os.pread(file.fileno(), 1, size - 1) != b"\n":
        file.write(b"\n")


def _last_hash(handle: int) -> str:
    """SHA-256 of the newest line, however long it is."""
    size = os.fstat(handle).st_size
    if size == 0:
        return _FIRST_PREVIOUS
    back = 65536
    while True:
        tail = os.pread(handle, back, max(0, size - back))
        begins = tail.rfind(b"\n", 0, len(tail) - 1) + 1
        if begins or back >= size:
            return hashlib.sha256(tail[begins:]).hexdigest()
        back *= 4
