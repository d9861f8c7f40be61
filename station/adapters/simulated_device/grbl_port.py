"""A simulated GRBL controller behind a pseudo-terminal: whoever opens a serial port may open this one."""

import os
import select
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType

from station.adapters.simulated_device.grbl import GrblStub

#: It looks whether its time is over so often, s.
_POLL_S = 0.05


class GrblPort:
    """Use as a context manager. name: the file to open, such as /dev/pts/3."""

    def __init__(self, stub: GrblStub) -> None:
        self._stub = stub
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.name = os.ttyname(self._theirs)

    def serve(self, go_on: Callable[[], bool]) -> None:
        """Answers for as long as `go_on()`."""
        while go_on():
            if select.select([self._ours], [], [], _POLL_S)[0]:
                self._stub.feed(os.read(self._ours, 4096), time.monotonic())
            if replies := self._stub.answers(time.monotonic()):
                with suppress(BlockingIOError):
                    os.write(self._ours, replies)

    def __enter__(self) -> "GrblPort":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._ours)
        os.close(self._theirs)
