"""A keyboard wedge: the reader types each label as a line on standard input."""

import os
import select
import sys
import time

from station.adapters.scanner._lines import LineBuffer
from station.domain.recipe.fields import StrictModel
from station.errors import StationFault


class KeyboardScanner:
    """Asks for each nest by name, on standard error, and takes the next line.

    line: {scanner: {kind: keyboard}}
    """

    class Settings(StrictModel):
        """No options."""

    def __init__(self, settings: "KeyboardScanner.Settings") -> None:
        pass

    def read(self, nest: str, timeout_s: float) -> str | None:
        """The next line; what was typed before the question is thrown away."""
        handle = sys.stdin.fileno()
        while sys.stdin.isatty() and select.select([handle], [], [], 0)[0]:
            os.read(handle, 4096)
        sys.stderr.write(f"{nest}: ")
        sys.stderr.flush()
        lines, until_s = LineBuffer(), time.monotonic() + timeout_s
        while (rest_s := until_s - time.monotonic()) > 0:
            if not select.select([handle], [], [], rest_s)[0]:
                break
            data = os.read(handle, 1)  # not beyond the line: the next nest's may stand behind it
            if not data:
                raise StationFault("scanner-keyboard-closed")
            if (text := lines.take(data)) is not None:
                return text
        return None

    def close(self) -> None:
        """Nothing to let go of."""
