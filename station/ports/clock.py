"""Time as a port: the simulated rig runs a three-minute recipe in milliseconds and no test sleeps."""

from typing import Protocol, runtime_checkable


class Clock(Protocol):
    """Monotonic seconds for deadlines, epoch nanoseconds for records, and waiting."""

    def monotonic_s(self) -> float:
        """Seconds that never run backwards; the zero is arbitrary."""

    def epoch_ns(self) -> int:
        """Nanoseconds since 1970 UTC, as the record keeps them."""

    def sleep(self, duration_s: float) -> None:
        """Lets `duration_s` pass; in simulation the rig acts meanwhile."""


class Actor(Protocol):
    """Whatever of the simulated rig lives in time: a device, a disturbance, a link that goes down."""

    def next_due_s(self) -> float:
        """Instant (monotonic seconds) at which it next does something by itself; infinity when idle."""

    def act(self, now_s: float) -> None:
        """Brings itself up to `now_s`: takes the frames waiting for it, sends all that was due until then.

        Afterwards next_due_s() is later than `now_s`. It may not wait: only receive(0.0), never sleep.
        """


@runtime_checkable
class EventClock(Clock, Protocol):
    """Time of a simulated rig: it stands still until somebody waits, then jumps from event to event."""

    def attach(self, actor: Actor) -> None:
        """From now on this actor acts, after those attached before it."""

    def detach(self, actor: Actor) -> None:
        """This actor acts no more: it was taken off the rig."""

    def at_ns(self, monotonic_s: float) -> int:
        """Epoch nanoseconds of an instant of monotonic_s()."""

    def settle(self) -> None:
        """Every actor acts at the present instant; time does not move."""

    def advance(self, until_s: float) -> None:
        """Jumps to the next instant at which an actor is due, to `until_s` at the latest; then every actor acts."""
