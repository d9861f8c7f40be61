"""`station export --parquet`: what the guide promises of the tables, and its ten questions as they stand there."""

import io
import json
import re
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import duckdb
import pytest
from pyarrow import parquet

from station.cli.app import main
from station.ports.log_reader import Query
from station.service.fleet_rows import fleet_rows
from station.wiring.logs import open_log
from tests.fakes.plant import FakePlant, FakeStation, Server

GUIDE = (Path(__file__).parents[2] / "docs" / "fleet-tables.md").read_text(encoding="utf-8")
QUESTIONS = re.findall(r"^\*\*(\d+)\..*?```(sql|python)\n(.*?)^```", GUIDE, re.MULTILINE | re.DOTALL)


def command(*words: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    return int(ended.value.code or 0), out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Two good units and a bad one, exported."""
    place = tmp_path_factory.mktemp("fleet")
    db = ("--db", place / "s.db")
    assert command("run", "--simulate", "--units", "2", "--seed", "3", *db)[0] == 0
    command("run", "--simulate", "--units", "2", "--seed", "4", "--effect", "cross-axis=0.2", *db)
    code, out, _ = command("export", "--parquet", place / "fleet", *db, "--json")
    rows = json.loads(out)["rows"]
    assert (code, rows["attempts"], rows["coefficients"]) == (0, 4, 48)
    with chdir(place):
        yield place


def test_the_guide_asks_ten_questions() -> None:
    assert [int(number) for number, _, _ in QUESTIONS] == list(range(1, 11))


@pytest.mark.parametrize(("number", "language", "text"), QUESTIONS, ids=[q[0] for q in QUESTIONS])
def test_every_question_of_the_guide_has_an_answer(folder: Path, number: str, language: str, text: str) -> None:
    rows = answer(number, language, text)
    assert rows or number in ("5", "9"), text
    with open_log(folder / "s.db") as log:
        check(number, rows, log.attempts(Query()))


def answer(number: str, language: str, text: str) -> list[Any]:
    """Of a question, asked in the folder of the tables."""
    if language == "sql":
        return duckdb.connect().execute(text).fetchall()
    names: dict[str, Any] = {}
    exec(text, names)
    return list(names["answer"].rows() if number == "9" else names["answer"].values.tolist())


def test_what_a_recipe_does_not_calibrate_is_no_unit_far_off_and_no_endless_capability(tmp_path: Path) -> None:
    db = ("--db", tmp_path / "s.db")
    for recipe in ("inclinometer-zero", "gyroscope-one-point"):
        assert command("run", "--simulate", "--units", "2", "--recipe", recipe, *db)[0] == 0
    assert command("export", "--parquet", tmp_path / "fleet", *db)[0] == 0
    with chdir(tmp_path):
        answers = {number: answer(number, language, text) for number, language, text in QUESTIONS}
    assert (answers["4"], answers["9"]) == ([], [])
    assert sum(row[1] for row in answers["1"]) == 2


def check(number: str, rows: list[Any], attempts: list[Any]) -> None:
    """Where the log itself says the answer."""
    first = {a.serial: a.outcome for a in attempts}  # newest first: the oldest wins
    if number == "1":
        assert sum(row[1] for row in rows) == len(first)
        assert sum(row[1] * row[2] for row in rows) == sum(outcome == "PASS" for outcome in first.values())
    if number == "2":
        assert [row[0] for row in rows] == sorted({a.serial for a in attempts if a.nest == "B"})
    if number == "3":
        assert sum(row[4] for row in rows) == 3 * len(attempts)
    if number == "6":
        passed = sorted((a.ended_ns - a.started_ns) / 1e9 for a in attempts if a.outcome == "PASS")
        assert rows[0][1] == pytest.approx(passed[len(passed) // 2], rel=0.2)


def test_values_are_those_of_the_log_bit_for_bit_and_files_say_whence(folder: Path) -> None:
    table = parquet.read_table(folder / "fleet" / "coefficients", partitioning="hive").to_pylist()
    with open_log(folder / "s.db") as log:
        expected = [row for rows in fleet_rows(log, log.attempts(Query())) for row in rows.coefficients]
        head = log.head()
    own = {(r["attempt"], r["coefficient"]): (r["value"], r["std"], r["expanded"]) for r in table}
    assert own == {(r["attempt"], r["coefficient"]): (r["value"], r["std"], r["expanded"]) for r in expected}
    assert {(r["product"]) for r in table} == {"accelerometer"}
    for file in (folder / "fleet").rglob("*.parquet"):
        metadata = parquet.read_schema(file).metadata
        assert metadata[b"schema"] == b"station.fleet/1"
        assert metadata[b"head"] == f"{head.number}:{head.hash}".encode()


def test_the_plant_gives_the_same_tables(folder: Path, server: Server, tmp_path: Path) -> None:
    from tests.fakes import logs

    station = FakeStation("bench-1", tmp_path)
    with station.store() as store:
        for number in range(3):
            logs.unit(store, f"SN{number}", station="bench-1")
    plant = FakePlant(server.database(), tmp_path / "objects")
    plant.take_all(station)
    with open_log(station.path) as own, plant.reader() as plants:
        assert list(fleet_rows(own, own.attempts(Query()))) == list(fleet_rows(plants, plants.attempts(Query())))
    plant.connections.close()


def test_wrong_input_is_one_sentence(folder: Path) -> None:
    for words, sentence in (
        (("--parquet", folder / "s.db"), "is a file"),
        (("--parquet", folder / "x", "--results", folder / "x.csv"), "a folder of its own"),
    ):
        code, _, err = command("export", *words, "--db", folder / "s.db")
        assert (code, sentence in err) == (2, True)
