"""What every test shares: fixed seeds that a failure prints, and where the real recordings lie."""

import gc
import os
import pathlib
import shutil
import signal
import tempfile
from collections.abc import Generator

# Many small matrices: a second thread of the linear algebra only waits for the first. Read when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from typing import Any

import hypothesis
import numpy as np
import pytest

from tests.schedule import ByFile, rank

# The same examples on every machine and in every run; `--hypothesis-profile=explore` looks for new ones.
hypothesis.settings.register_profile("fixed", derandomize=True, deadline=None)
hypothesis.settings.register_profile("explore", derandomize=False)
hypothesis.settings.load_profile("fixed")

#: Where files cost no turn of a disk, and the least room there: the tests commit some hundred thousand times.
MEMORY, ROOM_BYTES = pathlib.Path("/dev/shm"), 4_000_000_000
SEED = int(os.environ.get("STATION_TEST_SEED", "20260101"))


def pytest_configure(config: pytest.Config) -> None:
    """A parent such as nohup ignores signals, and what is ignored stays ignored in every child: the programs under test
    would never hear them. A handler, unlike SIG_IGN, is not handed down (POSIX, exec)."""
    for number, handler in ((signal.SIGHUP, _survive), (signal.SIGINT, signal.default_int_handler)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
    # A worker of xdist states a width, and would have the commands' lines broken there.
    os.environ.pop("COLUMNS", None)
    # What must survive a power cut is tried by tests/endurance, on the disk.
    if MEMORY.is_dir() and os.access(MEMORY, os.W_OK) and shutil.disk_usage(MEMORY).free > ROOM_BYTES:
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))
    if not hasattr(config, "workerinput"):
        _share_a_cache(config)


def _share_a_cache(config: pytest.Config) -> None:
    """What diagnoses make of chance alone is made once for all processes of this run; the user's own cache is left."""
    cache = tempfile.TemporaryDirectory(prefix="station-cache-", ignore_cleanup_errors=True)
    os.environ["XDG_CACHE_HOME"] = cache.name
    config.add_cleanup(cache.cleanup)


def _survive(_number: int, _frame: object) -> None:
    """The tests themselves go on, as their parent wished."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Hook: seven thousand tests and their modules live to the end, so no garbage is looked for among them, nor later
    while the tests run."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item], config: pytest.Config) -> None:
    """Hook: where several processes share the tests, the longest pieces of work come first."""
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: rank(item.nodeid))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> ByFile:
    """Hook: how xdist deals the tests out."""
    return ByFile(config, log)


def pytest_report_header() -> str:
    return f"station seed: {SEED} (STATION_TEST_SEED)"


@pytest.fixture
def rng() -> np.random.Generator:
    """A random stream of its own for each test, from the printed seed."""
    return np.random.default_rng(SEED)


@pytest.fixture(scope="session")
def reference_data() -> pathlib.Path:
    """Folder of the real recordings; read in place, never copied."""
    extra = pathlib.Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = pathlib.Path(os.environ.get("STATION_REFERENCE_DATA", extra))
    if not folder.is_dir():
        pytest.fail(f"real recordings not found at {folder}; set STATION_REFERENCE_DATA to their folder")
    return folder
