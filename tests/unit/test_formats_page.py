"""docs/formats.md is what the code does: its commands, columns and effect ids; nothing cites what is not here."""

import re
from pathlib import Path

from station import plugins
from station.adapters.samples.columns import ALL_COLUMNS, REQUIRED_COLUMNS
from station.cli.app import commands
from station.model.model_file import EFFECTS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def first_cells(text: str) -> set[str]:
    """Code words in the first column of the tables."""
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("|")]
    return {word for row in rows for word in re.findall(r"`([^`]+)`", row)}


def test_every_command_has_its_row() -> None:
    assert {word.removeprefix("station ") for word in first_cells(section("Commands"))} == set(commands())


def test_every_column_has_its_row() -> None:
    table = section("Samples table")
    assert first_cells(table) == set(ALL_COLUMNS)
    must = {
        word for line in table.splitlines() if "| yes |" in line for word in re.findall(r"`(\w+)`", line.split("|")[1])
    }
    assert must == set(REQUIRED_COLUMNS)


def test_every_effect_has_its_row() -> None:
    assert first_cells(section("Effects")) == set(plugins.names(EFFECTS))


def test_nothing_cites_documents_that_are_not_in_the_repository() -> None:
    cites = re.compile(r"\bmethod notes\b|\b[Cc]ontracts,? section|\bcontracts' (form|parameter)")
    files = [*ROOT.glob("station/**/*.py"), *ROOT.glob("docs/**/*.md"), ROOT / "README.md"]
    assert [f.name for f in files if cites.search(f.read_text(encoding="utf-8"))] == []


def test_every_page_that_a_docstring_cites_exists() -> None:
    cited = {
        (f.name, page)
        for f in ROOT.glob("station/**/*.py")
        for page in re.findall(r"docs/[\w/.-]+\.md", f.read_text(encoding="utf-8"))
    }
    assert sorted(c for c in cited if not (ROOT / c[1]).exists()) == []
