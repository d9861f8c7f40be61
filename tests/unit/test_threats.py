"""docs/threats.md names only tests that exist, and names one for every threat that it calls defended."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "threats.md").read_text(encoding="utf-8")
FOLDERS = ("integration", "plant", "system")
ROWS = [line for line in TEXT.splitlines() if line.startswith("|") and ".py`" in line]


def test_every_defence_names_a_test_that_exists() -> None:
    assert len(ROWS) > 15
    for row in ROWS:
        named = re.findall(r"`(?:tests/(?:integration|plant|system)/)?(test_\w+\.py)`", row)
        assert named, row
        for name in named:
            assert any((ROOT / "tests" / folder / name).exists() for folder in FOLDERS), name
