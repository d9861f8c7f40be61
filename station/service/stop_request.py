"""The operator's stop: heeded at safe places only, so that no device is left half written."""

from station.errors import Aborted
from station.messages import Message


class StopRequest:
    """A request to stop, from a signal handler or from another thread: one, however often it is made.

    The runner calls check() wherever stopping is safe. A signal handler may raise at once, by interrupt(), while
    `waiting` is true (moving, waiting for a person: nothing is being written); anywhere else the request waits for
    check(). Parking and putting back are neither checked nor waiting: nothing interrupts them.
    """

    def __init__(self) -> None:
        self.requested = False
        self.why = Message("stopped-by-operator")
        self.waiting = False

    def request(self, why: Message | None = None) -> None:
        """Asks for the stop; asking again changes nothing."""
        if not self.requested:
            self.why = why or self.why
            self.requested = True

    def check(self) -> None:
        """Raises Aborted when a stop has been asked for."""
        if self.requested:
            raise Aborted(self.why)

    def interrupt(self) -> None:
        """Ends a wait at once, for a signal's handler: raises Aborted where somebody waits, and only once."""
        if self.waiting:
            self.waiting = False  # the next one must not break off the parking that this one leads to
            raise Aborted(self.why)

    def __enter__(self) -> "StopRequest":
        """From here on a signal may interrupt."""
        self.waiting = True  # before the check: what comes between them is not missed
        if self.requested:
            self.waiting = False
            raise Aborted(self.why)
        return self

    def __exit__(self, *_: object) -> None:
        self.waiting = False
