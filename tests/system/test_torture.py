"""Short forms of the torture: a run killed at points and instants; the long ones are `make torture`."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.conftest import SEED

ROOT = Path(__file__).parents[2]


def test_killed_at_points_and_instants_nothing_is_lost_contradicted_or_overlooked() -> None:
    command = [
        sys.executable,
        "tests/endurance/torture_kill.py",
        "--points",
        "8",
        "--instants",
        "2",
        "--seed",
        str(SEED),
    ]
    done = subprocess.run([*command, "--json"], cwd=ROOT, capture_output=True, text=True, timeout=110, check=False)
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout)
    assert shown["deaths"] == {"points": 8, "instants": 2}
    assert (shown["points"] > 500, shown["not_reached"]) == (True, 0), "every trial must end in its death"
    assert {"old", "new"} <= set(shown["flash_held"]), "deaths before and after the save"
    assert (shown["lost"], shown["contradicting"], shown["unrecognised"]) == (0, 0, 0), shown["said"]


def test_units_after_the_first_leave_nothing_behind() -> None:
    command = [sys.executable, "tests/endurance/torture_lasting.py", "--units", "8", "--after", "4", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=110, check=False)
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout)
    assert shown["units"] == shown["passed"] == 8
    assert (shown["threads_growth"], shown["files_growth"]) == (0, 0)
    assert shown["memory_growth"] < 0.05
    assert shown["wal_mib"] < 64


def full_bus(*options: str) -> dict[str, Any]:
    command = [sys.executable, "tests/endurance/full_bus.py", "--seconds", "1", "--dwell", "0.4", "--idle", "--json"]
    done = subprocess.run([*command, *options], cwd=ROOT, capture_output=True, text=True, timeout=110, check=False)
    assert done.returncode == 0, done.stderr
    shown: dict[str, Any] = json.loads(done.stdout)
    return shown


def test_at_a_full_bus_no_visit_that_was_kept_has_lost_a_frame() -> None:
    shown = full_bus()
    assert shown["lost_in_kept"] == 0
    assert shown["frames"] > 10_000
    assert shown["kept"] + shown["rejected"] >= 4


def test_frames_that_a_small_buffer_loses_are_counted_and_their_visits_rejected() -> None:
    shown = full_bus("--buffer", "65536")
    assert (shown["kept"], shown["lost_in_kept"]) == (0, 0)
    assert shown["lost_in_rejected"] > 1000
    assert any("The kernel dropped" in reason for reason in shown["reasons"])


def power_cut(*options: str) -> tuple[int, dict[str, Any]]:
    command = [
        sys.executable,
        "tests/endurance/torture_power.py",
        "--every",
        "10",
        "--seed",
        str(SEED),
        "--json",
        *options,
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=110, check=False)
    return done.returncode, json.loads(done.stdout)


def test_a_power_cut_at_any_fsync_leaves_every_record_whose_call_had_returned() -> None:
    code, shown = power_cut()
    assert (code, shown["faulty"]) == (0, 0), shown["said"]
    assert shown["fsyncs"] > 60
    assert min(shown["tried"].values()) > 5


def test_a_log_that_commits_without_an_fsync_is_caught() -> None:
    code, shown = power_cut("--careless")
    assert code == 1
    assert all("records are missing" in printed for printed in shown["said"])


def test_the_table_says_what_was_tried_what_came_of_it_and_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    stored = tmp_path / "torture.json"
    other = {"code": 1, "shown": None, "took_s": 2.0, "seed": 7, "scale": 1.0}
    stored.write_text(json.dumps({"kill": other}))
    command = [
        sys.executable,
        "tests/endurance/torture.py",
        "--scale",
        "0.001",
        "--only",
        "edits",
        "--json",
        str(stored),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=110, check=False)
    head, broken, edits = done.stdout.splitlines()
    assert head.split() == ["what", "tried", "came", "to", "goal", "seed", "took"]
    assert broken.split() == ["kill", "broke", "off", "7", "2", "s", "MISSED"]
    assert "100 found" in edits
    assert edits.endswith("met")
    assert done.returncode == 1, "a part that broke off is no success"
    assert set(json.loads(stored.read_text())) == {"kill", "edits"}
