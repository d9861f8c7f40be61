"""Whether the readings contradict the seating that is stated: a unit that sat turned in one run, or a wrong column."""

import numpy as np

from station.diagnosis.data.faults.axis_decoding import mapping_by_pose
from station.diagnosis.data.visit_places import seating_of_visits
from station.domain.core import rotation
from station.domain.core.types import Floats, SampleTable
from station.domain.evaluation.unit_dwells import visit_boundaries
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError
from station.model.effects.axis_permutation import MATRICES


def check_seatings(recipe: Recipe, table: SampleTable) -> None:
    """Of a table in order. Errors: SamplesError where a unit reads as stated in one run and turned in another: axes
    that are decoded wrongly are so in all runs. A calibration does not ask: who was not turned fails, others go on."""
    if not recipe.pose_known or recipe.reference.source == "rate":
        return
    begin, end = visit_boundaries(table)
    mean = np.add.reduceat(table.reading, begin, axis=0) / (end - begin)[:, None]
    run, unit, position = table.run[begin], table.unit.code[begin], table.position.code[begin]
    seating = seating_of_visits(recipe, table, begin)
    if not np.any(np.diff(run)) or seating is None:
        return
    places, of = np.unique(np.stack([position, seating.code]), axis=1, return_inverse=True)
    true = np.stack(
        [recipe.true_vector(recipe.position(table.position.names[p]), seating.names[s]) for p, s in places.T]
    )[of.ravel()]
    for u in np.unique(unit):
        passes = {int(r): (unit == u) & (run == r) for r in np.unique(run[unit == u])}
        found = {r: mapping_by_pose(true[rows], mean[rows]) for r, rows in passes.items()}
        turned = [r for r, m in found.items() if m and np.linalg.det(MATRICES[m]) > 0]
        if turned and 0 in found.values():
            first = turned[0]
            stated_name = seating.names[seating.code[passes[first]][0]]
            raise _contradiction(recipe, table.unit.names[u], first, stated_name, MATRICES[found[first] or 0])


def _contradiction(recipe: Recipe, serial: str, run: int, stated: str, read: Floats) -> SamplesError:
    """What is stated and what the readings (3, 3) by it show: they are those of the seating turned by their inverse."""
    turn = rotation.to_vector(read.T)
    angle = float(np.linalg.norm(turn))
    shown = recipe.seating(stated) @ read.T
    names = [n for n in ("home", *recipe.seatings) if np.allclose(recipe.seating(n), shown, atol=1e-6)]
    axis = _axis_text(turn / angle)
    if names:
        return SamplesError(
            "seating-of-another", serial=serial, run=run, stated=stated, other=names[0], degrees=np.degrees(angle),
            axis=axis,
        )  # fmt: skip
    return SamplesError(
        "seating-contradicted", serial=serial, run=run, stated=stated, degrees=np.degrees(angle), axis=axis
    )


def _axis_text(axis: Floats) -> str:
    """An axis along one, two or three of the unit's: z, -z, x+y; of half a turn either sign is the same."""
    text = "".join(("-" if value < 0 else "+") + "xyz"[i] for i, value in enumerate(axis) if abs(value) > 0.1)
    return text.removeprefix("+")
