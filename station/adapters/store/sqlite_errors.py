"""SQLite's and the file system's complaints as messages, each with its remedy."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from station.errors import StationError
from station.files.system_errors import os_error_reason
from station.messages import Message

Doing = Literal["opened", "read", "written"]

_SENTENCES = {"opened": "log-not-opened", "read": "log-not-read", "written": "log-not-written"}

_SQLITE = {
    sqlite3.SQLITE_FULL: "log-disk-full",
    sqlite3.SQLITE_READONLY: "log-read-only",
    sqlite3.SQLITE_PERM: "log-no-permission",
    sqlite3.SQLITE_AUTH: "log-no-permission",
    sqlite3.SQLITE_BUSY: "log-locked",
    sqlite3.SQLITE_LOCKED: "log-locked",
    sqlite3.SQLITE_CORRUPT: "log-damaged",
    sqlite3.SQLITE_NOTADB: "log-no-database",
    sqlite3.SQLITE_CANTOPEN: "log-no-access",
    sqlite3.SQLITE_IOERR: "log-disk-error",
    sqlite3.SQLITE_TOOBIG: "log-record-too-large",
}


@contextmanager
def translate_errors(kind: type[StationError], path: Path, doing: Doing) -> Iterator[None]:
    """Turns what SQLite or the system reports about `path` into `kind`: "The log PATH cannot be DOING: WHY."."""
    try:
        yield
    except sqlite3.Error as exc:
        raise kind(_refusal(doing, path, sqlite_reason(exc))) from exc
    except OSError as exc:
        raise kind(_refusal(doing, path, os_error_reason(exc))) from exc
    except OverflowError as exc:
        raise kind(_refusal(doing, path, Message("log-number-too-large"))) from exc


def _refusal(doing: Doing, path: Path, reason: Message) -> Message:
    return Message(_SENTENCES[doing], path=str(path), reason=reason)


def sqlite_reason(exc: sqlite3.Error) -> Message:
    """SQLite's complaint with its remedy."""
    id_ = _SQLITE.get(getattr(exc, "sqlite_errorcode", 0) & 0xFF)
    return Message(id_) if id_ else Message.text(" ".join(f"{exc}".split()))


def is_damage(exc: sqlite3.Error) -> bool:
    """Whether the file itself is damaged or tables are gone, so that what can be read is all there is."""
    code = getattr(exc, "sqlite_errorcode", 0) & 0xFF
    return code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR)
