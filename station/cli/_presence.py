"""Whether anybody serves the operator's page of a log: a shared lock that dies with the page's process."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.errors import StationFault


def _lock_path(database: Path) -> Path:
    return database.with_name(database.name + ".panel.lock")


@contextmanager
def serving(database: Path) -> Iterator[None]:
    """While it lasts, the page of this log is there; several may be. Errors: StationFault where no file can be made."""
    path = _lock_path(database)
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as exc:
        raise StationFault(f"{path} cannot be made ({exc.strerror}); the page keeps its lock beside the log") from exc
    try:
        fcntl.flock(handle, fcntl.LOCK_SH)
        yield
    finally:
        os.close(handle)


def is_served(database: Path) -> bool:
    """Whether a page of this log is there right now."""
    try:
        handle = os.open(_lock_path(database), os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
    return False
