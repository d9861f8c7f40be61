"""docs/architecture.md shows the rooms that there are."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PICTURE = (ROOT / "docs" / "pictures" / "architecture.svg").read_text(encoding="utf-8")
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_picture_shows_every_floor_and_room() -> None:
    shown = set(re.findall(r'font-weight="bold"[^>]*>(\w+)<', PICTURE))
    floors = {p.stem for p in (ROOT / "station").iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    rooms = {p.parent.name for p in (ROOT / "station").glob("*/*/__init__.py")}
    missing = (floors - {"__init__", "__main__"} | rooms) - shown
    assert not missing, f"run `make drawing`: {sorted(missing)}"


def test_every_place_that_the_page_names_exists() -> None:
    for place in re.findall(r"`((?:station|tests|dbc|docs)/[\w/]*)", PAGE):
        assert (ROOT / place).exists() or (ROOT / f"{place}.py").exists(), place
