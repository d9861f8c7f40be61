"""Gross faults, looked for before any statistics: decoding, grid, saturation, counters, clocks and tones."""

from collections.abc import Container
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults import (
    axis_decoding,
    clipping,
    clock,
    counters,
    gold_course,
    gold_reference,
    grid_step,
    motor_tone,
    stuck_bits,
)
from station.diagnosis.data.faults.bit_shifts import dwells_of_unit, restored
from station.diagnosis.data.faults.gross_fault import FaultParameter, GrossFault, rows_of_units
from station.diagnosis.data.faults.rounding import with_honest_rounding
from station.diagnosis.data.sample_source import SampleSource
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.forward import resting_stimulus
from station.model.scene import Scene, visits_scene_of_table
from station.model.timeline import noise_density_of

__all__ = ["FaultParameter", "GrossFault", "Inspection", "inspect", "undetectable_faults"]


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """Faults; the samples as they would be without them, clipped visits left out; the faults that nothing could show;
    causes of the bank that were looked for here already; as_measured: whether readings and visits are as they came."""

    faults: tuple[GrossFault, ...]
    samples: SampleSource
    undetectable: tuple[str, ...]
    tested: tuple[str, ...] = ()
    as_measured: bool = False

    @property
    def table(self) -> SampleTable:
        """All samples at once."""
        return self.samples.table


def inspect(recipe: Recipe, table: SampleTable) -> Inspection:
    """Looks a table over. Its rows come back sorted by unit, run and visit, in the order of arrival."""
    scene = visits_scene_of_table(recipe, table)
    visit = scene.visit
    if np.any(np.diff(visit) < 0):
        order = np.argsort(visit, kind="stable")
        table, visit = table[order], visit[order]
    stuck, table = _stuck_bits(recipe, table, scene, visit)
    mean = _means(table.reading, visit)
    cut_off = clipping.clipped(table, visit)
    read = axis_decoding.wrong_decodings(scene, mean, cut_off[0])
    found = axis_decoding.faults(table, scene, read, mean)
    if any(f.rejected for f in found):
        # What no held-out visit confirms is no way to decode the table.
        found, read = [], {}
    if read:
        table = replace(table, reading=axis_decoding.corrected_readings(table, read))
        cut_off = clipping.clipped(table, visit)
    found += clipping.faults(recipe, table, visit, cut_off)
    for part in (grid_step, counters, clock):
        found += part.faults(recipe, table, visit)
    found += stuck
    moved = gold_reference.course(recipe, table, scene, visit)
    if moved is not None:
        found.append(gold_course.fault(moved, recipe))
        table = gold_course.without(recipe, table, visit, moved)
    by_gold = gold_reference.faults(recipe, table, scene, visit)
    found, table = [*found, *by_gold], gold_reference.without_gold_drift(recipe, table, by_gold)
    _, bad = cut_off
    hit = np.zeros(len(scene.visits), bool)
    hit[visit[bad]] = True
    whole = ~hit[visit]
    # A unit may have no visit left.
    usable = table[whole].used() if bad.any() else table
    found += motor_tone.faults(recipe, usable, visit[whole])
    found = [f for f in found if not f.rejected]
    if any(f.effect == "duplicated-frames" for f in found):
        whole[whole] = ~counters.repeats(recipe, usable, visit[whole])
        usable = table[whole].used()
    usable = _honestly_rounded(recipe, usable, visit[whole], found)
    driven = "motor" in table.values and float(np.ptp(table.values["motor"])) > 0.0
    hidden = undetectable_faults(recipe, table.values, len(table), len(scene.visits), driven=driven)
    return Inspection(tuple(found), SampleSource.of(usable), hidden, gold_reference.testable_causes(recipe, table))


def _stuck_bits(
    recipe: Recipe, table: SampleTable, scene: Scene, visit: NDArray[np.intp]
) -> tuple[list[GrossFault], SampleTable]:
    """Stuck bits, and the table as it would be without them."""
    lsb, true = recipe.device.lsb, resting_stimulus(scene)
    if lsb <= 0:
        return [], table
    dwells_of = partial(dwells_of_unit, table, visit, true) if recipe.pose_known else None
    bits = stuck_bits.stuck_bits(table, lsb, dwells_of)
    found = stuck_bits.faults(recipe, table, visit, bits)
    if dwells_of is None or not found or found[0].rejected:
        return found, table
    reading, units = table.reading.copy(), rows_of_units(table.unit)
    for u, stuck in bits.items():
        reading[units[u]] = restored(dwells_of(u), stuck, lsb)
    return found, replace(table, reading=reading)


def _honestly_rounded(
    recipe: Recipe, table: SampleTable, visit: NDArray[np.intp], found: list[GrossFault]
) -> SampleTable:
    """The samples with what rounding leaves of their means as noise."""
    noise = noise_density_of(recipe) * float(np.sqrt(recipe.device.rate_hz / 2))
    steps = grid_step.steps_of_units(table, recipe.device.lsb, found)
    return with_honest_rounding(table, np.unique(visit, return_inverse=True)[1], steps, noise)


def _means(reading: Floats, visit: NDArray[np.intp]) -> Floats:
    count = np.bincount(visit)
    return np.stack([np.bincount(visit, column) / count for column in reading.T], 1)


def undetectable_faults(
    recipe: Recipe, columns: Container[str], samples: int, visits: int, *, driven: bool
) -> tuple[str, ...]:
    """Faults that so many samples of so many visits could not show; columns: what was recorded; driven: whether the
    motors' drive was ever another one."""
    blind = []
    if "counter" not in columns:
        blind += ["lost-frames", "duplicated-frames", "reordered-frames"]
    if samples < 3 * visits or not clock.states_rate(recipe):
        blind.append("clock-error")
    if recipe.device.lsb <= 0:
        blind += ["quantization", "stuck-bit"]
    if not driven or "started_s" not in columns:
        blind.append("motor-tone")
    if not recipe.pose_known:
        blind.append("axis-permutation")
    return tuple(blind)
