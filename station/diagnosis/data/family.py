"""One unit far from the others of its kind: by robust standard deviations of the family."""

from collections.abc import Iterator, Sequence

import numpy as np

from station.domain.core.types import Floats, SampleTable
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.methods.coefficients import NAMES
from station.domain.recipe.recipe import Recipe
from station.messages import Message
from station.model.forward import resting_stimulus
from station.model.scene import visits_scene_of_table

#: Fewer units are no family.
LEAST_UNITS = 12
#: Robust standard deviations FAR + FEW/n² that one of n units of twelve normal coefficients is off by chance in one
#: family of a thousand: 16.9 of 12 units, 8.0 of 32, 6.7 of 100 (simulated: 15.6, 7.6, 5.9).
FAR, FEW = 6.5, 1500.0


class Family:
    """The coefficients of units as they come, few numbers each."""

    def __init__(self) -> None:
        self._serials: list[str] = []
        self._values: list[Floats] = []
        self._std: list[Floats] = []

    def add(self, result: CalibrationResult) -> None:
        """Takes a unit that could be calibrated."""
        if result.calibration is None or result.budget is None:
            return
        found = result.calibration
        self._serials.append(result.serial)
        self._values.append(np.r_[found.offset, found.matrix.ravel()])
        self._std.append(result.budget.std())

    def outlying(self) -> tuple[Message, ...]:
        """A message for each unit far from the others."""
        if len(self._serials) < LEAST_UNITS:
            return ()
        values, std = np.array(self._values), np.array(self._std)
        return tuple(outlying(self._serials, values, std, NAMES))


def of_table(recipe: Recipe, table: SampleTable) -> tuple[Message, ...]:
    """The same from samples, by each unit's own line through its visits; nothing where poses are unknown."""
    if not recipe.pose_known or recipe.reference.source == "gold" or len(np.unique(table.unit.code)) < LEAST_UNITS:
        return ()
    scene = visits_scene_of_table(recipe, table)
    count = np.bincount(scene.visit, minlength=len(scene.visits))
    mean = np.stack([np.bincount(scene.visit, column, len(count)) / count for column in table.reading.T], axis=1)
    design = np.c_[np.ones(len(mean)), resting_stimulus(scene)]
    code = scene.visits.unit.code
    values = []
    for u in np.unique(code):
        own = code == u
        line = np.linalg.lstsq(design[own], mean[own], rcond=1e-6)[0]
        values.append(np.r_[line[0], line[1:].T.ravel()])
    serials = [scene.visits.unit.names[u] for u in np.unique(code)]
    return tuple(outlying(serials, np.array(values), np.zeros((len(values), 12)), NAMES))


def outlying(serials: Sequence[str], values: Floats, std: Floats, names: Sequence[str]) -> Iterator[Message]:
    """Units (u) of whose coefficients (u, k), known to std (u, k), one is far from the others': the farthest of each.

    The family's spread is 1.4826 times the median deviation, and no less than what the coefficients are known to.
    """
    if len(serials) < LEAST_UNITS:
        return
    off = np.abs(values - np.median(values, axis=0))
    spread = np.maximum(1.4826 * np.median(off, axis=0), np.median(std, axis=0))
    distance = np.where(spread > 0, off / np.where(spread > 0, spread, 1.0), 0.0)
    distance = np.where(np.isfinite(distance), distance, 0.0)
    for u in np.flatnonzero(distance.max(axis=1) > FAR + FEW / len(serials) ** 2).tolist():
        k = int(np.argmax(distance[u]))
        yield Message(
            "unit-far-from-family", serial=serials[u], coefficient=names[k], value=float(values[u, k]),
            middle=float(np.median(values[:, k])), sigmas=float(distance[u, k]), units=len(serials),
        )  # fmt: skip
