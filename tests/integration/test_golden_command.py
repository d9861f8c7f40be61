"""The station makes nothing while a golden or known-bad unit is due or came out wrong."""

import json
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from tests.fakes import fixture_run
from tests.fakes.command import station


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    fixture_run.config(tmp_path, golden={"file": "golden.json", "every_h": 8}, database="station.db")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_lock_of_a_golden_and_a_known_bad_unit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = ("run", "--simulate")
    assert station(*run, "--serial", "SN0001") == 3
    assert "lists none" in capsys.readouterr().err
    fixture_run.run(folder, ["SN9001", "SN9002"], faults=("SN9002/stuck-axis:value=2",))
    assert station("golden", "register", "SN9002") == 2
    assert "cannot be registered as golden" in capsys.readouterr().err
    assert station("golden", "register", "SN9001", "--due", "2099-01-31") == 0
    assert station("golden", "register", "SN9002", "--bad") == 0
    assert station("golden", "check") == 0
    capsys.readouterr()
    assert station(*run, "--serial", "SN0001", "--json") == 0
    assert json.loads(capsys.readouterr().out)["units"][0]["outcome"] == "PASS"
    # The golden unit drifts away from what was registered: registered units alone may run, nothing else.
    register = json.loads((folder / "golden.json").read_text())
    register["units"][0]["values"]["offset x"][0] += 1.0
    (folder / "golden.json").write_text(json.dumps(register))
    assert station("golden", "check") == 3
    assert station(*run, "--serial", "SN0001") == 3
    assert "came out wrong: offset x" in capsys.readouterr().err
    assert station(*run, "--serial", "SN9001", "--json") == 0


def test_a_check_that_is_too_old_locks(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fixture_run.run(folder, ["SN9001"])
    assert station("golden", "register", "SN9001") == 0
    now_s = time.time()
    monkeypatch.setattr("station.service.golden_register.time.time", lambda: now_s + 9 * 3600)
    assert station("golden", "check") == 3
    assert station("run", "--simulate", "--serial", "SN0001") == 3


def test_the_trend_of_a_certified_unit(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fixture_run.run(folder, ["SN9001"])
    assert station("golden", "register", "SN9001") == 0
    assert station("golden", "trend", "SN9001") == 2
    assert "needs the values and U of a certificate" in capsys.readouterr().err
    assert station("golden", "register", "SN9001", "--value", "gain z=1.5:0.01", "--value", "offset x=0:0.5") == 0
    capsys.readouterr()
    assert station("golden", "trend", "SN9001", "--json", "--svg", "trend.svg") == 0
    gain, offset = json.loads(capsys.readouterr().out)["trends"]
    assert gain["points"][0]["score"] < -1 and abs(offset["points"][0]["score"]) < 1
    drawing = (folder / "trend.svg").read_text()
    assert drawing.startswith("<svg") and "gain z" in drawing and "offset x" in drawing
    assert station("golden", "trend", "SN9001") == 0
    assert "gain z" in capsys.readouterr().out


def test_a_clock_behind_the_log_decides_no_due_date(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fixture_run.run(folder, ["SN9001"])
    assert station("golden", "register", "SN9001", "--due", "2099-01-31") == 0
    now_s = time.time()
    monkeypatch.setattr("station.service.golden_register.time.time", lambda: now_s - 30 * 86400)
    assert station("golden", "check") == 3
    assert "behind the newest record" in capsys.readouterr().err


def test_wrong_questions_are_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, shown in (
        (("golden", "polish"), "There is no action"),
        (("golden", "register"), "Name the unit"),
        (("golden", "check", "SN0001"), "leave the serial out"),
        (("golden", "list", "SN0001"), "leave the serial out"),
        (("golden", "remove", "SN1"), "is not registered"),
        (("golden", "register", "SN0001"), "station.db"),
        (("golden", "register", "SN0001", "--value", "gain z=nan:1"), "must be NAME=VALUE:U"),
        (("golden", "register", "SN0001", "--value", "gain z=1:inf"), "must be NAME=VALUE:U"),
        (("golden", "register", "SN0001", "--value", "gain w=1:0.1"), "no coefficient; the nearest is 'gain z'"),
        (("golden", "register", "SN0001", "--value", "gain z=1:0"), "gain z U = 0: write the expanded uncertainty"),
        (("golden", "register", "SN0001", "--value", "gain z=1:0.1", "--due", "2020-01-01"), "has passed"),
    ):
        assert station(*words) == 2
        assert shown in capsys.readouterr().err
    assert not (folder / "golden.json").exists()
    (folder / "golden.json").write_text("[]")
    assert station("golden", "list") == 2
    assert "not a readable register" in capsys.readouterr().err


CERTIFIED = ("--value", "gain z=1:0.1")


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (("../../etc/passwd", *CERTIFIED), "does not match the recipe's pattern"),
        (("SN0042\n", *CERTIFIED), "printable characters"),
        (("SN" + "0" * 70, *CERTIFIED), "printable characters"),
        (("", *CERTIFIED), "printable characters"),
        (("SN09001", *CERTIFIED), "the same device number"),
        (("SN0002", *CERTIFIED, "--recipe", "no-such"), "no-such"),
        (("SN0002", "--recipe", "six-point"), "--value"),
        (("SN0002", *CERTIFIED, "--bad"), "--bad does not go with --value"),
        (("SN0002", *CERTIFIED, "--within", "0.2"), "--within does not go with --value"),
        (("SN0002", *CERTIFIED, *CERTIFIED), "twice"),
    ],
)
def test_only_a_units_serial_is_registered(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], shown: str
) -> None:
    assert station("golden", "register", "SN9001", *CERTIFIED) == 0
    before = (folder / "golden.json").read_bytes()
    capsys.readouterr()
    assert station("golden", "register", *words) == 2
    assert shown in capsys.readouterr().err
    assert (folder / "golden.json").read_bytes() == before


@pytest.mark.parametrize("zone", ["<-12>12", "<+14>-14"])
def test_a_due_date_ends_at_the_same_moment_everywhere(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], zone: str
) -> None:
    """Days are those of UTC, as in records and on certificates: the last of a year ends where that of UTC does."""
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    begins_s = datetime(2027, 1, 1, tzinfo=UTC).timestamp()
    due = [{"item": "fixture", "number": "C-1", "due": "2026-12-31"}]
    reference = {"source": "gravity", "magnitude": 1.0, "certificates": due}
    recipe = fixture_run.recipe(folder, "six-point", reference=reference, product=None, verify=None)
    certified = ("golden", "register", "SN9001", "--value", "gain z=1:0.1", "--due", "2026-12-31")
    try:
        for now_s, code, shown in ((begins_s - 1, 0, "never"), (begins_s + 1, 3, "past its due date")):
            monkeypatch.setattr(time, "time", lambda now_s=now_s: now_s)
            monkeypatch.setattr(time, "time_ns", lambda now_s=now_s: int(now_s * 1e9))
            assert station(*certified) == (0 if code == 0 else 2)
            assert station("check", str(recipe)) == code
            capsys.readouterr()
            assert station("golden", "check") == 3
            assert shown in capsys.readouterr().out
    finally:
        monkeypatch.undo()
        time.tzset()
