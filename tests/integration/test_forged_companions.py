"""Files by which a run and its page find each other, as somebody with the folder may leave them there."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from station.adapters.store.sqlite import SqliteStore
from station.cli.app import run_command
from station.config.settings import load_settings
from station.files.replace import replace_text
from station.panel_protocol.answer import read_answer
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.line_adjustment import LineAdjustments
from station.panel_protocol.line_state import LineCommands, read_line_state
from station.panel_protocol.live_state import expected_s, recipe_label
from station.panel_protocol.nest_readings import read_readings
from station.panel_protocol.owner import owner_pid
from station.panel_protocol.questions import Questions
from station.panel_protocol.queue import LoadQueue
from station.web.line_glance import LineGlance
from station.web.run_launcher import LaunchOptions, RunLauncher
from station.web.screen import Screen
from station.wiring.alerts import read_book
from station.wiring.jobs import load_job
from station.wiring.shipping import read_statuses
from tests.fakes import fixture_run, logs

JOB, _ = load_job("six-point")
AT_S = 1_795_000_000.0


def screen_of(database: Path) -> Screen:
    launcher = RunLauncher(LaunchOptions(database=database, recipe="six-point", simulate=True))
    return Screen(load_settings(), JOB.recipe, launcher, LoadQueue(companion_file(database, Companion.QUEUE)))


READERS: dict[Companion, Callable[[Path], object]] = {
    Companion.LIVE: lambda d: (screen_of(d).shown()["running"], expected_s(d, JOB.recipe)),
    Companion.ANSWER: read_answer,
    Companion.QUEUE: lambda d: LoadQueue(companion_file(d, Companion.QUEUE)).waiting,
    Companion.READINGS: lambda d: read_readings(d, AT_S),
    Companion.OWNER: owner_pid,
    Companion.LINE: lambda d: (read_line_state(d), LineGlance(d).shown()),
    Companion.LINE_COMMAND: lambda d: LineCommands(d).next(),
    Companion.SHIPPING: read_statuses,
    Companion.ALERTS: lambda d: read_book(d).document(),
    Companion.LINE_ADJUSTMENT: lambda d: LineAdjustments(d).next(),
    Companion.QUESTIONS: lambda d: Questions(companion_file(d, Companion.QUESTIONS)).all(),
}
#: Of another shape, nested in what the readers go through.
DOCUMENTS: tuple[object, ...] = (
    None, 7, "x", [], [[]], {}, {"state": 5}, {"state": []}, {"state": {"nests": 5}}, {"state": {"nests": [5]}},
    {"state": {"nests": [{}]}}, {"state": {"nests": [{"serial": 1, "nest": "A", "outcome": "PASS"}]}},
    {"state": {"messages": 5}, "bus": 5, "pid": "x"}, {"pid": -1}, {"pid": 10**30}, {"bus": 5}, {"expected_s": 5},
    {"cells": 5}, {"cells": [5]}, {"schema": "station.line/1", "pid": os.getpid(), "state": 99},
    {"schema": "station.line/1", "pid": os.getpid(), "state": 6, "name": [], "load": {}, "loads": None},
    {"at_s": AT_S, "nests": 5}, {"at_s": AT_S, "nests": {"A": {"serial": 1, "vector": [10**400]}}}, {"at_s": 10**400},
    {"waiting": {}, "handed": {}, "pid": 0, "later": 5},
    {"schema": "station.questions/1", "questions": [1]}, {"waiting": [], "handed": 3, "pid": None},
    {"state": {"began_s": 10**400}}, {"recipe": recipe_label(JOB.recipe), "expected_s": [10**400]},
    {"question": {"a": 1}}, {"number": 1, "mode": "produce", "times_s": [5]}, {"number": 1, "mode": []},
    {"number": "x", "command": []},
)  # fmt: skip


@pytest.mark.parametrize("companion", READERS)
def test_a_pipe_a_folder_and_an_endless_file_are_no_answer(tmp_path: Path, companion: Companion) -> None:
    database = tmp_path / "station.db"
    path = companion_file(database, companion)
    os.mkfifo(path)  # nobody writes to it: whoever opens it plainly waits for ever
    empty = READERS[companion](database)
    path.unlink()
    assert READERS[companion](database) == empty
    path.mkdir()
    assert READERS[companion](database) == empty
    path.rmdir()
    path.touch()
    os.truncate(path, 1 << 40)  # without blocks on the disk
    assert READERS[companion](database) == empty


@pytest.mark.parametrize("companion", READERS)
def test_a_document_of_another_shape_is_no_answer(tmp_path: Path, companion: Companion) -> None:
    database = tmp_path / "station.db"
    for document in DOCUMENTS:
        replace_text(companion_file(database, companion), json.dumps(document))
        READERS[companion](database)


def test_a_unit_that_was_not_turned_though_somebody_said_so_fails_by_gravity(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    turned: dict[str, Any] = {"seatings": {"turned": {"axis": [0, 0, 1], "angle_deg": 180}}}
    asked = fixture_run.recipe(tmp_path, **turned, runs=[{"seating": "home"}, {"seating": "turned"}])
    shutil.move(asked, "asked.yaml")
    done = fixture_run.recipe(tmp_path, **turned, runs=[{"seating": "home"}, {"seating": "home"}])
    words = ["simulate", "--recipe", done, "--units", "1", "--seed", "3", "--out", "samples.csv"]
    assert run_command(words) == 0
    lines = Path("samples.csv").read_text(encoding="utf-8").splitlines()
    said = [line.replace('"home"', '"turned"') if line.split(",")[1] == "1" else line for line in lines]
    Path("said.csv").write_text("\n".join(said) + "\n", encoding="utf-8")
    for samples, code in (("samples.csv", 0), ("said.csv", 1)):
        assert run_command(["calibrate", "--samples", samples, "--recipe", "asked.yaml"]) == code
    assert "The residual at" in capsys.readouterr().out


def nest_of(serial: str, outcome: str, attempt: str) -> dict[str, Any]:
    return {"serial": serial, "nest": "A", "node": 17, "outcome": outcome, "reasons": [], "attempt": attempt}


@pytest.mark.parametrize(("logged", "forged"), [("FAIL", "PASS"), ("PASS", "FAIL"), ("ERROR", "PASS")])
def test_the_page_shows_no_verdict_against_which_the_log_speaks(tmp_path: Path, logged: str, forged: str) -> None:
    database = tmp_path / "station.db"
    with SqliteStore(database) as store:
        attempt = logs.unit(store, "SN1", outcome=logged)
    screen = screen_of(database)

    def shown(outcome: str, of: str) -> tuple[str, str]:
        live = {"schema": "station.live/1", "pid": 7, "recipe": "six-point/1", "unit": "g"}
        state = {"over": True, "began_s": 1.0, "nests": [nest_of("SN1", outcome, of)]}
        replace_text(companion_file(database, Companion.LIVE), json.dumps({**live, "state": state}))
        screen._looked_s = 0.0
        now = screen.shown()
        return now["nest A"]["outcome"], now["view"]["lamp"]

    for of in (attempt, "", "another"):
        assert shown(forged, of) == ("ERROR", "amber")
    if logged != "ERROR":
        assert shown(logged, attempt)[0] == logged
