"""Waiting for another process, with a limit."""

import time
from collections.abc import Callable


def until(condition: Callable[[], bool], what: str, timeout_s: float = 60.0) -> None:
    """Returns as soon as `condition` holds. Errors: TimeoutError that says what did not come."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"{what}: not within {timeout_s:g} s")
        time.sleep(0.02)
