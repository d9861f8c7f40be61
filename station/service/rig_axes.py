"""The errors of a rig's axes, out of the log: what the units felt where the encoders said that they stood."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from station.domain.core.types import Floats, ReducedVisits
from station.domain.evaluation import reduced_visits_document
from station.domain.recipe.recipe import Recipe
from station.domain.records.stored_attempt import AXIS_ANGLES
from station.domain.rig import axis_errors
from station.domain.rig.axis_errors import AxisErrors, UnitOnAxes
from station.domain.rig.rig_map import RigMap
from station.errors import LogError, PositionerFault
from station.ports.log_reader import LogReader, Query

#: More leaves nothing to the axes: an error of 0.3° leaves less than this of a reading, g.
MOST_LEFT_G = 0.005
#: A larger error is none of an axis but of the map, degrees.
MOST_DEG = 5.0
#: Visits of a unit that leave something to estimate from beside its own twelve coefficients.
_FEWEST_VISITS = 6


@dataclass(frozen=True, slots=True)
class AxisReport:
    """What was found. serials: of the units, in the order of their attempts; since_ns: start of the first of them;
    corrected: the map without what can be taken out of it."""

    rig: RigMap
    serials: tuple[str, ...]
    since_ns: int
    errors: AxisErrors
    corrected: RigMap


def axes_of_log(log: LogReader, query: Query, rig: RigMap, most: int) -> AxisReport:
    """Errors of the axes from the newest attempts of the query, at most so many.

    Errors: LogError where no attempt holds angles of these axes; PositionerFault where readings and map disagree.
    """
    attempts = log.attempts(query, most)
    rows = {row.number: row for row in log.reduced([a.number for a in attempts])}
    recipes: dict[str, Recipe] = {}
    found: list[tuple[int, str, UnitOnAxes]] = []
    for attempt in attempts:
        if attempt.number not in rows or not (text := log.recipe_and_product(attempt)[0]):
            continue
        recipe = recipes.setdefault(attempt.recipe_hash, Recipe.model_validate_json(text))
        if (recipe.sensor, recipe.unit) != ("accelerometer", "g"):
            continue
        visits = reduced_visits_document.from_document(json.loads(rows[attempt.number].stops), recipe)
        unit = _unit(recipe, visits, log.attempt(attempt), len(rig.axes))
        if unit is not None:
            found.append((attempt.started_ns, attempt.serial, unit))
    if not found:
        raise LogError("rig-axes-no-angles", log=log.location)
    errors = axis_errors.estimate_axis_errors(rig, [unit for _, _, unit in found])
    if errors.residual_g > MOST_LEFT_G:
        raise PositionerFault("rig-axes-misfit", residual_g=errors.residual_g, rig=rig.name)
    for error in errors.errors:
        if error.kind != "scale" and abs(error.value or 0.0) > MOST_DEG:
            raise PositionerFault("rig-axes-large", axis=error.axis, value_deg=error.value, rig=rig.name)
    corrected = axis_errors.corrected_by_errors(rig, errors)
    return AxisReport(rig, tuple(serial for _, serial, _ in found), found[-1][0], errors, corrected)


def _unit(recipe: Recipe, visits: ReducedVisits, stored: Mapping[str, Any], axes: int) -> UnitOnAxes | None:
    """A unit where its record says where the axes stood; None where too few of its visits do."""
    angles = {(v["run"], v["visit"]): v["statistics"].get(AXIS_ANGLES, ()) for v in stored["visits"]}
    keys = list(zip(visits.run.tolist(), visits.visit.tolist(), strict=True))
    rows = [i for i, key in enumerate(keys) if len(angles.get(key, ())) == axes]
    if len(rows) < _FEWEST_VISITS:
        return None
    seats: list[Floats] = [recipe.seating(visits.seating[i]) for i in rows]
    return UnitOnAxes(np.array([angles[keys[i]] for i in rows]), visits.mean[rows], np.stack(seats))
