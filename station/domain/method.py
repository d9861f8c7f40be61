"""What a calibration method is given and gives back. Methods are the files of `station.domain.calibrate`.

Units come first in every array: one unit is a batch of one, and no unit's numbers depend on its neighbours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from station import plugins
from station.domain import rank, sensor
from station.domain.recipe import Recipe
from station.domain.types import Floats, Stops

PACKAGE = "station.domain.calibrate"


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Stops (v) of units (u) that went through the same visits.

    mean, true (u, v, 3) readings and truths in the recipe's unit; cov (u, v, 3, 3), quantisation, dof (u, v, 3) and
    temperature_degC (u, v): see Stops; magnitude (u, v) of the truth; pose (v) number of the pose: same position and
    seating, same pose; pose_std_rad: expected error of a pose about each axis; nuisance (v, q): see Sensor.nuisance;
    model: matrix | offset-gain; pose_known: whether `true` is known.
    """

    mean: Floats
    cov: Floats
    quantisation: Floats
    dof: Floats
    temperature_degC: Floats
    true: Floats
    magnitude: Floats
    pose: NDArray[np.intp]
    pose_std_rad: float
    nuisance: Floats
    model: str
    pose_known: bool

    def visits_of_pose(self) -> NDArray[np.intp]:
        """How many stops share the pose of each stop (v)."""
        return np.bincount(self.pose)[self.pose]

    def without_nuisance(self) -> "Problem":
        """The same, with nothing but the stimulus acting on the sensor."""
        return replace(self, nuisance=np.zeros((len(self.pose), 0)))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What a method found for each unit.

    theta (u, 12); jacobian (u, 12, v, 3): derivative of theta by each reading; free (12) bool: estimated at all;
    residual (u, v, 3) measured − modelled; tilt_rad, tilt_std_rad (u, v): see Calibration; disturbed (u, v) bool;
    chi2, dof (u): squared residuals over what noise and declared pose errors explain, and their degrees of freedom;
    pose_std_rad (u): pose error about each axis as found, 0 where the method cannot tell; notes: sentences a unit.
    """

    theta: Floats
    jacobian: Floats
    free: NDArray[np.bool_]
    residual: Floats
    tilt_rad: Floats
    tilt_std_rad: Floats
    disturbed: NDArray[np.bool_]
    chi2: Floats
    dof: Floats
    pose_std_rad: Floats
    notes: tuple[tuple[str, ...], ...]


class Method(Protocol):
    """A calibration method. open_ended: whether it takes any number of positions."""

    open_ended: ClassVar[bool]

    def check(self, recipe: Recipe) -> None:
        """RecipeError when the recipe's positions are not those the method wants."""

    def design(self, true: Floats, recipe: Recipe, nuisance: Floats) -> tuple[Floats, tuple[str, ...]]:
        """Linearised design of a nominal unit: rows (r, k), and what each of the k columns determines."""

    def fit(self, problem: Problem) -> Fit:
        """Coefficients of every unit."""


def of(recipe: Recipe) -> Method:
    """The method of a recipe."""
    return cast(Method, plugins.load(PACKAGE, recipe.method)())


def problem(recipe: Recipe, units: Sequence[Stops]) -> Problem:
    """The problem of units whose stops are the same, one by one, in position and seating."""
    first = units[0]
    keys = list(zip(first.position, first.seating, strict=True))
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    true = np.stack([s.true for s in units])
    known = recipe.pose_known
    return Problem(
        mean=np.stack([s.mean for s in units]),
        cov=np.stack([s.cov for s in units]),
        quantisation=np.stack([s.quantisation for s in units]),
        dof=np.stack([s.dof for s in units]),
        temperature_degC=np.stack([s.temperature_degC for s in units]),
        true=true,
        magnitude=np.linalg.norm(true, axis=2) if known else np.full(true.shape[:2], recipe.reference.strength()),
        pose=np.array([number[k] for k in keys], np.intp),
        pose_std_rad=float(np.deg2rad(recipe.reference.pose_std_deg)),
        nuisance=nuisance(recipe, first.position, first.seating, first.true),
        model=recipe.model,
        pose_known=known,
    )


def nuisance(recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...], true: Floats) -> Floats:
    """The sensor kind's nuisance regressors (v, q) where the stops tell them from the coefficients; q = 0 otherwise."""
    if not recipe.pose_known:
        return np.zeros((len(position), 0))
    found = sensor.of(recipe).nuisance(recipe, position, seating)
    rows = np.column_stack([np.ones(len(true)), true, found])
    apart = found.shape[1] > 0 and len(rows) >= rows.shape[1] and rank.of(rows) == rows.shape[1]
    return found if apart else np.zeros((len(position), 0))
