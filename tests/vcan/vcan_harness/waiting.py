"""Waiting for something outside this process, with a limit."""

import time
from collections.abc import Callable

_POLL_S = 0.01


def until(condition: Callable[[], bool], what: str, timeout_s: float = 20.0) -> None:
    """Returns as soon as `condition` holds. Errors: TimeoutError that says what did not come."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"{what}: not within {timeout_s:g} s")
        time.sleep(_POLL_S)
