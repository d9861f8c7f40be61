"""The folder where fetched programs live; all test sessions of one user share it."""

import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Names another folder than ~/.cache/station-tests.
VARIABLE = "STATION_TEST_CACHE"
_OLD_S = 24 * 3600


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


def fresh_folder() -> Path:
    """An empty folder for one session; takes away those that sessions killed long ago have left."""
    for old in folder().glob("run-*"):
        if time.time() - old.stat().st_mtime > _OLD_S:
            shutil.rmtree(old, ignore_errors=True)
    return Path(tempfile.mkdtemp(dir=folder(), prefix="run-"))
