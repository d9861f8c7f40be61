"""Calibrations as tables for people."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import isnan

import numpy as np

from station.cli import _budget_table, _output
from station.cli._layout import TextTable
from station.domain.core.folded_reasons import folded, folded_notes
from station.domain.core.types import Floats, Outcome
from station.domain.evaluation.model_comparison import LargerModel
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.methods import coefficients, decision, method
from station.domain.methods.uncertainty import Budget
from station.domain.recipe.recipe import Recipe
from station.messages import Message, render

#: Units whose details are printed; all of them stand in the JSON document.
MOST_DETAILED = 20
#: A tilt known less well than this says nothing.
MOST_TILT_U95_DEG = 30.0
#: A coefficient known to no more than this share of the stimulus is remarked.
HARDLY_KNOWN = 0.05


@dataclass(slots=True)
class CalibrationSummary:
    """What is kept of the units for people: the first few whole, the rest as counts.

    refused: sentences of units that could not be calibrated, as many as a person reads.
    """

    first: list[CalibrationResult] = field(default_factory=list)
    larger: list[Sequence[LargerModel]] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    calibrated: int = 0
    worst_false_accept: float = 0.0

    def add(self, result: CalibrationResult, larger: Sequence[LargerModel]) -> None:
        """Counts one unit."""
        verdict = result.verdict
        self.outcomes[verdict.outcome] += 1
        self.calibrated += result.calibration is not None
        if len(self.first) < MOST_DETAILED:
            # Samples of the units shown may go; nobody prints them.
            self.first.append(replace(result, dwells=None))
            self.larger.append(larger)
        if verdict.outcome is Outcome.PASS:
            self.worst_false_accept = max(self.worst_false_accept, verdict.false_accept)
        if verdict.outcome is Outcome.ERROR and len(self.refused) < MOST_DETAILED:
            self.refused.append(verdict.reasons[0].sentence)


def print_calibrations(recipe: Recipe, summary: CalibrationSummary, *, with_budget: bool, compared: bool) -> None:
    """Prints the table, then for each unit every reason and note, its budget, and whether larger models pay."""
    _output.print_table(f"{recipe.name} version {recipe.version}, {recipe.method}", _table(recipe, summary.first))
    rest = summary.outcomes.total() - len(summary.first)
    if rest:
        _output.print_line(f"and {rest} more units; --json FILE holds them all")
    for r, larger in zip(summary.first, summary.larger, strict=True):
        for line in (*map(render, folded(r.verdict.reasons)), *_notes(r), *_larger(recipe, larger)):
            _output.print_line(f"{r.serial}: {line}")
        for line in _hardly_known(recipe, r):
            _output.print_line(line)
        if with_budget and r.budget is not None:
            title = f"{r.serial}: standard uncertainty by cause"
            _output.print_line(title)
            for table in _budget_table.budget_tables(r.budget, recipe.unit):
                _output.print_table("", table)
    if compared and not method.of(recipe).open_ended:
        _output.print_line(
            f"quadratic and cubic terms: not compared, since the positions of {recipe.method} cannot tell them; "
            "n-point and norm take positions that can"
        )
    _output.print_line(_summary(recipe, summary))


def _larger(recipe: Recipe, models: Sequence[LargerModel]) -> Iterator[str]:
    for m in models:
        if isnan(m.p):
            yield f"{m.terms} terms: these positions cannot tell them"
            continue
        yield (
            f"{m.terms} terms {'pay' if m.pays else 'do not pay'}: F test p = {m.p:.2g}; residual leaving one pose out "
            f"{m.rms_left_out:.3g} -> {m.larger_rms_left_out:.3g} {recipe.unit}"
        )


def _table(recipe: Recipe, results: Sequence[CalibrationResult]) -> TextTable:
    """A row for each axis of a unit."""
    unit = recipe.unit
    figures = (f"offset, {unit}", "± 95 %", "gain", "± 95 %", f"rms, {unit}", "worst tilt, deg")
    heads: tuple[str, ...] = ("serial", "verdict", "axis", *figures)
    rows: list[tuple[str, ...]] = []
    for r in results:
        for i, axis in enumerate("xyz"[: recipe.axes]):
            head = (r.serial, _outcome(recipe, r)) if i == 0 else ("", "")
            rows.append((*head, axis, *_cells(r, i)))
    if not any(row[-1] for row in rows):  # no pose is known, or no tilt
        heads, rows = heads[:-1], [row[:-1] for row in rows]
    return TextTable(heads, rows, right=frozenset(range(3, len(heads))))


def _outcome(recipe: Recipe, r: CalibrationResult) -> str:
    """A PASS decides nothing where nothing is limited, so none is shown there."""
    outcome = r.verdict.outcome
    return "no limits" if outcome is Outcome.PASS and not coefficients_limited(recipe) else str(outcome)


def _cells(r: CalibrationResult, i: int) -> tuple[str, ...]:
    found = r.calibration
    if found is None or r.budget is None:
        return ("",) * 6
    wide, gain = r.budget.expanded(), found.matrix[i, i]
    axis = (f"{found.offset[i]:+.6f}", f"{wide[i]:.2g}", f"{gain:.6f}", f"{wide[3 + 4 * i]:.2g}")
    # An angle that is known to a radian is no angle.
    known = ~found.disturbed & (1.96 * found.tilt_std_deg < MOST_TILT_U95_DEG)
    worst = int(np.argmax(np.where(known, found.tilt_deg, -1.0)))
    if not found.tilt_deg.any() or not known.any():
        return (*axis, f"{found.residual_rms:.2g}" if i == 0 else "", "")
    tilt = f"{found.tilt_deg[worst]:.3f} ± {1.96 * found.tilt_std_deg[worst]:.3f}"
    last = (f"{found.residual_rms:.2g}", tilt) if i == 0 else ("", f"at {found.positions[worst]}" if i == 1 else "")
    return (*axis, *last)


def _hardly_known(recipe: Recipe, r: CalibrationResult) -> Iterator[str]:
    """The least known coefficient, where a limit would hide how little is known."""
    if r.budget is None or coefficients_limited(recipe):
        return
    of = np.where(coefficients.OFFSETS, recipe.reference.strength(), 1.0)
    wide, poses = 1.96 * r.budget.std() / of, 1.96 * _without_magnitude(r.budget) / of
    for what, share in (("coefficient-hardly-known", poses), ("coefficient-hardly-known-reference", wide)):
        k = int(np.argmax(share))
        if share[k] > HARDLY_KNOWN:
            unit = coefficients.unit_of(k, recipe.unit)
            message = Message(
                what, serial=r.serial, coefficient=coefficients.NAMES[k], u95=float(wide[k] * of[k]),
                unit="" if unit == "1" else f" {unit}", share=100 * float(wide[k]),
            )  # fmt: skip
            yield render(message)
            return


def _without_magnitude(budget: Budget) -> Floats:
    """Standard uncertainties (12) that are left where the reference is exact: what poses can better."""
    variance = np.diagonal(budget.total).copy()
    if "magnitude" in budget.parts:
        variance -= np.diagonal(budget.parts["magnitude"])
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def coefficients_limited(recipe: Recipe) -> bool:
    """Whether the recipe has limits for coefficients, so that an unknown one fails."""
    limits = recipe.limits
    return any(v is not None for v in (limits.offset, limits.gain, limits.cross_axis))


def _notes(r: CalibrationResult) -> tuple[str, ...]:
    return () if r.calibration is None else tuple(map(render, folded_notes(r.calibration.notes)))


def _summary(recipe: Recipe, summary: CalibrationSummary) -> str:
    limits, passed = recipe.limits, summary.outcomes[Outcome.PASS]
    total = summary.outcomes.total()
    if not coefficients_limited(recipe):
        return f"{passed} of {total} units calibrated, none judged: the recipe has no limits for coefficients"
    text = f"{passed} of {total} units pass"
    if passed:
        worst = summary.worst_false_accept
        chance = "below 1e-6" if worst < 1e-6 else f"at most {worst:.2g}"
        text += f"; probability of a false accept {chance}; rule {render(decision.rule_of(limits))}"
    return text
