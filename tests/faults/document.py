"""docs/faults.md from the table: `python -m tests.faults.document` writes it, a test finds it stale."""

from itertools import groupby
from pathlib import Path

from tests.faults.table import ROWS, Row

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"

_HEAD = """# What can go wrong, and what the station does

Written by `python -m tests.faults.document` from `tests/faults/table.py`; every row is run by
`tests/integration/test_faults.py`: by `make test` one of each kind, by `make test ALL=1` and `make torture` all.
{count} faults: each has one outcome, one sentence, one exit code.

`inject` is how the test does it (`tests/faults/inject.py`). By hand: a `device …` fault with
`station run --simulate --units 1 --fault KIND:key=value`, a `wire …` fault with
`--fault BUS/KIND:after_s=S,seconds=S`. **flash** is what the device holds when power comes back: *old* (nothing new was
kept), *new* (all the new values), or *mixed*, which the record shows and the next station to see the unit refuses.
`…` stands for the part of the sentence that names object, place or file. What a unit that passes leaves behind in its
record is in bold.
"""


def document() -> str:
    """The whole page."""
    parts = [_HEAD.format(count=len(ROWS))]
    for area, rows in groupby(ROWS, key=lambda row: row.area):
        lines = [_line(row) for row in rows]
        head = "| fault | inject | outcome | exit | says, **keeps** | flash |\n|---|---|---|---|---|---|"
        parts.append("\n".join([f"## {area}\n", head, *lines]) + "\n")
    return "\n".join(parts)


def _line(row: Row) -> str:
    says = f"… {row.says} …" if row.says else f"**… {row.keeps} …**" if row.keeps else ""
    flash = "old" if row.flash == "nothing new" else row.flash
    return f"| {row.fault} | `{row.inject}` | {row.outcome} | {row.code} | {says} | {flash} |"


if __name__ == "__main__":
    PAGE.write_text(document(), encoding="utf-8")
