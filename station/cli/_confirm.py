"""Who says that something which only a person can do is done: somebody at the terminal, or somebody at the page."""

import json
import sys
import time
from pathlib import Path

from station.cli._live import Live, Pace
from station.errors import UsageError
from station.service.stop import Stop

#: How often the page's answer is looked for, s.
_LOOK_S = 0.05


def wait_for_person(sentence: str) -> None:
    """Asks somebody at the terminal to do something and waits. Errors: UsageError when nobody is there."""
    if not sys.stdin.isatty():
        raise UsageError(f"somebody must {sentence}, but nobody is at a terminal; run this from one")
    print(f"{sentence}, then press Enter: ", end="", file=sys.stderr, flush=True)
    sys.stdin.readline()


class AtPage:
    """Asks on the page: the sentence stands in the live file with a mark, and `<log>.answer.json` gives the mark back.

    Waits as long as it takes; a stop ends the wait. Time that a person takes counts neither as pace nor as progress.
    """

    def __init__(self, database: Path, live: Live, held: Pace, stop: Stop) -> None:
        self._path = database.with_name(database.name + ".answer.json")
        self._live, self._held, self._stop = live, held, stop

    def __call__(self, sentence: str) -> None:
        """Returns when somebody has confirmed it. Errors: Aborted."""
        began_s = time.monotonic()
        mark = self._live.ask(sentence)
        try:
            with self._stop:  # nothing is being written: a signal may end the wait at once
                while self._answer() != mark:
                    self._stop.check()
                    time.sleep(_LOOK_S)
        finally:
            waited_s = time.monotonic() - began_s
            self._live.answered(waited_s)
            self._held.skip(waited_s)

    def _answer(self) -> str:
        """The mark of the last question that was answered, or ''; half a file is none, the page replaces it whole."""
        try:
            return str(json.loads(self._path.read_bytes())["question"])
        except (OSError, ValueError, KeyError, TypeError):
            return ""
