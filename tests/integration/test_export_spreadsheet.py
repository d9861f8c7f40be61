"""What people typed cannot become a formula where somebody opens the exported results."""

import csv
from pathlib import Path

import pytest

from station.cli.app import main
from tests.fakes import fixture_run


@pytest.mark.parametrize("lot", ["=1+1", "@SUM(A1)", "-2+3", "+cmd|' /C calc'!A0"])
def test_a_formula_stays_text_and_figures_stay_figures(tmp_path: Path, lot: str) -> None:
    fixture_run.run(tmp_path, ["SN0001"], lot=lot)
    with pytest.raises(SystemExit) as ended:
        main(["export", "--db", str(tmp_path / "station.db"), "--results", str(tmp_path / "r.csv")])
    assert not ended.value.code
    with (tmp_path / "r.csv").open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert row["lot"] == f"'{lot}"
    assert any(value.startswith("-") and float(value) < 0 for value in row.values()), "a negative figure is no text"
