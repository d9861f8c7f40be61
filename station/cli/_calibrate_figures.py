"""What a person looks at to see whether a calibration is good: residuals, tilts, budget."""

from collections.abc import Mapping

import numpy as np

from station.cli._budget_table import NEGLIGIBLE
from station.domain.core.types import Calibration, ReducedVisits
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.methods import coefficients
from station.domain.methods.uncertainty import Budget
from station.domain.recipe.recipe import Recipe
from station.reporting.drawing.figure import Figure, Series, svg
from station.reporting.drawing.tables import bar_chart


def unit_figures(recipe: Recipe, result: CalibrationResult) -> Mapping[str, str]:
    """Pictures of one unit by name, as SVG text; none where it could not be calibrated."""
    found, visits, budget = result.calibration, result.visits, result.budget
    if found is None or visits is None or budget is None:
        return {}
    pictures = {"residual": residual_svg(recipe, found, visits, result.serial)}
    if recipe.pose_known:
        pictures["tilt"] = tilt_svg(recipe, found, result.serial)
    return {**pictures, "budget": budget_svg(recipe, budget, result.serial)}


def residual_svg(recipe: Recipe, found: Calibration, visits: ReducedVisits, serial: str) -> str:
    """Residual of every axis at every visit, with the bars that noise alone gives."""
    x = np.arange(len(visits), dtype=float)
    wide = 1.96 * np.sqrt(np.einsum("vii->vi", visits.cov))
    series = []
    for i, axis in enumerate("xyz"):
        at, y = x + 0.18 * (i - 1), found.residual[:, i]
        low, high = (y - wide[:, i]).tolist(), (y + wide[:, i]).tolist()
        series.append(Series(at.tolist(), y.tolist(), axis, low=low, high=high, colour=i))
    limit = recipe.limits.residual
    levels = () if limit is None else ((limit, "limit"), (-limit, ""))
    title = f"{serial}: residual at each position, bars ± 95 % of noise"
    return svg(Figure(title, "", recipe.unit, tuple(series), _position_names(found), levels))


def tilt_svg(recipe: Recipe, found: Calibration, serial: str) -> str:
    """Tilt of every visit from its nominal pose, ± 1.96 standard deviations."""
    x, y = list(map(float, range(len(found.tilt_deg)))), found.tilt_deg
    wide = 1.96 * found.tilt_std_deg
    one = Series(x, y.tolist(), low=np.maximum(y - wide, 0).tolist(), high=(y + wide).tolist(), colour=1)
    limit = recipe.limits.tilt_deg
    title = f"{serial}: tilt of each position from its nominal pose, ± 95 %"
    return svg(Figure(title, "", "deg", (one,), _position_names(found), () if limit is None else ((limit, "limit"),)))


def budget_svg(recipe: Recipe, budget: Budget, serial: str) -> str:
    """Which cause contributes how much to the least certain offset (or coefficient, where no offset is fitted)."""
    std = budget.std()
    worst = int(np.argmax(np.where(coefficients.OFFSETS, std, -1.0)))
    if not std[worst] > 0:
        worst = int(np.argmax(std))
    unit = coefficients.unit_of(worst, recipe.unit)
    parts = {cause: float(budget.std(cause)[worst]) for cause in budget.parts}
    rows = [(cause, part) for cause, part in parts.items() if part > NEGLIGIBLE * std[worst]]
    rows = [*sorted(rows, key=lambda r: -r[1]), ("together", float(std[worst]))]
    title = f"{serial}: standard uncertainty of {coefficients.NAMES[worst]} by cause"
    return bar_chart(title, rows, "" if unit == "1" else unit)


def _position_names(found: Calibration) -> tuple[str, ...]:
    return tuple(f"{n} (out)" if d else n for n, d in zip(found.positions, found.disturbed, strict=True))
