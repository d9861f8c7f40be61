"""What people did at the page: an append-only file of JSON lines, each holding the hash of the one before."""

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from fcntl import LOCK_EX, flock
from pathlib import Path
from typing import Any

from station.errors import LogError, StoreFault

SCHEMA = "station.panel-journal/1"
_FIRST = "0" * 64


@dataclass(frozen=True, slots=True)
class Journal:
    """The page's own record; runs write theirs into the log. now: the clock."""

    path: Path
    now: Callable[[], datetime] = lambda: datetime.now(UTC)

    def add(self, person: str, deed: str, **detail: Any) -> None:
        """Appends one line and waits until it is on the disk. Errors: StoreFault: what cannot be kept is not done."""
        try:
            with self.path.open("a+b", buffering=0) as file:
                flock(file, LOCK_EX)
                line = {
                    "schema": SCHEMA,
                    "at": self.now().isoformat(timespec="milliseconds"),
                    "person": person,
                    "deed": deed,
                    "detail": detail,
                    "previous": _last(file.fileno()),
                }
                file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
                os.fsync(file.fileno())
        except OSError as exc:
            raise StoreFault(f"{self.path} cannot be written ({exc.strerror}); free the disk, then try again") from exc

    def lines(self) -> Iterator[dict[str, Any]]:
        """Every line, oldest first. Errors: LogError at the first that does not follow from the one before."""
        previous = _FIRST
        if not self.path.exists():
            return
        with self.path.open("rb") as file:
            for number, raw in enumerate(file, 1):
                try:
                    line: dict[str, Any] = json.loads(raw)
                    follows = line["previous"] == previous
                except (ValueError, KeyError, TypeError):
                    follows = False
                if not follows:
                    raise LogError(f"{self.path}: line {number} does not follow from the one before; it was edited")
                previous = hashlib.sha256(raw).hexdigest()
                yield line


def _last(handle: int) -> str:
    """SHA-256 of the newest line."""
    size = os.fstat(handle).st_size
    if size == 0:
        return _FIRST
    tail = os.pread(handle, 65536, max(0, size - 65536))
    return hashlib.sha256(tail.splitlines(keepends=True)[-1]).hexdigest()
