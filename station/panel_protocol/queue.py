"""Units scanned and not yet in work: those of the next load nest by nest, behind them those of later loads in order.

Kept in a file, so that a page started again forgets none.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from threading import Lock

from station.errors import StoreFault
from station.files.json_text import NOT_AS_EXPECTED, read_json
from station.files.replace import replace_text
from station.messages import system_reason

SCHEMA = "station.queue/1"
#: Loads that are remembered as cleared: a page that is started again must not bring an older one back.
_MAX_CLEARED = 8


@dataclass(frozen=True, slots=True)
class WaitingUnit:
    """A unit that waits for the start."""

    serial: str


@dataclass(frozen=True, slots=True)
class QueueState:
    """waiting: nest → unit of the next load. handed: what was handed to the run `pid`, which has not begun it yet.

    later: serials of the loads after the next, in the order scanned; cleared: the newest loads whose verdicts a person
    has dealt with; binned: the load whose failed units are in the red bin.
    """

    waiting: Mapping[str, WaitingUnit]
    handed: Mapping[str, WaitingUnit]
    pid: int = 0
    later: tuple[str, ...] = ()
    cleared: tuple[str, ...] = ()
    binned: str = ""

    @property
    def serials(self) -> list[str]:
        """Every serial that waits."""
        return [*(w.serial for w in self.waiting.values()), *self.later]

    def serial_of(self, nest: str) -> str:
        """The unit that waits for that nest; '' where none does."""
        return self.waiting[nest].serial if nest in self.waiting else ""


class LoadQueue:
    """The units of the loads to come; safe to call from several threads. Errors: StoreFault; then nothing changed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._turn = Lock()
        self._stamp: tuple[int, int] | None = None
        self._state = QueueState({}, {})

    @property
    def state(self) -> QueueState:
        """As the file says now: another page on the same log may have changed it. Whoever shows or judges several parts
        together takes them from one look: between two, somebody may have scanned a unit."""
        stamp = _file_stamp(self._path)
        if stamp != self._stamp:
            self._stamp, self._state = stamp, _read(self._path)
        return self._state

    @property
    def waiting(self) -> dict[str, WaitingUnit]:
        """Nest → unit that waits for the start."""
        return dict(self.state.waiting)

    @property
    def handed(self) -> dict[str, WaitingUnit]:
        """Nest → unit with which a run was started that has not begun yet."""
        return dict(self.state.handed)

    @property
    def later(self) -> tuple[str, ...]:
        """Serials of the loads after the next, in the order in which they take their nests."""
        return self.state.later

    def acknowledge(self, load: str, *, all_done: bool) -> None:
        """The failed units of that load are in the red bin; all_done: and nothing else of it is left to be done."""
        with self._turn:
            now = self.state
            cleared = (*now.cleared, load)[-_MAX_CLEARED:] if all_done else now.cleared
            self._keep(replace(now, binned=load, cleared=cleared))

    def take_out(self, serial: str) -> None:
        """That unit waits no more."""
        with self._turn:
            now = self.state
            waiting = {n: w for n, w in now.waiting.items() if w.serial != serial}
            self._keep(replace(now, waiting=waiting, later=tuple(s for s in now.later if s != serial)))

    def serials(self) -> list[str]:
        """Every serial that waits."""
        return self.state.serials

    def put(self, units: Mapping[str, WaitingUnit]) -> None:
        """Adds units, each in its nest; whoever waited for that nest is the first of the load after."""
        with self._turn:
            self._keep(_seated(self.state, units))

    def append(self, serial: str) -> None:
        """A unit of a load after the next."""
        with self._turn:
            self._keep(replace(self.state, later=(*self.state.later, serial)))

    def clear(self) -> None:
        """Nothing waits any more."""
        with self._turn:
            self._keep(replace(self.state, waiting={}, later=()))

    def hand_over(self, pid: int, nests: Sequence[str] = ()) -> None:
        """All of the next load was handed to the run `pid`; the first of the later ones take its place in the nests."""
        with self._turn:
            now = self.state
            waiting = {nest: WaitingUnit(serial) for nest, serial in zip(nests, now.later, strict=False)}
            later = now.later[len(waiting) :]
            self._keep(replace(now, waiting=waiting, later=later, handed=now.waiting, pid=pid))

    def settle(self, begun: int | None, running: int | None) -> None:
        """Lets go of what a run has begun, and takes back what it ended without beginning.

        begun: pid of the run whose load was begun last; running: pid of the run under way.
        """
        if not self.state.handed:
            return
        with self._turn:
            now = self.state
            if begun == now.pid:
                self._keep(replace(now, handed={}, pid=0))
            elif running != now.pid:
                self._keep(replace(_seated(now, now.handed), handed={}, pid=0))

    def _keep(self, lists: QueueState) -> None:
        """Writes the file whole or not at all, then takes the change over."""
        try:
            replace_text(self._path, json.dumps({"schema": SCHEMA, **asdict(lists)}), durable=True)
        except OSError as exc:
            raise StoreFault("queue-not-written", path=str(self._path), reason=system_reason(exc)) from exc
        self._stamp, self._state = _file_stamp(self._path), lists


def _seated(now: QueueState, units: Mapping[str, WaitingUnit]) -> QueueState:
    """With units in their nests, before whoever waited for these; none of them waits for a later load any more."""
    seated = {w.serial for w in units.values()}
    displaced = (w.serial for nest, w in now.waiting.items() if nest in units)
    later = tuple(s for s in (*displaced, *now.later) if s not in seated)
    return replace(now, waiting={**now.waiting, **units}, later=later)


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
        document = read_json(path)
        waiting, handed = (
            {str(n): WaitingUnit(str(w["serial"])) for n, w in document[k].items()} for k in ("waiting", "handed")
        )
        cleared = tuple(str(load) for load in document.get("cleared", ()))
        later = tuple(str(serial) for serial in document.get("later", ()))
        return QueueState(waiting, handed, int(document["pid"]), later, cleared, str(document.get("binned", "")))
    except (OSError, *NOT_AS_EXPECTED):
        return QueueState({}, {})
