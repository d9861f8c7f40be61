"""Units scanned and not yet in work, nest by nest; kept in a file, so that a page started again forgets none."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from threading import Lock

from station.errors import StoreFault
from station.files.replace import replace_text

SCHEMA = "station.queue/1"


@dataclass(frozen=True, slots=True)
class WaitingUnit:
    """A unit that waits for the start. beside: pid of the run whose load was in the nests when it was scanned, or 0."""

    serial: str
    beside: int = 0


@dataclass(frozen=True, slots=True)
class QueueState:
    """waiting: nest → unit of the next load. handed: what was handed to the run `pid`, which has not begun it yet."""

    waiting: Mapping[str, WaitingUnit]
    handed: Mapping[str, WaitingUnit]
    pid: int = 0


class LoadQueue:
    """The units of the next load; safe to call from several threads. Errors: StoreFault, and then nothing changed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._turn = Lock()
        self._stamp: tuple[int, int] | None = None
        self._state = QueueState({}, {})

    @property
    def _current(self) -> QueueState:
        """As the file says: another page on the same log may have changed it."""
        stamp = _file_stamp(self._path)
        if stamp != self._stamp:
            self._stamp, self._state = stamp, _read(self._path)
        return self._state

    @property
    def waiting(self) -> dict[str, WaitingUnit]:
        """Nest → unit that waits for the start."""
        return dict(self._current.waiting)

    @property
    def handed(self) -> dict[str, WaitingUnit]:
        """Nest → unit with which a run was started that has not begun yet."""
        return dict(self._current.handed)

    def serials(self) -> list[str]:
        """Every serial that waits."""
        return [w.serial for w in self._current.waiting.values()]

    def put(self, units: Mapping[str, WaitingUnit]) -> None:
        """Adds units, each in a nest that is free."""
        with self._turn:
            self._keep(replace(self._current, waiting={**self._current.waiting, **units}))

    def clear(self) -> None:
        """Nothing waits any more."""
        with self._turn:
            self._keep(replace(self._current, waiting={}))

    def hand_over(self, pid: int) -> None:
        """All that waits was handed to the run `pid`."""
        with self._turn:
            self._keep(QueueState({}, self._current.waiting, pid))

    def settle(self, begun: int | None, running: int | None) -> None:
        """Lets go of what a run has begun, and takes back what it ended without beginning.

        begun: pid of the run whose load was begun last; running: pid of the run under way.
        """
        if not self._current.handed:
            return
        with self._turn:
            now = self._current
            if begun == now.pid:
                self._keep(QueueState(now.waiting, {}))
            elif running != now.pid:
                self._keep(QueueState({**now.handed, **now.waiting}, {}))

    def _keep(self, lists: QueueState) -> None:
        """Writes the file whole or not at all, then takes the change over."""
        try:
            replace_text(self._path, json.dumps({"schema": SCHEMA, **asdict(lists)}), durable=True)
        except OSError as exc:
            raise StoreFault(f"{self._path} cannot be written ({exc.strerror}); free the disk, then try again") from exc
        self._stamp, self._state = _file_stamp(self._path), lists


def _file_stamp(path: Path) -> tuple[int, int] | None:
    """What changes whenever the file is replaced; None where there is none."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_ino, stat.st_mtime_ns


def _read(path: Path) -> QueueState:
    """What the file holds; nothing where there is none, or one that nobody can read: units can be scanned again."""
    try:
        document = json.loads(path.read_bytes())
        waiting, handed = ({str(n): WaitingUnit(**w) for n, w in document[k].items()} for k in ("waiting", "handed"))
        return QueueState(waiting, handed, int(document["pid"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return QueueState({}, {})
