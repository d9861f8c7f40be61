"""One log, one owner: a lock that dies with its process, so that nothing stale ever blocks a start."""

import fcntl
import json
import os
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Self

from station.adapters.store.faults import told
from station.errors import StoreFault


class Owner:
    """Holds `<log>.lock` (flock) as long as it lives; the file says who: name, pid, start time.

    Errors: StoreFault naming the present owner when there is one.
    """

    def __init__(self, log: Path, name: str, started_ns: int) -> None:
        self._path = log.with_name(log.name + ".lock")
        with told(StoreFault, log, "locked"):
            self._handle = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as exc:
            present = self._present()
            os.close(self._handle)
            raise StoreFault(
                f"the log {log} is in use by {present}; one log has one owner, stop that one first"
            ) from exc
        try:
            with told(StoreFault, log, "locked"):
                self._say(name, started_ns)
        except StoreFault:
            self.release()
            raise

    def release(self) -> None:
        """Gives the log free; twice is harmless. The lock file stays: removing it would race with the next owner."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, exc: BaseException | None, tb: TracebackType | None) -> None:
        self.release()

    def _say(self, name: str, started_ns: int) -> None:
        text = json.dumps({"name": name, "pid": os.getpid(), "started_ns": started_ns})
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, text.encode(), 0)

    def _present(self) -> str:
        try:
            said = json.loads(os.pread(self._handle, 4096, 0))
            since = datetime.fromtimestamp(said["started_ns"] / 1e9).astimezone()
            return f"{said['name']} (pid {said['pid']}) since {since:%Y-%m-%d %H:%M:%S}"
        except (ValueError, KeyError, TypeError):
            return "another process, which is just starting"
