"""What can be wrong between the station and a simulated bus: the link, the cable, the bit rate, a jammed bus."""

import errno
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from station.domain.core.types import Frames
from station.errors import UsageError


class _Kind(NamedTuple):
    """words: what is wrong; state: of the station's controller; fails: errno of the station's sends, 0: frames wait."""

    words: str
    state: str
    fails: int = 0
    loses: bool = True


_KINDS = {
    "link-down": _Kind("the interface is set down", "down", errno.ENETDOWN),
    "cable-out": _Kind("the station's connector is out: nobody acknowledges its frames", "passive"),
    "wrong-bit-rate": _Kind("the station's controller runs at another bit rate", "bus-off"),
    "jammed": _Kind("a broken node sends without end, with the highest priority", "active"),
    "queue-full": _Kind("the transmit queue of the interface is full (ENOBUFS)", "active", errno.ENOBUFS, loses=False),
}
#: kind → what is wrong, for the list of faults.
KINDS: Mapping[str, str] = MappingProxyType({kind: about.words for kind, about in _KINDS.items()})
#: Frames that wait in the interface's queue until they are acknowledged, as `ip link` sets it for CAN by default.
TX_QUEUE_FRAMES = 10


@dataclass(frozen=True, slots=True)
class InjectedBusFault:
    """From `from_s` on, for `lasts_s` (infinite: for good), monotonic seconds of the bus's clock."""

    kind: str
    from_s: float
    lasts_s: float = math.inf

    @property
    def until_s(self) -> float:
        """When all is well again."""
        return self.from_s + self.lasts_s

    def covers(self, at_s: float) -> bool:
        """Whether that instant lies in it."""
        return self.from_s <= at_s < self.until_s


def parse(text: str) -> InjectedBusFault:
    """`KIND` or `KIND:after_s=6,seconds=2` (seconds: how long; for good where it is left out). Errors: UsageError."""
    kind, _, rest = text.partition(":")
    given = {"after_s": 0.0, "seconds": math.inf}
    if kind not in KINDS:
        raise UsageError("bus-fault-unknown", kind=kind[:40], known=tuple(KINDS))
    for key, _, value in (part.partition("=") for part in rest.split(",") if part):
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if key not in given or not number >= 0:
            raise UsageError("bus-fault-option", fault=text[:60], option=key[:40])
        given[key] = number
    return InjectedBusFault(kind, given["after_s"], given["seconds"])


class Wire:
    """The troubles of one bus, and what follows from them for whoever sends and receives on the station's side."""

    def __init__(self) -> None:
        self._injected_faults: list[InjectedBusFault] = []

    def add(self, fault: InjectedBusFault) -> None:
        """One more."""
        self._injected_faults.append(fault)

    @property
    def whole(self) -> bool:
        """Whether nothing is or will be wrong."""
        return not self._injected_faults

    def state(self, now_s: float) -> str:
        """State of the station's controller."""
        return next((_KINDS[t.kind].state for t in self._injected_faults if t.covers(now_s)), "active")

    def counters(self, now_s: float) -> tuple[int, int]:
        """Error counters of the station's controller, sending and receiving (ISO 11898-1): nobody's acknowledge stops
        the one for sending where it turns passive; a wrong bit rate takes it beyond 255."""
        return {"passive": (128, 0), "bus-off": (256, 0)}.get(self.state(now_s), (0, 0))

    def fails(self, now_s: float) -> int:
        """The error number with which the station's sends fail; 0: they do not."""
        return next((_KINDS[t.kind].fails for t in self._injected_faults if t.covers(now_s)), 0)

    def went_down(self, since_s: float, now_s: float) -> bool:
        """Whether the link went down after `since_s`: a socket tells that once."""
        return any(t.kind == "link-down" and since_s < t.from_s <= now_s for t in self._injected_faults)

    def holds(self, now_s: float) -> bool:
        """Whether what the station sends waits in its queue."""
        return any(t.covers(now_s) and _KINDS[t.kind].loses and not _KINDS[t.kind].fails for t in self._injected_faults)

    def arriving(self, frames: Frames, now_s: float, epoch_ns: int) -> Frames:
        """Those of the frames from devices that reach the station. epoch_ns: the instant `now_s`."""
        for t in self._injected_faults:
            if not len(frames) or not _KINDS[t.kind].loses:
                continue
            at_s = now_s + (frames.time_ns - epoch_ns) / 1e9
            frames = frames[(at_s < t.from_s) | (at_s >= t.until_s)] if np.any(at_s >= t.from_s) else frames
        return frames
