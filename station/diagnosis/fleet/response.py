"""How a unit's visits differ from the nominal, in units of the natural spread of units; causes as columns of it.

One number a visit and axis, all visits of a unit as one vector y (d). The units' calibrations are not solved for: they
are noise with whatever covariance they have (`noise.py`), which retains more than removing each. A tilted nest is a
rotation by which no device stands out; it shows in the mean of many.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.diagnosis.candidates.bank import cause_library
from station.domain.core.types import Floats, Labels, ReducedVisits, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.effect import Effect
from station.model.forward import BaseResponse, signature
from station.model.scene import Scene, scene_of_table

#: Covariates that reduced visits have.
_RECORDED = {"temperature_degC"}
#: Where a group of units may share a cause.
LEVELS = ("station", "nest", "lot", "position")

VisitOrder = tuple[tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class SharedCause:
    """One cause at one position, or at all of them (""). levels: of groups that may share it; columns (d, a): of what
    every unit feels alike, None where it goes with a covariate; name of its sizes' unit."""

    effect: str
    position: str
    levels: tuple[str, ...]
    axes: int
    unit: str
    columns: Floats | None


def visit_order(visits: ReducedVisits) -> VisitOrder:
    """Positions and seatings in order: units of one order can be compared."""
    return visits.position, visits.seating


def response(visits: ReducedVisits) -> Floats:
    """Measured less nominal (d)."""
    return np.asarray((visits.mean - visits.true).ravel())


def shared_causes(recipe: Recipe, visits: ReducedVisits) -> list[SharedCause]:
    """Causes that groups may share in such visits. visits: of any unit."""
    scene = _scene(recipe, [visits])
    found: list[SharedCause] = []
    for effect in cause_library(recipe):
        levels = _levels(effect)
        if not levels or not set(effect.needs) <= _RECORDED:
            continue
        unit = effect.parameter.unit_in(recipe.unit)
        if effect.needs:
            found.append(SharedCause(effect.id, "", levels, len(effect.columns), unit, None))
            continue
        columns = _columns(scene, effect)[0]
        if levels != ("position",):
            found.append(SharedCause(effect.id, "", levels, columns.shape[1], unit, columns))
            continue
        for name in dict.fromkeys(visits.position):
            here = np.repeat([position == name for position in visits.position], 3)[:, None]
            found.append(SharedCause(effect.id, name, levels, columns.shape[1], unit, columns * here))
    return found


def covariate_columns(recipe: Recipe, causes: Sequence[SharedCause], units: Sequence[ReducedVisits]) -> Floats:
    """Columns (U, d, k) of the causes that go with a covariate, in their order; zero for a unit without it."""
    wanted = [cause.effect for cause in causes if cause.columns is None]
    d = 3 * len(units[0].position)
    known = np.array([bool(np.isfinite(visits.temperature_degC).all()) for visits in units])
    effects = [effect for effect in cause_library(recipe) if effect.id in wanted]
    out = np.zeros((len(units), d, sum(len(effect.columns) for effect in effects)))
    if not wanted or not known.any():
        return out
    scene = _scene(recipe, [visits for visits, there in zip(units, known, strict=True) if there])
    out[known] = np.concatenate([_columns(scene, effect) for effect in effects], axis=2)
    return out


def _levels(effect: Effect) -> tuple[str, ...]:
    """Groups that may share it: those it acts on by itself; a lot may share what a unit can have, a station what the
    rig as a whole can have."""
    found = [level for level in LEVELS if level in effect.of]
    if "unit" in effect.of:
        found.append("lot")
    elif "common" in effect.of:
        found.append("station")
    return tuple(dict.fromkeys(found))


def _columns(scene: Scene, effect: Effect) -> Floats:
    """Derivatives (U, d, a) by each axis' coefficient."""
    units = len(scene.visits.unit.names)
    of = "unit" if "unit" in effect.of else ""
    parts = signature(scene, BaseResponse.ideal(units), effect, of)
    return np.stack(parts, axis=-1).reshape(units, -1, len(parts))


def _scene(recipe: Recipe, units: Sequence[ReducedVisits]) -> Scene:
    """A row a visit."""
    count, v = len(units), len(units[0].position)
    names = tuple(f"{i:08d}" for i in range(count))
    temperature = np.concatenate([visits.temperature_degC for visits in units])
    table = SampleTable(
        unit=Labels(names, np.repeat(np.arange(count, dtype=np.int32), v)),
        run=np.concatenate([visits.run for visits in units]),
        visit=np.concatenate([visits.visit for visits in units]),
        position=Labels.of([name for visits in units for name in visits.position]),
        time_s=np.concatenate([visits.time_s for visits in units]),
        reading=np.zeros((count * v, 3)),
        labels={"seating": Labels.of([name for visits in units for name in visits.seating])},
        values={"temperature_degC": temperature} if np.isfinite(temperature).all() else {},
    )
    return scene_of_table(recipe, table)
