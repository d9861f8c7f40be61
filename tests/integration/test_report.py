"""The line report over a real log: yields from rows, charts and capability as the formulas say, on the page too."""

import json
from pathlib import Path

import numpy as np
import pytest

from station.adapters.store.reader import SqliteLogReader
from station.cli.app import main
from station.domain.line_quality import capability
from station.errors import UsageError
from station.ports.log_reader import Query
from station.reporting.line import charts
from station.reporting.line.statistics import CYCLE_PARTS, LineStatistics, limits_of
from station.reporting.words import words_of
from station.service.line_statistics import gather_statistics
from tests.fakes import fixture_run


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("log")
    fixture_run.run(made, units=8, faults=("SN0002/stuck-axis:value=2",))
    fixture_run.run(made, ["SN0002"])
    return made / "station.db"


@pytest.fixture(scope="module")
def line(database: Path) -> LineStatistics:
    with SqliteLogReader(database) as log:
        return gather_statistics(log, Query(), 100)


def test_a_unit_that_fails_first_and_passes_then_is_no_first_pass(line: LineStatistics) -> None:
    (all_of_it,) = line.yields["station"]
    assert (all_of_it.units, all_of_it.first_pass, all_of_it.final_pass, all_of_it.failed) == (8, 7, 8, 1)
    assert sum(line.reasons.values()) == 1
    assert [m.outcome for m in line.attempts].count("PASS") == 8


def test_every_split_is_what_the_log_says_by_itself(database: Path, line: LineStatistics) -> None:
    with SqliteLogReader(database) as log:
        for by, found in line.yields.items():
            alone = log.yields(Query(), by)
            assert [(y.group, y.attempts, y.units, y.first_pass, y.final_pass) for y in found] == [
                (y.group, y.attempts, y.units, y.first_pass, y.final_pass) for y in alone
            ]
            assert [y.mean_duration_s for y in found] == pytest.approx([y.mean_duration_s for y in alone])


def test_parts_of_the_cycle_make_the_cycle(line: LineStatistics) -> None:
    for m in line.attempts:
        assert set(m.parts) == set(CYCLE_PARTS)
        assert sum(m.parts.values()) == pytest.approx(m.values["cycle time"], abs=1e-6)
        assert min(m.parts.values()) >= 0


def test_the_capability_is_that_of_the_values_in_the_log(line: LineStatistics) -> None:
    drawn = charts.draw(line, "offset x", 2, words_of("en"))
    rows = next(t for t in drawn.tables if t.title == "Capability: offset x").rows
    table = {row[0]: row[1] for row in rows}
    values = np.array([m.values["offset x"] for m in line.attempts if "offset x" in m.values])
    assert line.recipe is not None
    expected = capability.capability(values.reshape(-1, 2), *limits_of("offset x", line.recipe.limits))
    assert table["n"] == str(len(values))
    assert table["Cpk"].split()[0] == f"{expected.cpk[0]:.4g}".replace("-", "−")
    assert expected.cp is not None
    assert table["Cp"].split()[0] == f"{expected.cp[0]:.4g}"


def test_every_figure_is_there(line: LineStatistics) -> None:
    titles = "".join(map(str, charts.draw(line, "gain z", 2, words_of("en")).figures))
    for wanted in (
        "Yield by day",
        "Reasons of attempts",
        "Cycle time",
        "gain z: mean (n = 2)",
        "range (n = 2)",
        "Tilt of each",
    ):
        assert wanted in titles
    assert "moving range" in "".join(map(str, charts.draw(line, "noise", 1, words_of("en")).figures))


def test_too_few_values_are_said_and_wrong_ones_refused(line: LineStatistics) -> None:
    assert "needs two subgroups" in charts.draw(line, "offset x", 20, words_of("en")).problem
    with pytest.raises(UsageError, match="There is no value"):
        charts.draw(line, "offset q", 1, words_of("en"))


def test_an_empty_log_has_an_empty_report(database: Path) -> None:
    with SqliteLogReader(database) as log:
        nothing = gather_statistics(log, Query(station="elsewhere"), 100)
    drawn = charts.draw(nothing, "offset x", 1, words_of("en"))
    assert drawn.figures == ()
    assert drawn.problem


def test_the_command_writes_one_page_that_needs_nothing_else(
    database: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report.html"
    with pytest.raises(SystemExit) as ended:
        main(["report", "--db", str(database), "--size", "2", "--out", str(out), "--json"])
    assert ended.value.code == 0
    shown = json.loads(capsys.readouterr().out)
    assert (shown["schema"], shown["attempts"]) == ("station.report/1", 9)
    page = out.read_text()
    assert "<svg" in page
    assert "src=" not in page
    assert "href=" not in page


def test_the_mark_counts_what_the_yields_count(tmp_path: Path) -> None:
    brief = fixture_run.brief_recipe(tmp_path)
    fixture_run.run(tmp_path, ["SN0001"], recipe=brief)
    fixture_run.run(tmp_path, ["SN0002"], recipe=fixture_run.recipe(tmp_path, "six-point", version=2))
    with SqliteLogReader(tmp_path / "station.db") as log:
        line = gather_statistics(log, Query(), 100)
    assert (len(line.attempts), line.simulated) == (1, 2), "values are of one recipe, the report of all"
