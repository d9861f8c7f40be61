"""The grid of the output: coarser than the data sheet says means lost bits."""

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import (
    FaultParameter,
    GrossFault,
    block_gain,
    halves,
    rows_of_units,
    unit_label,
)
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.domain.recognition.distinct_values import distinct

#: A grid so many times as coarse as promised is a fault; powers of two are the usual case.
COARSE_FACTOR = 1.5
#: Levels that the faces of a cube make, six of them unlike.
FEW_LEVELS = 6
#: Share of a step by which a value may lie beside the grid: text of six digits does.
OFF_GRID_SHARE = 0.02
#: Values that differ by less than this share of their size are one, written twice.
SAME = 1e-9


def step_of(values: Floats) -> float:
    """The step of the grid that values (n) lie on; 0 where they lie on none."""
    levels = distinct(values)
    if len(levels) < 3:
        return 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > SAME * max(float(np.abs(levels).max()), 1e-30)]
    if not len(gaps):
        return 0.0
    step = float(gaps.min())
    # Averaging the gaps of one step takes the rounding of text off.
    step = float(np.mean(gaps[gaps < 1.5 * step]))
    whole = np.round(gaps / step)
    small = whole < 0.2 / OFF_GRID_SHARE
    on = np.abs(gaps - whole * step)[small] < OFF_GRID_SHARE * step * np.maximum(whole[small], 1)
    return step if len(on) and float(np.mean(on)) > 0.95 and len(levels) < 0.7 * len(values) else 0.0


def _is_fine(reading: Floats, promised: float) -> bool:
    """Whether neighbours among some readings (n, 3) lie no further apart than a promised step, on any axis: whatever
    grid the readings lie on is then no coarser."""
    if not len(reading):
        return True
    apart, size = np.abs(np.diff(reading, axis=0)), np.abs(reading).max(axis=0)
    near = apart < (1 + 1e-6) * promised
    return bool(np.any(near & (apart > SAME * np.maximum(size, 1e-30))))


def _axes_with_steps(reading: Floats, visit: NDArray[np.intp]) -> list[int]:
    """The axes that show the steps of their output: they step within a dwell, or have more levels than a few faces make
    of a part without noise. Minus, none and plus one g lie at equal distances on any grid."""
    steps = np.diff(reading, axis=0)[np.diff(visit) == 0] != 0
    return [i for i in range(3) if steps[:, i].any() or len(distinct(reading[:, i])) > FEW_LEVELS]


def steps_of_units(table: SampleTable, promised: float, found: list[GrossFault]) -> Floats:
    """The step of each unit's output (U): as promised, or as coarse as was found."""
    coarse = {n.of: float(n.value) for f in found if f.effect == "quantization" for n in f.numbers}
    return np.array([coarse.get(unit_label(table.unit, u), promised) for u in range(len(table.unit.names))])


def faults(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp]) -> list[GrossFault]:
    """Units whose output comes in coarser steps than promised."""
    promised = recipe.device.lsb
    if promised <= 0:
        return []
    found = {}
    for u, of in enumerate(rows_of_units(table.unit)):
        rows = table.reading[of]
        if _is_fine(rows, promised):
            continue
        shown = _axes_with_steps(rows, visit[of]) if len(rows) else []
        steps = [step_of(rows[:, i]) for i in shown]
        if min(steps, default=0.0) > COARSE_FACTOR * promised:
            found[u] = float(np.median(steps)), len(rows)
    if not found or (len(found) == len(table.unit.names) and not states_step(recipe)):
        return []
    numbers = tuple(
        FaultParameter("lsb", None, unit_label(table.unit, u), step, step * 1e-3, recipe.unit)
        for u, (step, _) in found.items()
    )
    sentence = f"the output comes in steps of {next(iter(found.values()))[0]:.3g} {recipe.unit}, not {promised:.3g}"
    nats = sum(3 * rows * np.log(step / promised) for step, rows in found.values())
    parts = [
        _held_out_scores(table.reading[of], visit[of], promised)
        for u, of in enumerate(rows_of_units(table.unit))
        if u in found
    ]
    gain = block_gain(np.concatenate([s for s, _ in parts]), np.concatenate([n for _, n in parts]), "sample")
    return [GrossFault("quantization", "unit", numbers, sentence, float(nats), gain=gain)]


def states_step(recipe: Recipe) -> bool:
    """Whether the recipe states a step that a grid can be too coarse for. One taken from the readings tells only units
    apart: what all of them show is theirs, finer as it may look where an offset moves the grid from pose to pose."""
    return "device" not in recipe.model_fields_set or "lsb" in recipe.device.model_fields_set


def _held_out_scores(reading: Floats, visit: NDArray[np.intp], promised: float) -> tuple[Floats, Floats]:
    """Of each visit of a unit (s): by how much likelier its readings are on the grid of the other half of the visits
    than anywhere on the promised one, summed over its samples; and how many these are.

    With the coarse grid of step q a reading stands on it but for a share ε, and a point of it is q/promised times as
    likely; ε is by the rule of succession among the readings that the grid was found in.
    """
    half, where = halves(visit), visit - visit[0]
    score = np.zeros(len(reading))
    for part, values in ((part, values) for part in (0, 1) for values in reading.T):
        fitted, judged = values[half != part], half == part
        q = step_of(fitted)
        if q <= promised:
            continue
        phase = float(np.angle(np.mean(np.exp(2j * np.pi * fitted / q)))) / (2 * np.pi)
        off = np.abs((values[judged] / q - phase + 0.5) % 1 - 0.5) > max(OFF_GRID_SHARE, promised / q)
        stray = 1 / (len(fitted) + 2)
        score[judged] += np.where(off, np.log(stray), np.log(1 - stray) + np.log(q / promised))
    return np.bincount(where, score).astype(float), np.bincount(where).astype(float)
