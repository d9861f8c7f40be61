"""Axes swapped or with the wrong sign, and readings a whole factor off: by the nearest of 48 signed permutations."""

from dataclasses import dataclass

import numpy as np

from station.diagnosis.data.faults.gross_fault import FaultParameter, GrossFault, rows_of_units, unit_label
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.effects.axis_permutation import MAPPINGS, MATRICES
from station.model.scene import Scene

#: Factors of ranges and units; the last two are degrees and revolutions.
FACTORS = (0.001, 1 / 9.80665, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 9.80665, 16.0, 1000.0, 9806.65, 180 / np.pi)
#: A good unit's gain is within this factor of 1; a factor is taken for one of the list within the same.
GAIN_FACTOR = 1.15
#: Likeness (cosine) of the fitted matrix to the best mapping, and how much better than to the right one.
MIN_COSINE, MIN_COSINE_LEAD = 0.9, 0.15


@dataclass(frozen=True, slots=True)
class AxisDecoding:
    """How a unit is decoded: number of its mapping, and the factor of its readings."""

    mapping: int
    factor: float
    measured: float


def wrong_decodings(scene: Scene, mean: Floats) -> dict[int, AxisDecoding]:
    """What stands on the axes of each unit that is decoded wrongly; mean (v, 3) of the stops."""
    found = {}
    for u, rows in enumerate(rows_of_units(scene.visits.unit)):
        read = _by_pose(scene, mean, rows) if scene.recipe.pose_known else _by_magnitude(scene, mean[rows])
        if read is not None and (read.mapping or read.factor != 1.0):
            found[u] = read
    return found


def _by_pose(scene: Scene, mean: Floats, rows: slice) -> AxisDecoding | None:
    """From the matrix between nominal vectors and readings."""
    visits = scene.visits
    R = np.einsum("vij,vjk->vik", visits.nest_R[rows], visits.seat_R[rows])
    true = np.einsum("vji,vj->vi", R, visits.stimulus[rows])
    A = np.concatenate([true, np.ones((len(true), 1))], axis=1)
    if np.linalg.matrix_rank(A, 1e-6 * max(float(np.abs(true).max()), 1e-30)) < 4:
        return None
    matrix = np.linalg.lstsq(A, mean[rows], rcond=None)[0][:3].T
    size = float(np.linalg.norm(matrix))
    if size == 0.0:
        return None
    like = np.einsum("kij,ij->k", MATRICES, matrix) / (size * np.sqrt(3))
    best = int(np.argmax(like))
    if like[best] < MIN_COSINE:
        return None
    best = best if like[best] > like[0] + MIN_COSINE_LEAD else 0
    measured = float(np.median(np.einsum("ij,ij->i", MATRICES[best], matrix)))
    return AxisDecoding(best, _factor(measured), measured)


def _by_magnitude(scene: Scene, mean: Floats) -> AxisDecoding | None:
    """From the length of the readings alone, where a whole factor is plain."""
    true = float(np.linalg.norm(scene.visits.stimulus[0]))
    measured = float(np.median(np.linalg.norm(mean, axis=1))) / true
    factor = _factor(measured)
    return AxisDecoding(0, factor, measured) if factor in FACTORS else None


def _factor(measured: float) -> float:
    """1 for a good gain, a listed factor nearby, or the measured one."""
    if 1 / GAIN_FACTOR <= measured <= GAIN_FACTOR:
        return 1.0
    near = min(FACTORS, key=lambda f: abs(np.log(max(measured, 1e-12) / f)))
    return near if max(measured / near, near / max(measured, 1e-12)) < GAIN_FACTOR else measured


def faults(recipe: Recipe, table: SampleTable, scene: Scene, found: dict[int, AxisDecoding]) -> list[GrossFault]:
    """The faults of the units that are decoded wrongly."""
    turned = {u: r for u, r in found.items() if r.mapping}
    scaled = {u: r for u, r in found.items() if r.factor != 1.0}
    out = []
    size = recipe.reference.strength()
    if turned:
        numbers = tuple(
            FaultParameter("mapping", None, unit_label(table.unit, u), MAPPINGS[r.mapping], None, "")
            for u, r in turned.items()
        )
        u, r = next(iter(turned.items()))
        told = f"{MAPPINGS[r.mapping]} stands on x, y, z of {unit_label(table.unit, u)}"
        alike = _indistinguishable(scene, turned, len(table.unit.names))
        out.append(GrossFault("axis-permutation", "unit", numbers, told, 1000.0 * len(turned), alike, size, 0.0))
    if scaled:
        numbers = tuple(
            FaultParameter("factor", None, unit_label(table.unit, u), r.factor, 0.01 * r.factor, "1")
            for u, r in scaled.items()
        )
        u, r = next(iter(scaled.items()))
        told = f"{unit_label(table.unit, u)} reads {r.measured:.4g} times too much"
        off = float(np.mean([abs(r.measured - 1) for r in scaled.values()])) * size
        out.append(GrossFault("wrong-scale", "unit", numbers, told, 1000.0 * len(scaled), (), off, 0.0))
    return out


def _indistinguishable(scene: Scene, turned: dict[int, AxisDecoding], units: int) -> tuple[str, ...]:
    """A proper rotation may be the mounting as well as the decoding; a mirror image can only be the decoding."""
    if any(np.linalg.det(MATRICES[r.mapping]) < 0 for r in turned.values()):
        return ()
    same = len(turned) == units and len({r.mapping for r in turned.values()}) == 1
    reseated = len(np.unique(np.round(scene.visits.seat_R, 6).reshape(len(scene.visits), -1), axis=0)) > 1
    return ("package-rotation", "nest-tilt") if same and not reseated else ("package-rotation",)


def corrected_readings(table: SampleTable, found: dict[int, AxisDecoding]) -> Floats:
    """Readings (n, 3) as they would have been decoded rightly."""
    reading = table.reading.copy()
    units = rows_of_units(table.unit)
    for u, r in found.items():
        rows = units[u]
        reading[rows] = reading[rows] @ MATRICES[r.mapping] / r.factor
    return reading
