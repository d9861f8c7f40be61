"""Time as a port: the simulated rig runs a three-minute recipe in milliseconds and no test sleeps."""

from typing import Protocol


class Clock(Protocol):
    """Monotonic seconds for deadlines, epoch nanoseconds for records, and waiting."""

    def monotonic_s(self) -> float:
        """Seconds that never run backwards; the zero is arbitrary."""

    def epoch_ns(self) -> int:
        """Nanoseconds since 1970 UTC, as the record keeps them."""

    def sleep(self, duration_s: float) -> None:
        """Lets `duration_s` pass; in simulation the rig acts meanwhile."""
