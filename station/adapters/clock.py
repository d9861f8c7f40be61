"""Two clocks: the machine's own, and the simulated rig's, which jumps from event to event."""

import math
import time

from station.errors import StationFault
from station.ports.clock import Actor

#: Where simulated time starts: 2026-01-01T00:00:00Z. A constant, so that equal seeds give equal records.
EPOCH_NS = 1_767_225_600_000_000_000


class SystemClock:
    """The machine's clocks: CLOCK_MONOTONIC for deadlines, CLOCK_REALTIME for records."""

    def monotonic_s(self) -> float:
        """Seconds of CLOCK_MONOTONIC."""
        return time.monotonic()

    def epoch_ns(self) -> int:
        """Nanoseconds of CLOCK_REALTIME."""
        return time.time_ns()

    def sleep(self, duration_s: float) -> None:
        """Waits; a negative duration is none."""
        time.sleep(max(0.0, duration_s))


class VirtualClock:
    """Discrete-event time in one thread: it moves only while somebody waits, and the actors act meanwhile.

    Equal calls give equal times, to the bit; nothing depends on how fast the machine is.
    """

    def __init__(self, start_ns: int = EPOCH_NS) -> None:
        self._start_ns = start_ns
        self._now_s = 0.0
        self._actors: list[Actor] = []
        self._acting = False
        self._wakes_s = -math.inf

    @property
    def wakes_s(self) -> float:
        """When whoever sleeps looks again; in the past where anybody may look at any instant."""
        return self._wakes_s

    def monotonic_s(self) -> float:
        """Simulated seconds since this clock was made."""
        return self._now_s

    def epoch_ns(self) -> int:
        """Simulated nanoseconds since 1970."""
        return self.at_ns(self._now_s)

    def at_ns(self, monotonic_s: float) -> int:
        """Epoch nanoseconds of an instant of monotonic_s()."""
        return self._start_ns + round(monotonic_s * 1e9)

    def attach(self, actor: Actor) -> None:
        """From now on this actor acts, after those attached before it."""
        self._actors.append(actor)

    def detach(self, actor: Actor) -> None:
        """This actor acts no more: it has left the rig."""
        self._actors.remove(actor)

    def sleep(self, duration_s: float) -> None:
        """Lets the rig live for `duration_s`: each actor acts at every instant at which any is due, and at the end."""
        until_s = self._now_s + max(0.0, duration_s)
        self.settle()
        self._wakes_s = until_s
        try:
            while self._now_s < until_s:
                self.advance(until_s)
        finally:
            self._wakes_s = -math.inf

    def settle(self) -> None:
        """Every actor acts at the present instant; time does not move."""
        if self._acting:
            raise StationFault("simulated-actor-waited")
        self._acting = True
        try:
            for actor in self._actors:
                actor.act(self._now_s)
        finally:
            self._acting = False

    def advance(self, until_s: float) -> None:
        """Jumps to the next instant at which an actor is due, to `until_s` at the latest; then every actor acts.

        StationFault when an actor is due but not later than now: time would stand still for ever.
        """
        due_s = min((actor.next_due_s() for actor in self._actors), default=math.inf)
        if due_s <= self._now_s < until_s:
            raise StationFault("simulated-actor-still-due", due_s=due_s)
        self._now_s = max(self._now_s, min(due_s, until_s))
        self.settle()
