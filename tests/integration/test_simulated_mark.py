"""What was simulated says so in whatever leaves the log, and attempts stay apart on the way out and back."""

import csv
import io
import json
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from station.adapters.store.reader import SqliteLogReader
from station.domain.records.stored_attempt import MARK, result
from station.ports.log_reader import Query
from tests.fakes import fixture_run
from tests.fakes.command import station

SERIAL = "SN0001"
#: Bytes of a BLF file before its first object.
BLF_HEADER = 144


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A unit that was run twice, exported in every form."""
    path = tmp_path_factory.mktemp("simulated")
    fixture_run.run(path, [SERIAL, SERIAL], config=fixture_run.config(path, nests=[{"name": "A", "node": 17}]))
    db = ("--db", str(path / "station.db"))
    for name in ("s.csv", "s.parquet"):
        assert station("export", "--serial", SERIAL, "--samples", str(path / name), *db) == 0
    for name in ("r.csv", "r.json", "r.parquet"):
        assert station("export", "--serial", SERIAL, "--results", str(path / name), *db) == 0
    for name in ("f.log", "f.blf"):
        assert station("export", "--serial", SERIAL, "--frames", str(path / name), *db) == 0
    assert station("export", "--parquet", str(path / "fleet"), *db) == 0
    assert station("audit", SERIAL, "--bundle", str(path / "bundle.zip"), *db) == 0
    return path


def of_csv(path: Path) -> set[str]:
    with path.open(newline="") as file:
        return {row["simulated"] for row in csv.DictReader(file)}


def of_parquet(path: Path) -> set[str]:
    return set(pq.read_table(path, columns=["simulated"]).column(0).to_pylist())


def of_json(path: Path) -> set[str]:
    return {row["simulated"] for row in json.loads(path.read_text())["results"]}


@pytest.mark.parametrize(
    ("name", "read"),
    [("s.csv", of_csv), ("s.parquet", of_parquet), ("r.csv", of_csv), ("r.parquet", of_parquet), ("r.json", of_json),
     ("f.log.marks.csv", of_csv), ("f.blf.marks.csv", of_csv)],
)  # fmt: skip
def test_every_row_of_a_table_says_so(folder: Path, name: str, read: Callable[[Path], set[str]]) -> None:
    assert read(folder / name) == {MARK}


def test_every_table_of_a_fleet_says_so(folder: Path) -> None:
    files = list((folder / "fleet").rglob("*.parquet"))
    assert len(files) >= 4
    assert {value for file in files for value in of_parquet(file)} == {MARK}


def test_every_line_of_a_frame_log_says_so(folder: Path) -> None:
    assert {line.split()[1] for line in (folder / "f.log").read_text().splitlines()} == {MARK}
    assert MARK.encode() in first_container(folder / "f.blf")
    assert len(json.loads((folder / "f.log.export.json").read_text())["simulated"]) == 2


def first_container(path: Path) -> bytes:
    """The first container of a BLF file, decompressed; zlib's header tells where it begins."""
    data = path.read_bytes()
    return zlib.decompressobj().decompress(data[data.find(b"\x78\x9c", BLF_HEADER) :])


def test_the_evidence_of_an_attempt_says_so(folder: Path) -> None:
    with zipfile.ZipFile(io.BytesIO((folder / "bundle.zip").read_bytes())) as archive:
        assert json.loads(archive.read("attempt.json"))["simulated"] == MARK
        assert MARK.encode() in archive.read("README.txt")
        logs = [name for name in archive.namelist() if name.endswith(".log")]
        assert logs and all(MARK.encode() in archive.read(name) for name in logs)


def test_attempts_stay_apart_from_export_to_replay(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each attempt of the log comes to its own coefficients again, from a table of marks too."""
    with SqliteLogReader(folder / "station.db") as log:
        fits = [result(life, "calibration") for life in log.life(Query(serial=SERIAL))]
    for name in ("f.log", "f.blf"):
        capsys.readouterr()
        assert station("replay", str(folder / name), "--json") in (0, 1)
        shown = json.loads(capsys.readouterr().out)
        assert shown["simulated"] is True and len(shown["units"]) == 2
        for unit, fit in zip(shown["units"], fits, strict=True):
            # A candump log has whole microseconds; nothing that is fitted depends on less.
            assert unit["offset"] == fit["offset"] and unit["matrix"] == fit["matrix"]


def test_simulated_tables_and_logs_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("t.csv", "t.parquet", "t.log"):
        assert station("simulate", "--recipe", "six-point", "--units", "1", "--out", str(tmp_path / name)) == 0
    assert (
        of_csv(tmp_path / "t.csv")
        == of_parquet(tmp_path / "t.parquet")
        == of_csv(tmp_path / "t.log.marks.csv")
        == {MARK}
    )
    assert f" {MARK} " in (tmp_path / "t.log").read_text().splitlines()[0]
    capsys.readouterr()
    assert station("replay", str(tmp_path / "t.log"), "--recipe", "six-point") in (0, 1)
    assert MARK in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [
        ("calibrate", "--samples", "s.csv", "--recipe", "six-point"),
        ("calibrate", "--db", "station.db", "--recipe", "six-point", "--processes", "1"),
        ("diagnose", "--samples", "s.csv", "--recipe", "six-point", "--report", "page.html"),
    ],
    ids=["calibrate", "calibrate-db", "diagnose"],
)
def test_what_is_computed_from_it_says_so(
    folder: Path, words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the terminal, in the document, on the page."""
    monkeypatch.chdir(folder)
    capsys.readouterr()
    assert station(*words, "--json", "out.json") in (0, 1)
    assert MARK in capsys.readouterr().out
    assert json.loads((folder / "out.json").read_text())["simulated"]
    if "page.html" in words:
        assert MARK in (folder / "page.html").read_text()


@pytest.mark.parametrize("command", ["backtest", "report"])
def test_what_is_told_of_the_log_says_so(folder: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    more = ("--recipe", "six-point", "--processes", "1") if command == "backtest" else ("--out", str(folder / "r.html"))
    words = (command, "--db", str(folder / "station.db"), *more)
    capsys.readouterr()
    assert station(*words) == 0
    assert MARK in capsys.readouterr().out
    assert station(*words, "--json") == 0
    assert json.loads(capsys.readouterr().out)["simulated"] == 2
    if command == "report":
        assert MARK in (folder / "r.html").read_text()
