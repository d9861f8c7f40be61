"""`station msa`: the plan of loads, a study on the simulated station that is broken off and goes on, tables."""

import json
from collections import Counter
from pathlib import Path

import pytest

from station.adapters.store.reader import SqliteLogReader
from station.cli._msa_runs import missing_loads
from station.ports.log_reader import Query
from tests.fakes import fixture_run
from tests.fakes.command import station
from tests.unit.test_msa import AIAG
from tests.unit.test_msa_accuracy import BIAS, LINEARITY, REFERENCES


@pytest.mark.parametrize(("parts", "nests", "trials"), [(10, 3, 3), (2, 2, 2), (5, 4, 2)])
def test_every_part_goes_through_every_nest_as_often_as_wanted(parts: int, nests: int, trials: int) -> None:
    wanted = {(f"P{p}", f"N{n}"): trials for p in range(parts) for n in range(nests)}
    loads = list(missing_loads(wanted, {}))
    assert Counter(cell for load in loads for cell in load) == wanted
    assert len(loads) == parts * trials, "no load is wasted"
    for load in loads:
        assert len({part for part, _ in load}) == len({nest for _, nest in load}) == len(load)


def test_what_is_there_is_not_measured_again() -> None:
    wanted = {("P0", "A"): 2, ("P1", "A"): 2}
    assert list(missing_loads(wanted, {("P0", "A"): 2, ("P1", "A"): 1})) == [[("P1", "A")]]
    assert list(missing_loads(wanted, {("P0", "A"): 5, ("P1", "A"): 2})) == []


def test_a_table_gives_the_published_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        f"{p},{a},{t},{AIAG[p, a, t]}"
        for p in range(AIAG.shape[0])
        for a in range(AIAG.shape[1])
        for t in range(AIAG.shape[2])
    ]
    table = tmp_path / "aiag.csv"
    table.write_text("part,appraiser,trial,value\n" + "\n".join(rows))
    assert station("msa", "grr", "--samples", str(table), "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["xbar_r"]["percent_grr"] == pytest.approx(26.68, abs=0.01)
    assert shown["xbar_r"]["ndc"] == 5
    assert shown["judgement"] == "conditional"
    (stored,) = (tmp_path / "aiag.csv.studies").iterdir()
    assert json.loads(stored.read_text()) == shown


def test_bias_and_linearity_of_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "linearity.csv"
    table.write_text("reference,value\n" + "\n".join(f"{r},{v}" for r, v in zip(REFERENCES, LINEARITY, strict=True)))
    assert station("msa", "linearity", "--samples", str(table), "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["linearity"]["slope"] == pytest.approx(-0.1317, abs=5e-5)
    assert shown["judgement"] == "biased over the range"
    assert station("msa", "linearity", "--samples", str(table)) == 0
    assert "at 10: mean bias -0.61667" in capsys.readouterr().out
    table.write_text("value\n" + "\n".join(map(str, BIAS)))
    assert station("msa", "bias", "--samples", str(table), "--json") == 2
    assert "--reference" in capsys.readouterr().err
    assert station("msa", "bias", "--samples", str(table), "--reference", "6", "--json") == 0
    assert json.loads(capsys.readouterr().out)["judgement"] == "no bias evident"


def test_linearity_over_certified_units_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four golden units whose certificates say what they read here, but for 10 µg."""
    monkeypatch.chdir(tmp_path)
    config = fixture_run.config(tmp_path, golden={"file": "golden.json", "every_h": 8}, database="station.db")
    units = fixture_run.serials(4)
    ran = fixture_run.run(tmp_path, units, config=config)
    study = ("msa", "linearity", *(word for unit in units for word in ("--serial", unit)))
    assert station(*study) == 2
    assert "golden register" in capsys.readouterr().err
    for unit, error in zip(units, (1e-5, -1e-5, 1e-5, -1e-5), strict=True):
        certified = ran.stored(unit, "calibration")["offset"][0] + error
        assert station("golden", "register", unit, "--value", f"offset x={certified}:0.001") == 0
    capsys.readouterr()
    assert station(*study, "--json") == 0
    shown = json.loads(capsys.readouterr().out)["linearity"]
    assert shown["n"] == 4 and len(shown["fitted"]) == 4
    assert abs(shown["slope"]) < 0.05


def test_a_study_on_the_simulated_station_goes_on_where_it_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    db = str(tmp_path / "s.db")
    grr = ("msa", "grr", "--serial", "SN0001", "--serial", "SN0002", "--nests", "2", "--trials", "2", "--db", db)
    assert station(*grr) == 2
    assert "has 0 of 2 readings" in capsys.readouterr().err
    assert station(*grr, "--simulate", "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["schema"] == "station.msa/1"
    assert shown["anova"]["percent_grr"] < 10
    with SqliteLogReader(Path(db)) as log:
        assert log.count(Query()) == 8
    assert station(*grr, "--json") == 0, "nothing is missing, nothing is run"
    assert json.loads(capsys.readouterr().out)["anova"] == shown["anova"]
    type1 = ("msa", "type1", "--serial", "SN0001", "--reference", "0.022", "--repeats", "2", "--db", db, "--json")
    assert station(*type1) == 0
    assert json.loads(capsys.readouterr().out)["judgement"] == "capable"


def test_wrong_questions_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "t.csv"
    table.write_text("value\n1\nx\n")
    db = ("--db", str(tmp_path / "none.db"))
    for words, shown in (
        (("msa", "type2", *db), "There is no study"),
        (("msa", "grr", "--value", "colour", *db), "There is no value"),
        (("msa", "grr", *db), "Name the units"),
        (("msa", "type1", "--samples", str(table), "--reference", "1"), "line 3: value 'x' is not a finite number"),
        (("msa", "type1", "--serial", "SN0001", *db), "has 0 of 25"),
        (("msa", "grr", "--serial", "SN0001", *db), "needs as many parts"),
    ):
        assert station(*words) == 2
        assert shown in capsys.readouterr().err
