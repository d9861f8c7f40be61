"""Evidence of one attempt as one file that Python alone checks; which units something touched."""

import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from station.cli import app
from tests.fakes import fixture_run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log: one unit passed in nest A, one failed in B, and passed there later."""
    made = tmp_path_factory.mktemp("evidence")
    config = fixture_run.config(made, fixture="FX-02", lot="L7")
    fixture_run.run(made, ["SN0001", "SN0002"], faults=("SN0002/stuck-axis:value=2",), config=config)
    fixture_run.run(made, ["SN0003"])
    return made


def ask(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, object]:
    """The JSON answer of a command."""
    with pytest.raises(SystemExit) as ended:
        app.main([*words, "--json"])
    assert ended.value.code == 0
    answer: dict[str, object] = json.loads(capsys.readouterr().out)
    return answer


def check(place: Path) -> tuple[int, str]:
    """What the bundle's own script says, run without anything but Python."""
    script = place / "verify.py"
    done = subprocess.run([sys.executable, "-I", "-S", str(script)], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout


def test_a_bundle_is_checked_by_python_alone_and_an_edit_is_found(folder: Path, tmp_path: Path) -> None:
    db = folder / "station.db"
    with pytest.raises(SystemExit) as ended:
        app.main(["audit", "SN0001", "--bundle", str(tmp_path / "b.zip"), "--db", str(db)])
    assert ended.value.code == 0
    place = tmp_path / "b"
    with zipfile.ZipFile(tmp_path / "b.zip") as bundle:
        bundle.extractall(place)
    names = {p.name for p in place.iterdir()}
    assert {"certificate.pdf", "configuration.json", "recipe.json", "product.json", "attempt.json"} <= names
    assert json.loads((place / "configuration.json").read_text())["fixture"] == "FX-02"
    code, told = check(place)
    assert (code, told.startswith("whole")) == (0, True)
    seal = re.search(r"(\d+):([0-9a-f]{64})", told)
    assert seal
    lines = (place / "records.jsonl").read_text().splitlines()
    for name, edited in (
        ("records.jsonl", "\n".join(x.replace('"PASS"', '"FAIL"') for x in lines) + "\n"),
        ("recipe.json", (place / "recipe.json").read_text().replace("six-point", "five-point")),
    ):
        before = (place / name).read_text()
        (place / name).write_text(edited)
        assert check(place)[0] == 1, name
        (place / name).write_text(before)
    frames = next((place / "frames").glob("*.bin"))
    frames.write_bytes(frames.read_bytes()[:-1] + b"?")
    code, told = check(place)
    assert (code, f"frames/{frames.name}" in told) == (1, True)


def test_a_unit_that_failed_has_evidence_and_no_certificate(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        app.main(["audit", "SN0002", "--bundle", str(tmp_path / "b.zip"), "--db", str(folder / "station.db")])
    with zipfile.ZipFile(tmp_path / "b.zip") as bundle:
        assert "certificate.pdf" not in bundle.namelist()
        assert b"did not pass" in bundle.read("README.txt")


def test_contain_names_every_unit_that_something_touched(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    db = ("--db", str(folder / "station.db"))
    for question, serials in (
        (("--nest", "B"), ["SN0002"]),
        (("--fixture", "FX-02"), ["SN0001", "SN0002"]),
        (("--fixture", "FX-03"), []),
        (("--lot", "L7", "--nest", "A"), ["SN0001"]),
        (("--check", "stuck"), ["SN0002"]),
        (("--check", "gain"), []),
        (("--recipe", "six-point", "--recipe-version", "1"), ["SN0001", "SN0002", "SN0003"]),
        (("--recipe-version", "2"), []),
        (("--until", "2001-01-01"), []),
    ):
        answer = ask(capsys, "contain", *question, *db)
        assert [u["serial"] for u in answer["units"]] == serials, question  # type: ignore[attr-defined]
    with pytest.raises(SystemExit) as ended:
        app.main(["contain", *db])
    assert ended.value.code == 2
    assert "--nest" in capsys.readouterr().err


def test_serials_have_wildcards_and_lists_say_why(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    db = ("--db", str(folder / "station.db"))
    for pattern, count in (("SN*", 3), ("*2", 1), ("SN000?", 3), ("SN[0-9]*", 0)):
        assert ask(capsys, "audit", pattern, *db)["count"] == count
    with pytest.raises(SystemExit):
        app.main(["audit", "--outcome", "FAIL", *db])
    assert "it is stuck" in capsys.readouterr().out
