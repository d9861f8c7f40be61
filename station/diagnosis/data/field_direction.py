"""Whether a magnetic field points where the recipe says: what all units show in all positions tells where."""

from collections.abc import Iterator

import numpy as np

from station.domain.core.types import Array, Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: Degrees that a field points elsewhere: no base leans as much.
LEAST_DEG = 3.0
#: What the field as found leaves of what the stated one leaves, at most.
MOST_LEFT = 0.5


def field_remarks(recipe: Recipe, table: SampleTable, begin: Array, mean: Floats, unit: Array) -> Iterator[Message]:
    """A remark where the means (v, 3) of visits that begin at rows (v), of units (v), show another direction of the
    field, in the station's frame and beside an offset of each unit: mean = Rᵀ·field + offset, by least squares."""
    stated = recipe.reference.vector
    if not recipe.pose_known or recipe.reference.source != "field" or stated is None:
        return
    turn = _turns(recipe, table, begin)
    own = np.kron(np.equal.outer(unit, np.unique(unit)).astype(float), np.eye(3))
    design = np.c_[turn.reshape(-1, 3), own]
    if np.linalg.matrix_rank(design, 1e-6) < design.shape[1]:
        return
    field = np.linalg.lstsq(design, mean.ravel(), rcond=None)[0][:3]
    was = np.array(stated, float)
    length = float(np.linalg.norm(field) * np.linalg.norm(was))
    degrees = float(np.degrees(np.arccos(np.clip(field @ was / length, -1, 1)))) if length > 0 else 0.0
    left = [_left(mean - turn @ one, unit) for one in (field, was)]
    if degrees > LEAST_DEG and left[0] < MOST_LEFT * left[1]:
        here, there = (tuple(f"{x:.3g}" for x in v) for v in (field, was))
        yield Message("field-points-elsewhere", field=here, stated=there, unit=recipe.unit, degrees=degrees)


def _turns(recipe: Recipe, table: SampleTable, begin: Array) -> Floats:
    """From the station's frame to the device's (v, 3, 3)."""
    rows = np.asarray(begin, np.intp)
    seated = table.labels.get("seating")
    places = [recipe.position(table.position.names[c]).matrix() for c in table.position.code[rows]]
    if seated is None:
        return np.array([p.T for p in places])
    seats = [recipe.seating(seated.names[c]) for c in seated.code[rows]]
    return np.array([(p @ s).T for p, s in zip(places, seats, strict=True)])


def _left(rest: Floats, unit: Array) -> float:
    """Root mean square of what is left (v, 3) about each unit's own mean."""
    within = rest - np.array([rest[unit == u].mean(axis=0) for u in unit])
    return float(np.sqrt(np.mean(within**2)))
