"""Several buses of one fixture as one: each nest's node is on one of them, and node ids differ over all of them."""

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from station.domain.core.types import Frames
from station.ports.bus import Bus, Channel, ErrorCounters, Repeated

#: How long one bus may keep the call while the others wait, s.
_SLICE_S = 0.002
#: Identifiers up to the last SDO request name a node; UDS and vendors' protocols go their own ways, on all buses.
_NMT, _NODES, _LAST_NAMED = 0x000, 0x7F, 0x67F
#: States of a controller, the worst last.
_WORSE = ("active", "unknown", "warning", "passive", "bus-off", "down")


class SeveralBuses:
    """What all of them hear, in the order of time; what is sent goes to the bus of the node, to all if it has none."""

    def __init__(self, parts: Mapping[str, Bus], bus_of_node: Mapping[int, str]) -> None:
        self._parts = dict(parts)
        self._bus_of_node = dict(bus_of_node)

    @property
    def name(self) -> str:
        """The names of all."""
        return " + ".join(bus.name for bus in self._parts.values())

    def stream(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A channel over all of them with these ids and error frames."""
        return _Channel({k: bus.stream(can_ids) for k, bus in self._parts.items()}, self._targets)

    def service(self, can_ids: tuple[int, ...]) -> "_Channel":
        """A channel over all of them with these ids."""
        return _Channel({k: bus.service(can_ids) for k, bus in self._parts.items()}, self._targets)

    def repeat(self, can_id: int, data: bytes, period_s: float) -> Repeated:
        """Sends a frame on each of them every period_s."""
        return _Repeated([bus.repeat(can_id, data, period_s) for bus in self._parts.values()])

    def state(self) -> str:
        """The worst of their states."""
        return max((bus.state() for bus in self._parts.values()), key=_WORSE.index)

    def counters(self) -> ErrorCounters | None:
        """The greatest of their error counters; None where no adapter tells them."""
        known = [c for bus in self._parts.values() if (c := bus.counters()) is not None]
        if not known:
            return None
        return ErrorCounters(max(c.sending for c in known), max(c.receiving for c in known))

    def close(self) -> None:
        """Closes all of them."""
        for bus in self._parts.values():
            bus.close()

    def _targets(self, can_id: int, data: bytes) -> Sequence[str]:
        """By the predefined connection set (CiA 301, 7.3.3) the low bits of an identifier are the node."""
        node = data[1] if can_id == _NMT and len(data) > 1 else can_id & _NODES
        bus = self._bus_of_node.get(node) if can_id <= _LAST_NAMED else None
        return tuple(self._parts) if bus is None else (bus,)


class _Repeated:
    def __init__(self, jobs: Sequence[Repeated]) -> None:
        self._jobs = jobs

    def close(self) -> None:
        for job in self._jobs:
            job.close()


class _Channel:
    """One channel on each bus."""

    def __init__(self, parts: Mapping[str, Channel], targets: Callable[[int, bytes], Sequence[str]]) -> None:
        self._parts, self._targets = parts, targets

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one frame where it belongs."""
        for bus in self._targets(can_id, data):
            self._parts[bus].send(can_id, data)

    def send_many(self, frames: Frames) -> None:
        """Sends frames of a simulated device; its node is on one bus, and the others do not hear it."""
        for name, channel in self._parts.items():
            mine = [name in self._targets(int(can_id), b"") for can_id in frames.can_id]
            if any(mine):
                channel.send_many(frames[np.array(mine)])  # type: ignore[attr-defined]

    def receive(self, timeout_s: float) -> Frames:
        """All frames waiting on any of them, by their time; waits up to timeout_s for the first."""
        until_s = time.monotonic() + timeout_s
        while True:
            remaining_s = until_s - time.monotonic()
            wait_s = min(max(remaining_s, 0.0), _SLICE_S)
            found = [f for channel in self._parts.values() if len(f := channel.receive(wait_s))]
            if found or remaining_s <= 0:
                break
        frames = Frames.join(found)
        return frames[np.argsort(frames.time_ns, kind="stable")] if len(found) > 1 else frames

    def drops(self) -> int:
        """Frames dropped on any of them."""
        return sum(channel.drops() for channel in self._parts.values())

    def close(self) -> None:
        """Closes each."""
        for channel in self._parts.values():
            channel.close()
