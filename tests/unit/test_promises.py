"""docs/promises.md names only tests that exist, and every promise names one."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
NAMED = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", TEXT)


def functions(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_test_named_on_the_page_exists() -> None:
    assert len(NAMED) > 20
    assert [f"{path}::{name}" for path, name in NAMED if name not in functions(ROOT / path)] == []


def test_every_promise_names_a_test_that_would_break_it() -> None:
    promises = re.split(r"^\* \*\*", TEXT, flags=re.MULTILINE)[1:]
    assert len(promises) > 12
    assert [p.splitlines()[0] for p in promises if "::test_" not in p] == []
