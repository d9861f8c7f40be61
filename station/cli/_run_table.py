"""How a run ended: a table for people, `station.run/1` for programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from station.cli import _face
from station.domain.progress import UnitResult
from station.domain.recipe import Recipe
from station.domain.types import Outcome
from station.service import record

#: Colour and symbol: colour alone tells nothing to one man in twelve.
LOOK = {
    Outcome.PASS: ("green", "✔"),
    Outcome.FAIL: ("red", "✘"),
    Outcome.ERROR: ("yellow", "!"),
    Outcome.ABORTED: ("magenta", "■"),
    Outcome.INTERRUPTED: ("magenta", "…"),
}
#: A pipe has no width; this holds every column on one line.
PIPE_WIDTH = 132


def table(results: Sequence[UnitResult], recipe: Recipe, database: Path) -> None:
    """Prints the table, then every reason of those that did not pass, then where the log is."""
    from rich.table import Table

    unit = recipe.unit
    shown = Table(title=f"{recipe.name} version {recipe.version}", title_justify="left")
    for title in ("serial", "nest", "verdict"):
        shown.add_column(title)
    for title in (f"offset x y z, {unit}", "gain x y z", f"noise, {unit}", "time, s"):
        shown.add_column(title, justify="right")
    for r in results:
        colour, symbol = LOOK[r.outcome]
        shown.add_row(
            r.seat.serial,
            r.seat.nest,
            f"[{colour}]{symbol} {r.outcome}[/{colour}]",
            "" if r.calibration is None else _numbers(r.calibration.offset, "+.5f"),
            "" if r.calibration is None else _numbers(np.diagonal(r.calibration.matrix), ".5f"),
            "" if r.noise is None else f"{r.noise:.2g}",
            f"{r.duration_s:.1f}",
        )
    console = _face.console()
    console.print(shown, width=None if console.is_terminal else PIPE_WIDTH)
    for r in results:
        if r.outcome is not Outcome.PASS:
            for reason in r.reasons:
                console.print(f"{r.seat.serial}: {reason.sentence}", markup=False)
    console.print(f"log: {database}", markup=False)


def document(results: Sequence[UnitResult], recipe: Recipe) -> dict[str, Any]:
    """The run as `station.run/1`."""
    return {
        "schema": "station.run/1",
        "recipe": {"name": recipe.name, "version": recipe.version},
        "method": recipe.method,
        "unit": recipe.unit,
        "units": [_unit(r) for r in results],
    }


def _unit(r: UnitResult) -> dict[str, Any]:
    names = ("offset", "matrix", "covariance", "residual_rms", "positions", "notes")
    found = {} if r.calibration is None else record.calibration(r.calibration)
    return {
        "serial": r.seat.serial,
        "outcome": str(r.outcome),
        "reasons": [reason.sentence for reason in r.reasons],
        **{name: found.get(name) for name in names},
        "false_accept": None if r.verdict is None else r.verdict.false_accept,
        "false_reject": None if r.verdict is None else r.verdict.false_reject,
        "nest": r.seat.nest,
        "attempt": r.attempt,
        "written": r.written,
        "verified": r.verified,
        "noise": r.noise,
        "duration_s": r.duration_s,
    }


def _numbers(values: Any, how: str) -> str:
    return " ".join(format(float(v), how) for v in values)
