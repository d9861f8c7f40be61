"""Ctrl-C, SIGTERM, a terminal that hangs up and the run's socket, as one request to stop, however often they come."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from station.messages import Message
from station.panel_protocol.stop_socket import listening_for_stop
from station.service.stop_request import StopRequest


@contextmanager
def stop_signals(stop: StopRequest) -> Iterator[None]:
    """While inside, these signals request the stop; the first may end a wait at once, all others change nothing.

    No number of them breaks off parking or the return of old values: whoever must end the process itself does so on
    purpose (Ctrl-\\, SIGQUIT, SIGKILL), and the next start recognises what that left. Only a hang-up may have been made
    harmless before (nohup). A shell makes SIGINT so for what it starts in the background, but the page's stop sends it.
    """

    def request(number: int, _frame: object) -> None:
        stop.request(None if number == signal.SIGINT else Message("stopped-by-signal", signal=number))
        stop.interrupt()

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    may_hang_up = signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    before = {n: signal.signal(n, request) for n in numbers if n != signal.SIGHUP or may_hang_up}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def stop_socket(database: Path, stop: StopRequest) -> Iterator[None]:
    """While inside, whoever may write to the socket beside the log requests the stop, and is named as its reason."""

    def request(user: str) -> None:
        stop.request(Message("stopped-at-socket", user=user))
        os.kill(os.getpid(), signal.SIGINT)  # ends a wait of the main thread; `stop_signals` takes it

    with listening_for_stop(database, request):
        yield
