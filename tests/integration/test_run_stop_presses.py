"""Stop, pressed one to twenty times from any instant on: one request, and nothing breaks off parking or put-back."""

from pathlib import Path

import numpy as np
import pytest

from tests.conftest import SEED
from tests.fakes.stop_presses import faults_of, run_and_press

RUNS = 14


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> int:
    """How many instants a run without a stop has."""
    code, presses = run_and_press(tmp_path_factory.mktemp("whole"), 1 << 30, 0, units=1)
    assert code == 0
    return presses.calls


@pytest.mark.parametrize("number", range(RUNS))
def test_however_often_it_is_pressed_it_is_one_stop(
    tmp_path: Path, calls: int, number: int, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng([SEED, number])
    at, presses = int((number + rng.random()) * calls / RUNS), int(rng.integers(1, 21))
    code, pressing = run_and_press(tmp_path, at, presses, units=1)
    assert faults_of(tmp_path, code, pressing, units=1) == [], f"pressed {presses} times from call {at} on"
    assert "Traceback" not in capsys.readouterr().err
