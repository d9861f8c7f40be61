"""The folder where fetched programs live; all test sessions of one user share it."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Names another folder than ~/.cache/station-tests.
VARIABLE = "STATION_TEST_CACHE"


def folder() -> Path:
    """The cache folder, made if it is not there."""
    path = Path(os.environ.get(VARIABLE) or Path.home() / ".cache" / "station-tests").resolve()
    path.mkdir(parents=True, exist_ok=True)
    return path


@contextmanager
def locked(name: str) -> Iterator[None]:
    """Lets one session at a time fill a part of the cache; the others wait."""
    with (folder() / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
