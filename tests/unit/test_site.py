"""The site's source: every page in the navigation, a reference of the code as it is, no link that leads nowhere."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from station.cli.app import commands
from station.config.settings import Settings

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def builder() -> ModuleType:
    """docs/site/build.py."""
    spec = importlib.util.spec_from_file_location("site_build", ROOT / "docs" / "site" / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def source(builder: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages as Sphinx gets them."""
    folder = tmp_path_factory.mktemp("source")
    builder.assemble(folder)
    return folder


def test_every_page_is_in_the_navigation(source: Path) -> None:
    trees = re.findall(r"```{toctree}\n(.*?)```", (source / "index.md").read_text("utf-8"), re.DOTALL)
    listed = {line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")}
    pages = {p.relative_to(source).with_suffix("").as_posix() for p in source.rglob("*.md")}
    assert {p for p in pages if not p.startswith("decisions/")} - listed == {"index"}


def test_the_reference_is_the_codes(source: Path) -> None:
    shown = (source / "reference" / "commands.md").read_text("utf-8")
    assert [name for name in commands() if f"## station {name}\n" not in shown] == []
    keys = (source / "reference" / "config.md").read_text("utf-8")
    assert [
        f.alias or name for name, f in Settings.model_fields.items() if f"| `{f.alias or name}` |" not in keys
    ] == []


def test_no_link_leads_out_of_the_site_or_nowhere(source: Path) -> None:
    dead = [
        (path.name, target)
        for path in source.rglob("*.md")
        for target in re.findall(r"\]\((?!https?:|mailto:|#|/)([^)#\s]+)", path.read_text("utf-8"))
        if not (path.parent / target).exists()
    ]
    assert dead == []
