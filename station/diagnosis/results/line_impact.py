"""What the causes mean for production: calibration, verdict and yield of the units, with and without them.

Both sides are the station's own calibration by the recipe's method: of the readings as they came, and of the readings
with gross faults corrected and causes subtracted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from station.diagnosis.results.diagnose import Diagnosis
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats, Outcome
from station.domain.evaluation import pipeline
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.evaluation.unit_dwells import UnitDwells
from station.domain.recipe.recipe import Recipe
from station.errors import StationError

#: A thousandth of a recipe's unit, as a line speaks of it.
MILLI_UNITS = {"g": "mg", "uT": "nT", "deg/s": "mdeg/s"}
#: Limits of coefficients and visits; without any of them there is no verdict to change.
JUDGED_LIMITS = ("offset", "gain", "cross_axis", "residual", "consistency", "tilt_deg")

#: Readings that move by a smaller share of the stimulus do not move: it is rounding.
ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class UnitImpact:
    """One unit: how far offset (3), in the recipe's unit, and matrix (3, 3) move once the causes are gone; moves: the
    rms of what this does to an axis of a calibrated reading over all directions, in the recipe's unit; both
    outcomes."""

    serial: str
    offset: Floats
    matrix: Floats
    shift_rms: float
    before: Outcome
    after: Outcome


@dataclass(frozen=True, slots=True, eq=False)
class LineImpact:
    """Every unit that can be calibrated with and without the causes; limits: whether the recipe has any to judge by."""

    units: tuple[UnitImpact, ...]
    limits: bool

    def passed(self, *, after: bool) -> int:
        """Units that pass."""
        return sum((u.after if after else u.before) is Outcome.PASS for u in self.units)

    @property
    def changed(self) -> int:
        """Units whose outcome is another one without the causes."""
        return sum(u.before is not u.after for u in self.units)


def assess_line_impact(d: Diagnosis, today: str) -> LineImpact | None:
    """What was found, in terms of production; None where nothing was found or nothing can be calibrated. today: ISO
    8601, for what is due in the recipe."""
    if not (d.faults or d.causes):
        return None
    try:
        before, after = _results(d.recipe, *_measured_and_corrected(d), today)
    except StationError:
        # Data that can be diagnosed need not be such that the recipe's method can calibrate them.
        return None
    strength = d.recipe.reference.strength()
    limits = any(getattr(d.recipe.limits, name) is not None for name in JUDGED_LIMITS)
    return LineImpact(_impacts(before, after, strength), limits)


def _impacts(
    before: Sequence[CalibrationResult], after: Sequence[CalibrationResult], strength: float
) -> tuple[UnitImpact, ...]:
    """Of the units that are calibrated both ways: one whose gross fault leaves nothing to fit has no after."""
    corrected = {a.serial: a for a in after}
    units = (_unit_impact(b, corrected[b.serial], strength) for b in before if b.serial in corrected)
    return tuple(u for u in units if u is not None)


def cause_contribution(problem: ScoringProblem, i: int) -> tuple[Floats, Floats]:
    """What an accepted cause adds to the means of the visits (v, 3) and to their contrasts (v, B−1, 3)."""
    with_it, without = problem.view.simulated(), problem.without(i).view.simulated()
    return with_it[0] - without[0], with_it[1] - without[1]


def new_causes(d: Diagnosis) -> Sequence[int]:
    """Numbers of the causes that this diagnosis has accepted, beside those of the model."""
    return range(len(d.search_result.first.accepted), len(d.last.accepted))


def document(line: LineImpact | None, unit: str) -> dict[str, Any] | None:
    """As the diagnosis' JSON has it; lengths in thousandths of the recipe's unit. Verdicts are null without limits."""
    if line is None or not line.units:
        return None
    judged, total = line.limits, len(line.units)
    passed = [line.passed(after=after) if judged else None for after in (False, True)]
    return {
        "unit": MILLI_UNITS.get(unit, f"1e-3 {unit}"),
        "units": [_unit_document(u, judged=judged) for u in line.units],
        "verdicts_changed": line.changed if judged else None,
        "passed_before": passed[0],
        "passed_after": passed[1],
        "yield_before": None if passed[0] is None else passed[0] / total,
        "yield_after": None if passed[1] is None else passed[1] / total,
    }


def _unit_document(u: UnitImpact, *, judged: bool) -> dict[str, Any]:
    return {
        "serial": u.serial,
        "offset": (1e3 * u.offset).tolist(),
        "matrix": u.matrix.tolist(),
        "moves": 1e3 * u.shift_rms,
        "before": str(u.before) if judged else None,
        "after": str(u.after) if judged else None,
    }


def _results(
    recipe: Recipe, before: list[UnitDwells], after: list[UnitDwells], today: str
) -> tuple[list[CalibrationResult], list[CalibrationResult]]:
    """Of both, solved together, by serial."""
    found = list(pipeline.calibrate_dwells(recipe, [*before, *after], today))
    was, now = found[: len(before)], found[len(before) :]
    return sorted(was, key=lambda r: r.serial), sorted(now, key=lambda r: r.serial)


def _measured_and_corrected(d: Diagnosis) -> tuple[list[UnitDwells], list[UnitDwells]]:
    """The dwells of every unit as measured, and with gross faults corrected and every new cause subtracted."""
    measured = d.samples.dwells(d.recipe)
    corrected = measured if d.inspection.as_measured else d.inspection.samples.dwells(d.recipe)
    effect = sum((cause_contribution(d.last, i)[0] for i in new_causes(d)), np.zeros_like(d.last.view.reduced.mean))
    ends = np.cumsum([len(unit) for unit in corrected])[:-1]
    return measured, [_less(unit, own) for unit, own in zip(corrected, np.split(effect, ends), strict=True)]


def _less(unit: UnitDwells, effect: Floats) -> UnitDwells:
    """A unit whose readings in each dwell are reduced by an effect (v, 3)."""
    d = unit.dwells
    return replace(unit, dwells=replace(d, mean=d.mean - effect, low=d.low - effect, high=d.high - effect))


def _unit_impact(before: CalibrationResult, after: CalibrationResult, strength: float) -> UnitImpact | None:
    was, now = before.calibration, after.calibration
    if was is None or now is None:
        return None
    offset, matrix = now.offset - was.offset, now.matrix - was.matrix
    # Over all directions a stimulus of length s has s²/3 along each axis.
    moves = float(np.sqrt((offset @ offset + strength**2 / 3 * np.sum(matrix**2)) / 3))
    moves = moves if moves > ROUNDING * strength else 0.0
    return UnitImpact(before.serial, offset, matrix, moves, before.verdict.outcome, after.verdict.outcome)
