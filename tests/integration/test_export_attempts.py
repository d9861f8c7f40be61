"""Export and replay keep a unit's attempts apart, however they ended, and compute the same coefficients again."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from station.cli.app import run_command
from station.domain.records.stored_attempt import SIMULATED
from station.domain.run.progress import Event, VisitDone
from station.errors import LogError, UsageError
from station.ports.log_reader import Query
from station.service import frame_export
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench
from station.wiring.logs import open_log
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """SN0001 failed, passed and was stopped after its third visit, one after the other; SN0002 took another recipe."""
    folder = tmp_path_factory.mktemp("attempts")
    done: list[Event] = []

    def stop_early(event: Event, stop: StopRequest, _bench: Bench) -> None:
        if isinstance(event, VisitDone):
            done.append(event)
            if len(done) == 3:
                stop.request()

    brief: dict[str, Any] = {"settle": {"time_s": 0.1}, "dwell": {"time_s": 0.2}}
    tight = fixture_run.recipe(folder, limits={"offset": 1e-6}, **brief)
    fixture_run.run(folder, ["SN0001"], recipe=tight)
    usual = fixture_run.recipe(folder, **brief)
    fixture_run.run(folder, ["SN0001"], recipe=usual)
    ran = fixture_run.run(folder, ["SN0001"], recipe=usual, hook=stop_early)
    fixture_run.run(folder, ["SN0002"], recipe=fixture_run.recipe(folder, "norm", **brief))
    return ran


def export_frames(ran: Ran, path: Path, *words: str) -> None:
    assert run_command(["export", "--db", str(ran.folder / "station.db"), "--frames", str(path), *words]) == 0


def test_three_attempts_of_a_unit_replay_each_by_itself(
    ran: Ran, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They overlap in time, because a simulation's time runs ahead of the clock."""
    export_frames(ran, tmp_path / "all.log", "--serial", "SN0001")
    capsys.readouterr()
    recipe = fixture_run.recipe(tmp_path, settle={"time_s": 0.1}, dwell={"time_s": 0.2})
    assert run_command(["replay", str(tmp_path / "all.log"), "--recipe", recipe, "--json"]) == 3
    replayed = {u["attempt"]: u for u in json.loads(capsys.readouterr().out)["units"]}
    lives = ran.lives("SN0001")
    assert [life["outcome"] for life in lives] == ["FAIL", "PASS", "ABORTED"]
    assert list(replayed) == [life["attempt"] for life in lives]
    for life in lives[:2]:
        stored = next(r["document"] for r in life["results"] if r["name"] == "calibration")
        again = replayed[life["attempt"]]
        assert (again["offset"], again["matrix"]) == (stored["offset"], stored["matrix"])
    assert replayed[lives[2]["attempt"]]["outcome"] == "ERROR", "three positions of six calibrate nothing"


def test_frames_of_several_recipes_are_said_to_be_so(
    ran: Ran, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    export_frames(ran, tmp_path / "all.log")
    assert "of several recipes (six-point, norm)" in capsys.readouterr().err
    with pytest.raises(LogError, match=r"of several recipes \(six-point, norm\): choose one with --recipe\."):
        run_command(["replay", str(tmp_path / "all.log")])
    assert run_command(["replay", str(tmp_path / "all.log"), "--recipe", "norm", "--json"]) == 0
    whole = json.loads(capsys.readouterr().out)["units"]
    export_frames(ran, tmp_path / "norm.log", "--recipe", "norm")
    assert "several recipes" not in capsys.readouterr().err
    assert run_command(["replay", str(tmp_path / "norm.log"), "--json"]) == 0, "the marks name the recipe"
    (apart,) = json.loads(capsys.readouterr().out)["units"]
    assert [(u["serial"], u["matrix"]) for u in whole] == [("SN0002", apart["matrix"])]


def test_an_attempt_without_an_accepted_visit_is_said_to_hold_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    brief: dict[str, Any] = {"settle": {"time_s": 0.1}, "dwell": {"time_s": 0.2}}
    order: dict[str, Any] = {"recipe": fixture_run.recipe(tmp_path, **brief), "faults": ("SN0003/stuck-axis:value=1",)}
    stuck = fixture_run.run(tmp_path, ["SN0003"], **order)
    export_frames(stuck, tmp_path / "stuck.log")
    assert "No visit of SN0003 was accepted, so nothing is marked there" in capsys.readouterr().err
    with pytest.raises(LogError, match=r"stuck\.log\.marks\.csv marks no dwell"):
        run_command(["replay", str(tmp_path / "stuck.log")])


def test_real_attempts_that_overlap_on_a_node_are_refused(ran: Ran) -> None:
    """Nothing real can: a clock was set back between them."""
    with open_log(ran.folder / "station.db") as log:
        real = [replace(a, software=a.software.removesuffix(SIMULATED)) for a in log.attempts(Query(serial="SN0001"))]
        with pytest.raises(UsageError, match="overlap in time on node 17: export them one by one"):
            frame_export.frames(log, real)


def test_a_wats_report_of_every_attempt_that_ended_says_how_and_why(ran: Ran, tmp_path: Path) -> None:
    """PASS, FAIL and ABORTED; each limit a step whose status is the station's, simulated ones marked."""
    words = ["export", "--db", str(ran.folder / "station.db"), "--wsjf"]
    assert run_command([*words, str(tmp_path / "wats")]) == 0
    reports = {r["id"]: r for r in (json.loads(f.read_text()) for f in (tmp_path / "wats").iterdir())}
    lives = [*ran.lives("SN0001"), *ran.lives("SN0002")]
    assert reports.keys() == {life["attempt"] for life in lives}
    results = {"PASS": "P", "FAIL": "F", "ABORTED": "T"}
    assert [reports[life["attempt"]]["result"] for life in lives] == [results[life["outcome"]] for life in lives]
    assert {r["purpose"] for r in reports.values()} == {"SIMULATED"}
    failed, passed, stopped = (reports[life["attempt"]] for life in lives[:3])
    status = {step["name"]: step["status"] for step in failed["root"]["steps"]}
    assert status["offset x"] == "F" and "offset" in failed["miscInfos"][0]["text"].lower()
    assert {step["status"] for step in passed["root"]["steps"]} == {"P"} and "miscInfos" not in passed
    assert stopped["root"]["steps"] == []
    with pytest.raises(UsageError, match="is a file"):
        run_command([*words, str(tmp_path / "wats" / f"{passed['id']}.json")])
