"""What a benchmark found, kept for the one table that `table.py` prints; run by itself, a benchmark only prints."""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

#: Names the file to which figures are added, one JSON object a line.
STORED_IN = "STATION_BENCH_FIGURES"


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the table. row: its number in the list of goals; figure: with spread and runs; peer: what it is
    measured against, or the limit, with versions."""

    row: int
    what: str
    figure: str
    peer: str
    goal: str
    reached: bool


def keep(row: int, what: str, figure: str, peer: str, goal: str, reached: bool) -> None:
    """Keeps one line of the table, where somebody collects them."""
    if path := os.environ.get(STORED_IN):
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(Figure(row, what, figure, peer, goal, bool(reached)))) + "\n")


def stored(path: Path) -> list[Figure]:
    """Every line that was kept, in the order of keeping."""
    if not path.exists():
        return []
    return [Figure(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def spread(values: Sequence[float], unit: str = "", digits: int = 3) -> str:
    """Median, least to greatest, and the number of runs."""
    ordered = sorted(values)
    n = len(ordered)
    middle = (ordered[(n - 1) // 2] + ordered[n // 2]) / 2
    return f"{middle:.{digits}g}{unit} ({ordered[0]:.{digits}g} to {ordered[-1]:.{digits}g}, {n} runs)"
