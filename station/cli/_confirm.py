"""Who says that something which only a person can do is done: somebody at the terminal, or somebody at the page."""

import sys
import time
from pathlib import Path

from station.cli._pacing import RealTimePacer
from station.errors import UsageError
from station.messages import Message, render
from station.panel_protocol.answer import read_answer
from station.panel_protocol.live_state import LiveStateWriter
from station.panel_protocol.presence import is_served
from station.service.stop_request import StopRequest

#: How often the page's answer is looked for, s.
_POLL_S = 0.05
#: A page that is started again is back well within this time, s; longer without one, nobody can answer or stop.
_PAGE_TIMEOUT_S = 30.0


def wait_for_person(action: Message) -> None:
    """Asks somebody at the terminal to do something and waits. Errors: UsageError when nobody is there."""
    if not sys.stdin.isatty():
        raise UsageError("nobody-at-terminal", action=action)
    print(render(Message("then-press-enter", action=action)), end=" ", file=sys.stderr, flush=True)
    sys.stdin.readline()


class PageConfirmation:
    """Asks on the page: the message stands in the live state with a mark, and the answer gives the mark back.

    Waits as long as it takes; a stop ends the wait, and so does a page that is gone for patience_s: the fixture is
    parked as after any stop. Time that a person takes counts neither as pace nor as progress.
    """

    def __init__(
        self,
        database: Path,
        live: LiveStateWriter,
        held: RealTimePacer,
        stop: StopRequest,
        patience_s: float = _PAGE_TIMEOUT_S,
    ) -> None:
        self._database, self._page_timeout_s = database, patience_s
        self._live, self._held, self._stop = live, held, stop

    def __call__(self, action: Message) -> None:
        """Returns when somebody has confirmed it. Errors: Aborted."""
        began_s = served_s = time.monotonic()
        mark = self._live.ask(action)
        try:
            while read_answer(self._database) != mark:
                served_s = self._last_served(served_s)
                self._stop.check()
                time.sleep(_POLL_S)
        finally:
            waited_s = time.monotonic() - began_s
            self._live.clear_question(waited_s)
            self._held.skip(waited_s)

    def _last_served(self, served_s: float) -> float:
        """When a page was last there; asks for a stop when that is too long ago."""
        now_s = time.monotonic()
        if is_served(self._database):
            return now_s
        if now_s - served_s > self._page_timeout_s:
            self._stop.request(Message("page-gone"))
        return served_s
