"""Another process beside this one, for as long as a block lasts."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def running_beside(*words: str) -> Iterator[None]:
    """Runs `python` with these words while the block lasts, without input and output; ends it with the block."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen([sys.executable, *words], stdin=quiet, stdout=quiet, stderr=quiet)
    try:
        yield
    finally:
        process.terminate()
        process.wait()
