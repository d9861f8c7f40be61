"""One thing, one owner: a lock that dies with its process, so that nothing stale ever blocks a start."""

import json
import os
import time
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from station.errors import StationError, StoreFault
from station.files.json_text import parse_json
from station.files.lock import take
from station.files.system_errors import os_error_reason
from station.messages import Message

#: So long a start waits for an owner that has the thing for a moment only, looking again every so often.
_BRIEF_S, _AGAIN_S = 3.0, 0.02


class OwnerLock:
    """Holds `lock` (flock) as long as it lives; the file says who: name, pid, start time.

    what: what is owned, as a part of a sentence (Message("owned-log", path="station.db")). fault: the type of
    the errors, which name the present owner when there is one. mode: of the lock file. Who may open it may hold it,
    so a log's is for the station's user and group alone (0660); only what every user of the machine may own has 0666.
    brief: owned for a moment, and whoever comes meanwhile waits for it.
    """

    def __init__(
        self,
        lock: Path,
        what: Message,
        name: str,
        started_ns: int,
        fault: type[StationError] = StoreFault,
        mode: int = 0o660,
        *,
        brief: bool = False,
    ) -> None:
        self._what, self._fault = what, fault
        try:
            self._handle = _open(lock, mode)
        except OSError as exc:
            raise self._lock_error(exc) from exc
        try:
            self._take()
        except BlockingIOError as exc:
            present = self._present()
            os.close(self._handle)
            raise fault("in-use", what=what, owner=present) from exc
        try:
            self._sign(name, started_ns, brief=brief)
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

    def _take(self) -> None:
        """Takes the lock, after a brief owner. Errors: BlockingIOError."""
        until_s = time.monotonic() + _BRIEF_S
        while True:
            try:
                return take(self._handle)
            except BlockingIOError:
                if not self._read().get("brief") or time.monotonic() > until_s:
                    raise
                time.sleep(_AGAIN_S)

    def _sign(self, name: str, started_ns: int, *, brief: bool) -> None:
        own = {"name": name, "pid": os.getpid(), "started_ns": started_ns}
        text = json.dumps(own | ({"brief": True} if brief else {}))
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, text.encode(), 0)

    def _lock_error(self, exc: OSError) -> StationError:
        return self._fault("lock-not-taken", what=self._what, reason=os_error_reason(exc))

    def _present(self) -> Message:
        try:
            owner = self._read()
            since = f"{datetime.fromtimestamp(owner['started_ns'] / 1e9).astimezone():%Y-%m-%d %H:%M:%S}"
            return Message("owner-process", name=str(owner["name"]), pid=int(owner["pid"]), since=since)
        except (ValueError, KeyError, TypeError):
            return Message("owner-starting")

    def _read(self) -> dict[str, Any]:
        """What the file says of the owner; nothing while it is being written."""
        try:
            owner = parse_json(os.pread(self._handle, 4096, 0))
        except ValueError:
            return {}
        return owner if isinstance(owner, dict) else {}


def _open(lock: Path, mode: int) -> int:
    """The lock file, with that mode where it is this user's; never what a link of its name points at, for it is
    written over."""
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        handle = os.open(lock, flags)
    except FileNotFoundError:
        handle = os.open(lock, flags | os.O_CREAT, mode)
    if os.fstat(handle).st_uid == os.geteuid():
        os.fchmod(handle, mode)
    return handle
