"""`station run` as a process: what it prints where, its exit codes, its JSON, and what a signal does to it."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from station.adapters.store.reader import SqliteLogReader
from station.cli.app import main
from station.errors import LogError
from station.ports.log_reader import Query
from tests.fakes import fixture_run
from tests.fakes.waiting import until

STATION = [sys.executable, "-m", "station"]


def station(folder: Path, *args: str, stdin: str | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*STATION, *args],
        capture_output=True,
        text=True,
        timeout=110,
        cwd=folder,
        check=False,
        input=stdin,
        stdin=None if stdin is not None else subprocess.DEVNULL,
    )


@pytest.fixture
def here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """The same command without a start of Python: exit code, output, errors."""
    monkeypatch.chdir(tmp_path)

    def run(*args: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            main(args)
        return int(ended.value.code or 0), *capfd.readouterr()

    return run


def one_sentence(output: str, errors: str) -> str:
    assert output == ""
    assert "Traceback" not in errors
    (line,) = errors.splitlines()
    assert line.startswith("station: ")
    return line


def test_the_table_is_on_standard_output_and_no_bar_in_a_pipe(tmp_path: Path) -> None:
    done = station(tmp_path, "run", "--simulate", "--units", "2")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("✔ PASS") == 2
    assert "log: station.db" in done.stdout
    assert "\x1b" not in done.stdout
    assert (tmp_path / "station.db").exists()


def test_json_is_one_document_of_the_contract(here: Callable[..., tuple[int, str, str]]) -> None:
    code, output, errors = here("run", "--simulate", "--units", "2", "--seed", "3", "--json")
    assert (code, errors) == (0, "")
    document = json.loads(output)
    assert (document["schema"], document["method"], document["unit"]) == ("station.run/1", "six-point", "g")
    first = document["units"][0]
    assert (first["serial"], first["nest"], first["outcome"], first["reasons"]) == ("SN0001", "A", "PASS", [])
    assert (first["written"], first["verified"]) == (True, True)
    assert (len(first["offset"]), len(first["matrix"]), len(first["covariance"])) == (3, 3, 12)
    assert {"name", "residual", "tilt_deg", "tilt_std_deg"} <= set(first["positions"][0])
    assert first["duration_s"] > 10
    assert len(first["attempt"]) == 36
    assert first["residual_rms"] < 0.01
    assert 0 <= first["false_accept"] < 0.01


def test_exit_codes_follow_the_worst_unit(here: Callable[..., tuple[int, str, str]]) -> None:
    assert here("run", "--simulate", "--units", "1", "--fault", "stuck-axis")[0] == 1
    two = ("--fault", "SN0001/silent", "--fault", "SN0002/stuck-axis")
    code, output, _ = here("run", "--simulate", "--units", "2", *two, "--json")
    assert code == 3
    assert [u["outcome"] for u in json.loads(output)["units"]] == ["ERROR", "FAIL"]
    assert json.loads(output)["units"][0]["offset"] is None


def test_an_interface_that_is_not_there_is_said_before_anything_is_asked(tmp_path: Path) -> None:
    done = station(tmp_path, "run", "--interface", "socketcan", "--channel", "nocan9", stdin="SN0042\n")
    assert done.returncode in (2, 3)
    printed = one_sentence(done.stdout, done.stderr)
    assert "nocan9" in printed or "This kernel has no CAN" in printed


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--serial", "SN0001", "--serial", "SN0001"], "'SN0001' is listed twice"),
        (["--serial", "X1"], "does not match the recipe's pattern"),
        (["--serial", "SN0001", "--units", "3"], "leave --units out"),
        (["--recipe", "no-such"], "There is no no-such.yaml"),
        (["--config", "absent.yaml"], "absent.yaml cannot be read"),
        (["--effect", "gremlins"], "There is no effect 'gremlins'"),
        (["--effect", "cross-axis=much"], "Size 'much' of cross-axis is not a number"),
        (["--fault", "hiccup"], "There is no fault 'hiccup'"),
        (["--model", "absent.yaml"], "absent.yaml cannot be read"),
    ],
)
def test_what_cannot_be_is_one_sentence_and_exit_2(
    tmp_path: Path,
    here: Callable[..., tuple[int, str, str]],
    args: list[str],
    words: str,
) -> None:
    code, output, errors = here("run", "--simulate", *args)
    assert code == 2
    assert words in one_sentence(output, errors)
    log = tmp_path / "station.db"
    assert not log.exists() or not fixture_run.Ran(tmp_path).lives("SN0001")


def test_simulation_options_want_simulate(here: Callable[..., tuple[int, str, str]]) -> None:
    code, output, errors = here("run", "--effect", "cross-axis", "--serial", "SN0001")
    assert code == 2
    assert "--effect applies to simulated units only: add --simulate" in one_sentence(output, errors)


def test_a_second_station_on_the_same_log_is_refused_with_the_first_ones_name(
    tmp_path: Path, here: Callable[..., tuple[int, str, str]]
) -> None:
    first = subprocess.Popen(
        [*STATION, "run", "--simulate", "--units", "60"],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    try:
        _wait_for_attempt(tmp_path / "station.db")
        code, output, errors = here("run", "--simulate", "--units", "1")
        assert code == 3
        assert "bench-1" in one_sentence(output, errors)
    finally:
        first.send_signal(signal.SIGINT)
        _, shown = first.communicate(timeout=60)
    assert first.returncode == 4, shown


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_with_a_true_record(tmp_path: Path, number: signal.Signals) -> None:
    process = subprocess.Popen(
        [*STATION, "run", "--simulate", "--units", "60", "--json", "--device-state", "devices"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    _wait_for_attempt(tmp_path / "station.db")
    process.send_signal(number)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 4, err
    assert "Traceback" not in err
    units = json.loads(out)["units"]
    assert units[-1]["outcome"] in ("ABORTED", "PASS")
    for unit in units:
        ran = fixture_run.Ran(tmp_path)
        assert ran.life(unit["serial"])["outcome"] == unit["outcome"]
        assert len(ran.coefficients(unit["serial"])) == (12 if unit["written"] else 0)


def test_what_ends_the_run_is_stated_once(here: Callable[..., tuple[int, str, str]]) -> None:
    run = ("run", "--simulate", "--units", "2", "--fault", "BUS/link-down:after_s=2")
    code, output, errors = here(*run)
    assert (code, (output + errors).count("went down: bring it up")) == (3, 1), output + errors
    code, output, errors = here(*run, "--json")
    assert (code, "went down" in str(json.loads(output)["units"][0]["reasons"])) == (3, True)
    assert "went down: bring it up" in one_sentence("", errors)


def test_it_runs_from_any_folder_with_a_recipe_by_path(
    tmp_path: Path, here: Callable[..., tuple[int, str, str]]
) -> None:
    (tmp_path / "elsewhere").mkdir()
    name = fixture_run.recipe(tmp_path / "elsewhere", dwell={"time_s": 0.4})
    code, _, errors = here("run", "--simulate", "--units", "1", "--recipe", name, "--db", "x.db")
    assert code == 0, errors
    assert (tmp_path / "x.db").exists()


def test_recover_is_a_command(here: Callable[..., tuple[int, str, str]]) -> None:
    common = ("--simulate", "--device-state", "devices")
    assert here("run", *common, "--units", "1", "--fault", "save-torn")[0] == 3
    code, output, _ = here("recover", "SN0001", *common)
    assert code == 1
    assert "some old values and some new ones" in output or "hold old values and some new ones" in output
    code, output, errors = here("recover", "SN0001", *common, "--continue", "--json")
    assert code == 0, errors
    assert json.loads(output)["state"] == "new"
    code, output, _ = here("recover", "SN0001", *common, "--restore")
    assert code == 0
    assert "there is nothing to recover" in output
    _, output, errors = here("recover", "SN0001", "--restore", "--continue")
    assert "choose one" in one_sentence(output, errors)


def _wait_for_attempt(log: Path) -> None:
    """Until the run has begun to measure a unit."""

    def begun() -> bool:
        with suppress(LogError), SqliteLogReader(log) as reader:
            return reader.count(Query()) > 0
        return False

    until(begun, f"an attempt in {log}")
