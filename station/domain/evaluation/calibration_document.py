"""Results as plain documents: `station.calibration/1` (docs/formats.md), with what else is known beside it."""

from dataclasses import asdict
from typing import Any

import numpy as np

from station.domain.core.types import Calibration, ReducedVisits
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.methods import decision, uncertainty, visit_limits
from station.domain.recipe.recipe import Recipe
from station.messages import render

SCHEMA = "station.calibration/1"
#: Where a unit could not be calibrated these are null.
ABSENT = (
    *("offset", "matrix", "covariance", "residual_rms", "positions", "false_accept", "false_reject"),
    *("budget", "rules", "residuals", "decisions"),
)


def head(recipe: Recipe) -> dict[str, Any]:
    """What stands above the units."""
    return {
        "schema": SCHEMA,
        "recipe": {"name": recipe.name, "version": recipe.version},
        "method": recipe.method,
        "unit": recipe.unit,
        "rule": render(decision.rule_of(recipe.limits)),
    }


def unit(result: CalibrationResult) -> dict[str, Any]:
    """One unit: outcome with every reason as a sentence, coefficients, positions, budget."""
    verdict, found = result.verdict, result.calibration
    head: dict[str, Any] = {
        "serial": result.serial,
        "outcome": str(verdict.outcome),
        "reasons": [r.sentence for r in verdict.reasons],
        "messages": [r.message.document() for r in verdict.reasons],
        "checks": [r.document() for r in verdict.reasons],
    }
    if found is None or result.visits is None or result.budget is None or not _finite(found):
        return {**head, **dict.fromkeys(ABSENT), "notes": []}
    return {
        **head,
        **coefficients(found, result.visits),
        "false_accept": verdict.false_accept,
        "false_reject": verdict.false_reject,
        "budget": result.budget.document(found.unit),
        "rules": uncertainty.RULES,
        "residuals": dict(zip(("ratio", "dof"), result.budget.residuals, strict=True)),
        "decisions": [asdict(d) | {"margin": d.margin} for d in result.decisions],
        "temperature_degC": _number(np.mean(result.visits.temperature_degC)),
        "notes": [render(note) for note in found.notes],
        "note_messages": [note.document() for note in found.notes],
    }


def _finite(found: Calibration) -> bool:
    """Whether there is anything to tell: JSON knows no NaN."""
    parts = (found.offset, found.matrix, found.covariance, found.residual, found.tilt_deg, found.tilt_std_deg)
    return all(bool(np.isfinite(part).all()) for part in parts)


def coefficients(found: Calibration, visits: ReducedVisits) -> dict[str, Any]:
    """Coefficients, their covariance, and what is left at each visit."""
    return {
        "offset": found.offset.tolist(),
        "matrix": found.matrix.tolist(),
        "covariance": found.covariance.tolist(),
        "residual_rms": found.residual_rms,
        "consistency": visit_limits.consistency(visits, found.disturbed)[0],
        "positions": [_position(found, visits, v) for v in range(len(visits))],
    }


def _position(found: Calibration, visits: ReducedVisits, v: int) -> dict[str, Any]:
    return {
        "name": visits.position[v],
        "seating": visits.seating[v],
        "run": int(visits.run[v]),
        "visit": int(visits.visit[v]),
        "residual": found.residual[v].tolist(),
        "tilt_deg": float(found.tilt_deg[v]),
        "tilt_std_deg": float(found.tilt_std_deg[v]),
        "disturbed": bool(found.disturbed[v]),
        "mean": visits.mean[v].tolist(),
        "std_of_mean": np.sqrt(np.diagonal(visits.cov[v])).tolist(),
        "count": int(visits.count[v]),
        "effective": float(visits.effective[v]),
        "temperature_degC": _number(visits.temperature_degC[v]),
    }


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
