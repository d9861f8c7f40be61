"""SQLite's and the file system's complaints as one sentence each, with the remedy."""

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.errors import StationError

_SQLITE = {
    sqlite3.SQLITE_FULL: "the disk is full; free some space, then run the unit again",
    sqlite3.SQLITE_READONLY: "it is read-only; give the station the right to write the file and its folder",
    sqlite3.SQLITE_PERM: "access is denied; give the station the right to write the file and its folder",
    sqlite3.SQLITE_AUTH: "access is denied; give the station the right to write the file and its folder",
    sqlite3.SQLITE_BUSY: "another program holds it locked; close that program and try again",
    sqlite3.SQLITE_LOCKED: "another program holds it locked; close that program and try again",
    sqlite3.SQLITE_CORRUPT: "the file is damaged; keep it, run `station audit --verify`, and start a new log",
    sqlite3.SQLITE_NOTADB: "it is not a station log, or its first page is damaged; name another file",
    sqlite3.SQLITE_CANTOPEN: "it cannot be opened; check that the folder exists and may be written",
    sqlite3.SQLITE_IOERR: "the disk refused to read or write; check the disk and its free space",
    sqlite3.SQLITE_TOOBIG: "one record is larger than SQLite can keep (1 GB)",
}

_SYSTEM = {
    errno.ENOSPC: _SQLITE[sqlite3.SQLITE_FULL],
    errno.EDQUOT: _SQLITE[sqlite3.SQLITE_FULL],
    errno.EFBIG: _SQLITE[sqlite3.SQLITE_FULL],
    errno.EROFS: _SQLITE[sqlite3.SQLITE_READONLY],
    errno.EACCES: _SQLITE[sqlite3.SQLITE_PERM],
    errno.EPERM: _SQLITE[sqlite3.SQLITE_PERM],
    errno.ENOENT: "its folder does not exist; make it first",
    errno.EISDIR: "it is a folder; name a file",
    errno.ENOTDIR: "a part of its path is not a folder; name another file",
    errno.EIO: _SQLITE[sqlite3.SQLITE_IOERR],
}


@contextmanager
def translate_errors(kind: type[StationError], path: Path, doing: str) -> Iterator[None]:
    """Turns what SQLite or the system says about `path` into `kind`: "the log PATH cannot be DOING: WHY"."""
    try:
        yield
    except sqlite3.Error as exc:
        raise kind(f"the log {path} cannot be {doing}: {_why(exc)}") from exc
    except OSError as exc:
        raise kind(f"the log {path} cannot be {doing}: {os_error_reason(exc)}") from exc
    except OverflowError as exc:
        raise kind(f"the log {path} cannot be {doing}: a whole number is beyond 64 bits") from exc


def os_error_reason(exc: OSError) -> str:
    """The system's complaint with its remedy."""
    return _SYSTEM.get(exc.errno or 0, exc.strerror or str(exc))


def _why(exc: sqlite3.Error) -> str:
    code = getattr(exc, "sqlite_errorcode", 0)
    known = _SQLITE.get(code & 0xFF)
    return known or f"{exc}".replace("\n", " ")


def is_damage(exc: sqlite3.Error) -> bool:
    """Whether the file itself is damaged or tables are gone, so that what can be read is all there is."""
    code = getattr(exc, "sqlite_errorcode", 0) & 0xFF
    return code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR)
