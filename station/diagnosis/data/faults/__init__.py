"""Gross faults, looked for before any statistics: decoding, grid, saturation, counters, clocks and tones."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults import clipping, clock, counters, gold, grid_step, mapping, stuck_bits, tone
from station.diagnosis.data.faults.fault import Fault, Number
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.scene import Scene, stops_of_table

__all__ = ["Fault", "Inspected", "Number", "inspect"]


@dataclass(frozen=True, slots=True, eq=False)
class Inspected:
    """Faults; the table as it would be without them, clipped stops left out; the faults that nothing could show; and
    causes of the bank that were looked for here already."""

    faults: tuple[Fault, ...]
    table: SampleTable
    blind: tuple[str, ...]
    tested: tuple[str, ...] = ()


def inspect(recipe: Recipe, table: SampleTable) -> Inspected:
    """Looks a table over. Its rows come back sorted by unit, run and stop, in the order of arrival."""
    scene = stops_of_table(recipe, table)
    stop = scene.visit
    if np.any(np.diff(stop) < 0):
        order = np.argsort(stop, kind="stable")
        table, stop = table[order], stop[order]
    read = mapping.decoded(scene, _means(table.reading, stop))
    found = mapping.faults(recipe, table, scene, read)
    found = [_measured(f, scene, table, mapping.repaired(table, read), stop) for f in found]
    table = replace(table, reading=mapping.repaired(table, read)) if read else table
    for part in (clipping, grid_step, stuck_bits, counters, clock):
        found += part.faults(recipe, table, stop)
    by_gold = gold.faults(recipe, table, scene, stop)
    found, table = [*found, *by_gold], gold.repaired(recipe, table, by_gold)
    _, bad = clipping.clipped(table, stop)
    hit = np.zeros(len(scene.visits), bool)
    hit[stop[bad]] = True
    whole = ~hit[stop]
    kept = table[whole] if bad.any() else table
    found += tone.faults(recipe, kept, stop[whole])
    return Inspected(tuple(found), kept, _blind(recipe, table, scene), gold.tested(recipe, table))


def _means(reading: Floats, stop: NDArray[np.intp]) -> Floats:
    count = np.bincount(stop)
    return np.stack([np.bincount(stop, column) / count for column in reading.T], 1)


def _measured(fault: Fault, scene: Scene, table: SampleTable, repaired: Floats, stop: NDArray[np.intp]) -> Fault:
    """The fault with the rms of what the ideal simulation leaves, before and after the repair."""
    if not scene.recipe.pose_known:
        return fault
    v = scene.visits
    true = np.einsum("vji,vj->vi", np.einsum("vij,vjk->vik", v.nest_R, v.seat_R), v.stimulus)
    before, after = (_rms(_means(r, stop) - true, v.unit.code) for r in (table.reading, repaired))
    return replace(fault, rms_before=before, rms_after=after)


def _rms(residual: Floats, unit: NDArray[np.int32]) -> float:
    """Rms about each unit's mean."""
    count = np.maximum(np.bincount(unit), 1)
    middle = np.stack([np.bincount(unit, column) / count for column in residual.T], 1)
    return float(np.sqrt(np.mean((residual - middle[unit]) ** 2)))


def _blind(recipe: Recipe, table: SampleTable, scene: Scene) -> tuple[str, ...]:
    """Faults that these data could not show."""
    blind = []
    if "counter" not in table.values:
        blind += ["lost-frames", "duplicated-frames", "reordered-frames"]
    if len(table) < 3 * len(scene.visits):
        blind.append("clock-error")
    if recipe.device.lsb <= 0:
        blind += ["quantization", "stuck-bit"]
    if not {"motor", "started_s"} <= set(table.values) or float(np.ptp(table.values["motor"])) == 0.0:
        blind.append("motor-tone")
    if not recipe.pose_known:
        blind.append("axis-permutation")
    return tuple(blind)
