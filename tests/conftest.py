"""What every test shares: fixed seeds that a failure prints, and where the real recordings lie."""

import os
import pathlib

# Many small matrices: a second thread of the linear algebra only waits for the first. Read when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import numpy as np
import pytest

# The same examples on every machine and in every run; `--hypothesis-profile=explore` looks for new ones.
hypothesis.settings.register_profile("fixed", derandomize=True)
hypothesis.settings.register_profile("explore", derandomize=False)
hypothesis.settings.load_profile("fixed")

SEED = int(os.environ.get("STATION_TEST_SEED", "20260101"))


def pytest_report_header() -> str:
    return f"station seed: {SEED} (STATION_TEST_SEED)"


@pytest.fixture
def rng() -> np.random.Generator:
    """A random stream of its own for each test, from the printed seed."""
    return np.random.default_rng(SEED)


@pytest.fixture(scope="session")
def reference_data() -> pathlib.Path:
    """Folder of the real recordings; read in place, never copied."""
    beside = pathlib.Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = pathlib.Path(os.environ.get("STATION_REFERENCE_DATA", beside))
    if not folder.is_dir():
        pytest.fail(f"real recordings not found at {folder}; set STATION_REFERENCE_DATA to their folder")
    return folder
