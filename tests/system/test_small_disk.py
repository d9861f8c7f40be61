"""A run whose log lies on a real file system that fills up, at any write: nothing passes that is not on the disk."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.portion import WHOLE

ROOT = Path(__file__).parents[2]
#: From too small for an empty log to room for everything.
ALL_KIB = (8, 100, 180, 260, 340, 380, 420, 460, 520, 580, 4000)
SIZES_KIB = ALL_KIB if WHOLE else (8, 260, 340, 420, 460, 520, 4000)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    folder = tmp_path_factory.mktemp("small")
    command = [sys.executable, "-m", "tests.fakes.small_disk", str(folder), *map(str, SIZES_KIB)]
    for namespace in (["unshare", "-m"], ["unshare", "-Urm"]):
        done = subprocess.run([*namespace, *command], cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            found: list[dict[str, Any]] = json.loads(done.stdout)
            return found
    raise AssertionError(f"no file system of its own could be mounted here: {done.stderr[-2000:]}")


def test_a_disk_that_fills_up_at_any_write_passes_nothing_that_it_does_not_hold(report: list[dict[str, Any]]) -> None:
    for run in report:
        assert run["findings"] == [], run
        if run["shown"] == "PASS":
            assert (run["outcome"], run["saved"]) == ("PASS", True), run
        else:
            assert run["outcome"] in (None, "ERROR"), run
            assert any("the disk is full" in s or "the disk failed" in s for s in run["sentences"]), run
            assert run["writes"] or not run["saved"], "nothing is in the device that the log does not tell of"


def test_some_sizes_end_at_some_write_and_the_largest_lets_it_through(report: list[dict[str, Any]]) -> None:
    shown = [run["shown"] for run in report]
    assert shown[-1] == "PASS"
    assert shown.count("ERROR") >= 5
    assert len({run["writes"] for run in report}) > 2, "some fill up before the first write, some between writes"


def test_with_space_again_the_same_unit_on_the_same_log_passes(report: list[dict[str, Any]]) -> None:
    assert [run["goes_on"] for run in report] == ["PASS"] * len(report)
