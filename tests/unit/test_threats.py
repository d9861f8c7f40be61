"""docs/threats.md names, for every threat that it calls defended, tests that exist."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "threats.md").read_text(encoding="utf-8")
FOLDERS = ("unit", "integration", "plant", "system")
DEFENDED = TEXT.partition("## The flow")[2].partition("## What is not defended")[0]
ROWS = [line for line in DEFENDED.splitlines() if line.startswith("| ") and not line.startswith("| at |")]
NAMED = re.compile(r"`(test_\w+\.py)`:((?:,? `test_\w+`)+)")


def functions(file: str) -> set[str]:
    (path,) = (ROOT / "tests" / folder / file for folder in FOLDERS if (ROOT / "tests" / folder / file).exists())
    return {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)}


def test_every_defence_names_tests_that_exist() -> None:
    assert len(ROWS) > 30
    for row in ROWS:
        named = NAMED.findall(row)
        assert named, row
        for file, tests in named:
            assert set(re.findall(r"test_\w+", tests)) <= functions(file), row
