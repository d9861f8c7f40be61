"""Documents cannot go stale: every command line they show exists, every help has an example, links lead somewhere."""

import contextlib
import io
import re
import shlex
from functools import cache
from pathlib import Path

import pytest

from station.cli.app import commands, main
from station.config.recipes import load_recipe
from station.domain.recipe.recipe import Recipe
from station.domain.recipe.reference_block import Reference

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```[a-z]*\n(.*?)^```", re.MULTILINE | re.DOTALL)


@cache
def help_of(command: str) -> str:
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown), pytest.raises(SystemExit):
        main([command, "--help"])
    return shown.getvalue()


def shown(page: Path) -> list[list[str]]:
    """Command lines of `station` in the code blocks of a page, and of every command's help."""
    lines = [line for block in BLOCK.findall(page.read_text(encoding="utf-8")) for line in block.splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("station ")]


def check(words: list[str]) -> None:
    name = words[1]
    if name.startswith("-"):
        assert name in ("--help", "--version")
        return
    assert name in commands(), f"there is no command {name}"
    for word in words[2:]:
        if word.startswith("--"):
            assert word.partition("=")[0] in help_of(name), f"station {name} has no {word}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_command_line_of_a_page_exists(page: Path) -> None:
    for words in shown(page):
        check(words)


@pytest.mark.parametrize("name", sorted(commands()))
def test_every_example_in_a_help_exists(name: str) -> None:
    lines = [line.strip() for line in help_of(name).splitlines() if line.startswith("      station ")]
    assert lines, f"station {name} --help shows no example"
    for line in lines:
        check(shlex.split(line))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_link_leads_to_a_file(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_recipe_page_names_every_key() -> None:
    page = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    for name, field in (*Recipe.model_fields.items(), *Reference.model_fields.items()):
        assert f"`{field.alias or name}" in page or f"{name}:" in page, f"docs/recipes.md says nothing of {name}"


def test_every_shipped_recipe_is_read_and_called_as_its_file() -> None:
    for path in sorted((ROOT / "recipes").glob("*.yaml")):
        assert load_recipe(path).name == path.stem


def test_the_readme_is_read_in_a_few_minutes() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120
