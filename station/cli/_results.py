"""How units ended: a table for people, one document for programs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from station.cli import _output
from station.cli._layout import TextTable
from station.domain.core.folded_reasons import folded_units
from station.domain.core.types import Calibration, Outcome, Reason
from station.domain.evaluation import calibration_document
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.recipe.recipe import Recipe
from station.domain.run.progress import UnitResult

#: Colour and symbol: colour alone tells nothing to one man in twelve.
OUTCOME_STYLES = {
    Outcome.PASS: ("green", "✔"),
    Outcome.FAIL: ("red", "✘"),
    Outcome.ERROR: ("yellow", "!"),
    Outcome.ABORTED: ("magenta", "■"),
    Outcome.INTERRUPTED: ("magenta", "↯"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One unit in the table. place: nest or node; noise in the recipe's unit."""

    serial: str
    place: str
    outcome: Outcome
    reasons: tuple[Reason, ...]
    fit: CalibrationResult | None
    noise: float | None
    duration_s: float
    verification: Mapping[str, Any] | None = None

    @property
    def calibration(self) -> Calibration | None:
        """The coefficients, when it came so far."""
        return None if self.fit is None else self.fit.calibration


def run_row(r: UnitResult) -> Row:
    """The row of a run's unit."""
    return Row(r.seat.serial, r.seat.nest, r.outcome, r.reasons, r.fit, r.noise, r.duration_s, r.verification)


def print_results(rows: Sequence[Row], recipe: Recipe) -> None:
    """Prints the table, then every reason of those that did not pass."""
    axes = " ".join("xyz"[: recipe.axes])
    heads = ("serial", "nest", "verdict", f"offset {axes}", f"gain {axes}", "noise", "time")
    shown = [(r.serial, r.place, _marked(r.outcome), *_figures(r, recipe)) for r in rows]
    title = f"{recipe.name} version {recipe.version}; offsets and noise in {recipe.unit}, time in s"
    colours = {_marked(outcome): colour for outcome, (colour, _) in OUTCOME_STYLES.items()}
    _output.print_table(title, TextTable(heads, shown, right=frozenset(range(3, len(heads)))), colours)
    for line in folded_units([(r.serial, r.reasons) for r in rows if r.outcome is not Outcome.PASS]):
        _output.print_line(line)
    for r in rows:
        if sentence := _gain_sentence(r):
            _output.print_line(f"{r.serial}: {sentence}")


def _figures(r: Row, recipe: Recipe) -> tuple[str, ...]:
    """Offsets, gains, noise and time; nothing where it did not come so far."""
    digits = max(0, 4 - int(np.log10(max(recipe.reference.strength(), 1.0))))
    found, axes = r.calibration, recipe.axes
    return (
        "" if found is None else _format_numbers(found.offset[:axes], f"+.{digits}f"),
        "" if found is None else _format_numbers(np.diagonal(found.matrix)[:axes], ".4f"),
        "" if r.noise is None else f"{r.noise:.1e}",
        f"{r.duration_s:.1f}",
    )


def _marked(outcome: Outcome) -> str:
    """The outcome with its symbol."""
    return f"{OUTCOME_STYLES[outcome][1]} {outcome}"


def _gain_sentence(r: Row) -> str:
    """What a model's causes in the calibration gain at the verify positions; nothing where there is nothing to say."""
    if r.verification is None or not r.verification.get("takes_in"):
        return ""
    positions, unit = r.verification["positions"], r.verification["unit"]
    before = [p["error_before"] for p in positions if "error_before" in p]
    if not before:
        return ""
    now = [p["error"] for p in positions]
    names = " and ".join(r.verification["takes_in"])
    return (
        f"with {names} in the calibration the device's own output is off by {_rms(now):.2g} {unit} rms at "
        f"{len(now)} verify positions; it would be {_rms(before):.2g} {unit} without"
    )


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def unit_document(r: Row) -> dict[str, Any]:
    """A unit as `station.calibration/1` prints it; what was not reached is null."""
    calibration = dict.fromkeys(calibration_document.ABSENT) if r.fit is None else calibration_document.unit(r.fit)
    return {
        **calibration,
        "serial": r.serial,
        "outcome": str(r.outcome),
        "reasons": [s.sentence for s in r.reasons],
        "messages": [s.message.document() for s in r.reasons],
    }


def run_document(results: Sequence[UnitResult], recipe: Recipe, *, simulated: bool) -> dict[str, Any]:
    """A run as `station.run/1`."""
    return {
        "schema": "station.run/1",
        "simulated": simulated,
        "recipe": {"name": recipe.name, "version": recipe.version},
        "method": recipe.method,
        "unit": recipe.unit,
        "units": [
            {
                **unit_document(run_row(r)),
                "nest": r.seat.nest,
                "attempt": r.attempt,
                "written": r.written,
                "verified": r.verified,
                "noise": r.noise,
                "verification": r.verification,
                "duration_s": r.duration_s,
            }
            for r in results
        ],
    }


def _format_numbers(values: Any, how: str) -> str:
    return " ".join(format(float(v), how) for v in values)
