"""The operator's stop: seen at safe places only, so that no device is left half written."""

from station.errors import Aborted
from station.messages import Message


class StopRequest:
    """A request to stop, from a signal handler or from another thread.

    The runner calls check() wherever stopping is safe. A signal handler may raise at once while `waiting` is
    true (moving, settling, dwelling: nothing is being written); anywhere else the request waits for check().
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

    def __enter__(self) -> "StopRequest":
        """From here on a signal may interrupt."""
        self.check()
        self.waiting = True
        return self

    def __exit__(self, *_: object) -> None:
        self.waiting = False
