"""The grid of the output: coarser than the data sheet says means lost bits."""

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import FaultParameter, GrossFault, rows_of_units, unit_label
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe

#: A grid so many times as coarse as promised is a fault; powers of two are the usual case.
COARSE_FACTOR = 1.5
#: Share of a step by which a value may lie beside the grid: text of six digits does.
OFF_GRID_SHARE = 0.02


def step_of(values: Floats) -> float:
    """The step of the grid that values (n) lie on; 0 where they lie on none."""
    levels = np.unique(values)
    if len(levels) < 3:
        return 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * max(float(np.abs(levels).max()), 1e-30)]
    if not len(gaps):
        return 0.0
    step = float(gaps.min())
    # Averaging the gaps of one step takes the rounding of text off.
    step = float(np.mean(gaps[gaps < 1.5 * step]))
    whole = np.round(gaps / step)
    small = whole < 0.2 / OFF_GRID_SHARE
    on = np.abs(gaps - whole * step)[small] < OFF_GRID_SHARE * step * np.maximum(whole[small], 1)
    return step if len(on) and float(np.mean(on)) > 0.95 and len(levels) < 0.7 * len(values) else 0.0


def faults(recipe: Recipe, table: SampleTable, stop: NDArray[np.intp]) -> list[GrossFault]:
    """Units whose output comes in coarser steps than promised."""
    del stop
    promised = recipe.device.lsb
    if promised <= 0:
        return []
    found = {}
    for u, of in enumerate(rows_of_units(table.unit)):
        rows = table.reading[of]
        steps = [step_of(rows[:, i]) for i in range(3)] if len(rows) else [0.0]
        if min(steps) > COARSE_FACTOR * promised:
            found[u] = float(np.median(steps)), len(rows)
    if not found:
        return []
    numbers = tuple(
        FaultParameter("lsb", None, unit_label(table.unit, u), step, step * 1e-3, recipe.unit)
        for u, (step, _) in found.items()
    )
    told = f"the output comes in steps of {next(iter(found.values()))[0]:.3g} {recipe.unit}, not {promised:.3g}"
    nats = sum(3 * rows * np.log(step / promised) for step, rows in found.values())
    return [GrossFault("quantization", "unit", numbers, told, float(nats))]
