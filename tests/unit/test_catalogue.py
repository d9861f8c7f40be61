"""The page of causes is what the effect files say now."""

from pathlib import Path

from station import plugins
from station.model import catalogue

PAGE = Path(__file__).resolve().parents[2] / "docs" / "effects.md"


def test_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == catalogue.page(), "run: station effects --markdown > docs/effects.md"


def test_every_cause_is_on_the_page_and_in_the_rows() -> None:
    rows = {row["effect"]: row for row in catalogue.rows()}
    assert set(rows) == set(plugins.names("station.model.effects"))
    page = catalogue.page()
    for name, row in rows.items():
        physics = row["physics"].replace("|", "\\|")
        assert f"| `{name}` | {physics} |" in page
    assert rows["warm-up"]["needs"] == ["since_power_s"]
    assert rows["axis-permutation"]["parameters"][0]["typical"] == "-y,x,z"
