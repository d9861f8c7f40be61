"""One thing, one owner: a lock that dies with its process, so that nothing stale ever blocks a start."""

import json
import os
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Self

from station.errors import StationError, StoreFault
from station.files.lock import take
from station.files.system_errors import os_error_reason
from station.messages import Message


class OwnerLock:
    """Holds `lock` (flock) as long as it lives; the file says who: name, pid, start time.

    what: what is owned, as a part of a sentence (Message("owned-log", path="station.db")). fault: the type of
    the errors, which name the present owner when there is one.
    """

    def __init__(
        self, lock: Path, what: Message, name: str, started_ns: int, fault: type[StationError] = StoreFault
    ) -> None:
        self._what, self._fault = what, fault
        try:
            self._handle = _open(lock)
        except OSError as exc:
            raise self._lock_error(exc) from exc
        try:
            take(self._handle)
        except BlockingIOError as exc:
            present = self._present()
            os.close(self._handle)
            raise fault("in-use", what=what, owner=present) from exc
        try:
            self._sign(name, started_ns)
        except OSError as exc:
            self.release()
            raise self._lock_error(exc) from exc

    def release(self) -> None:
        """Gives the log free; twice is harmless. The lock file stays: removing it would race with the next owner."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, exc: BaseException | None, tb: TracebackType | None) -> None:
        self.release()

    def _sign(self, name: str, started_ns: int) -> None:
        text = json.dumps({"name": name, "pid": os.getpid(), "started_ns": started_ns})
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, text.encode(), 0)

    def _lock_error(self, exc: OSError) -> StationError:
        return self._fault("lock-not-taken", what=self._what, reason=os_error_reason(exc))

    def _present(self) -> Message:
        try:
            owner = json.loads(os.pread(self._handle, 4096, 0))
            since = f"{datetime.fromtimestamp(owner['started_ns'] / 1e9).astimezone():%Y-%m-%d %H:%M:%S}"
            return Message("owner-process", name=str(owner["name"]), pid=int(owner["pid"]), since=since)
        except (ValueError, KeyError, TypeError):
            return Message("owner-starting")


def _open(lock: Path) -> int:
    """The lock file; made so that the station may be started by another user next time."""
    try:
        return os.open(lock, os.O_RDWR | os.O_CLOEXEC)
    except FileNotFoundError:
        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        os.fchmod(handle, 0o666)
        return handle
