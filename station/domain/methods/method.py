"""What a calibration method is given and gives back. Methods are the files of `station.domain.methods.calibrate`.

Units come first in every array: one unit is a batch of one, and no unit's numbers depend on its neighbours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from station import plugins
from station.domain.core.types import Array, Floats, ReducedVisits
from station.domain.methods import rank
from station.domain.recipe import assumptions, readings, references, sensor
from station.domain.recipe.recipe import Recipe
from station.messages import Message

PACKAGE = "station.domain.methods.calibrate"
#: Which units.
Rows = NDArray[np.intp] | slice


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """Visits (v) of units (u) that went through the same visits.

    mean, true (u, v, 3) readings and truths in the recipe's unit; cov (u, v, 3, 3), quantisation, rounding, dof (u,
    v, 3) and temperature_degC (u, v): see ReducedVisits; magnitude (u, v) of the truth; pose (v) number of the pose:
    same position and seating, same pose; pose_std_rad: expected error of a pose about each axis; scatter_pose,
    scatter_visit (u): further variance of a reading, common to the visits of a pose or each visit's own; patterns (k,
    v, 3): stated errors of the truth that all visits share, and of coefficients that the method takes for granted,
    one standard deviation each; nuisance (v, q): see Sensor.nuisance; model: matrix | offset-gain; pose_known:
    whether `true` is known; axes: how many readings there are; turned (3, v, 3): see references.turned, of a kind
    whose readings are no components.
    """

    mean: Floats
    cov: Floats
    quantisation: Floats
    rounding: Floats
    dof: Floats
    temperature_degC: Floats
    true: Floats
    magnitude: Floats
    pose: NDArray[np.intp]
    pose_std_rad: float
    scatter_pose: Floats
    scatter_visit: Floats
    patterns: Floats
    nuisance: Floats
    model: str
    pose_known: bool
    axes: int = 3
    turned: Floats | None = None

    def visits_of_pose(self) -> NDArray[np.intp]:
        """How many visits share the pose of each visit (v)."""
        return np.bincount(self.pose)[self.pose]

    def turns(self) -> Floats:
        """What turning a pose by one radian about each axis of the device does to the truth: (u or 1, 3, v, 3)."""
        if self.turned is not None:
            return self.turned[None]
        return np.asarray(np.cross(np.eye(3)[None, :, None], self.true[:, None]))

    def scatter(self) -> Floats:
        """Variance (u, v) that weights are to know of beside noise, as `visits_of_pose` visits share a pose's."""
        return self.scatter_visit[:, None] + self.scatter_pose[:, None] * self.visits_of_pose()

    def take(self, rows: Rows) -> "FitProblem":
        """The same for some of the units."""
        by_unit = ("mean", "cov", "quantisation", "rounding", "dof", "temperature_degC", "true", "magnitude")
        more = ("scatter_pose", "scatter_visit")
        out: dict[str, Any] = {name: _of_rows(getattr(self, name), rows) for name in (*by_unit, *more)}
        return replace(self, **out)

    def without_nuisance(self) -> "FitProblem":
        """The same, with nothing but the stimulus acting on the sensor."""
        return replace(self, nuisance=np.zeros((len(self.pose), 0)))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What a method found for each unit.

    theta (u, 12); jacobian (u, 12, v, 3): derivative of theta by each reading; free (12) bool: estimated at all;
    residual (u, v, 3) measured − modelled; tilt: angles and standard deviations (u, v) in rad where the method finds
    them (else `methods.tilt`); disturbed (u, v) bool; misfit (u, v, a): what the method made small, with the
    variances (u, v, a) that noise and declared pose errors give it; parameters: how many it fitted to that; explained
    (k, v, a): orthonormal patterns of misfit that errors shared by all visits make; consistent (u): known to have
    neither scatter nor a visit that does not fit; pose_std_rad, pose_dof (u): pose error about each axis as found and
    its degrees of freedom, 0 where the method cannot tell; notes: messages a unit.
    """

    theta: Floats
    jacobian: Floats
    free: NDArray[np.bool_]
    residual: Floats
    tilt: tuple[Floats, Floats] | None
    disturbed: NDArray[np.bool_]
    misfit: Floats
    noise: Floats
    pose_variance: Floats
    parameters: int
    explained: Floats
    consistent: NDArray[np.bool_]
    pose_std_rad: Floats
    pose_dof: Floats
    notes: tuple[tuple[Message, ...], ...]

    def take(self, rows: NDArray[np.intp]) -> "Fit":
        """The same for some of the units."""
        out: dict[str, Any] = {}
        for f in fields(Fit):
            mine = getattr(self, f.name)
            if f.name == "notes":
                out[f.name] = tuple([mine[i] for i in rows.tolist()])
            elif f.name == "tilt" and mine is not None:
                out[f.name] = tuple(m[rows] for m in mine)
            elif f.name == "misfit" and mine is self.residual:
                out[f.name] = out["residual"]
            elif f.name not in ("free", "parameters", "explained", "tilt"):
                out[f.name] = _of_rows(mine, rows)
        return replace(self, **out)

    def with_units(self, rows: NDArray[np.intp], other: "Fit") -> "Fit":
        """The same with the units `rows` replaced by those of another fit."""
        out: dict[str, Any] = {}
        for f in fields(Fit):
            mine, theirs = getattr(self, f.name), getattr(other, f.name)
            if f.name == "notes":
                out[f.name] = tuple((dict(enumerate(mine)) | dict(zip(rows.tolist(), theirs, strict=True))).values())
            elif f.name == "tilt" and mine is not None:
                out[f.name] = tuple(_with_rows(m, rows, t) for m, t in zip(mine, theirs, strict=True))
            elif f.name not in ("free", "parameters", "explained", "tilt"):
                out[f.name] = _with_rows(mine, rows, theirs)
        return replace(self, **out)


def _of_rows(mine: Array, rows: Rows) -> Array:
    """Some rows; one value that stands for many along an axis still does, without a copy for each."""
    if isinstance(rows, slice):
        return mine[rows]
    once = mine[tuple(slice(None) if step else slice(1) for step in mine.strides)]
    return np.broadcast_to(once[rows] if mine.strides[0] else once, (len(rows), *mine.shape[1:]))


def _with_rows(mine: Array, rows: NDArray[np.intp], theirs: Array) -> Array:
    out = mine.copy()
    out[rows] = theirs
    return out


class Method(Protocol):
    """A calibration method. open_ended: whether it takes any number of positions; by_magnitude: whether it fits the
    magnitudes of the readings, one number a visit, and not the three readings themselves."""

    open_ended: ClassVar[bool]
    by_magnitude: ClassVar[bool]

    def check(self, recipe: Recipe) -> None:
        """RecipeError when the recipe's positions are not those the method wants."""

    def design(self, true: Floats, recipe: Recipe, nuisance: Floats) -> tuple[Floats, tuple[str, ...]]:
        """Linearised design of a nominal unit: rows (r, k), and what each of the k columns determines."""

    def together(self, problem: FitProblem) -> Fit | None:
        """Coefficients by what units have in common, right for the fit's consistent ones; None where for none."""

    def fit(self, problem: FitProblem) -> Fit:
        """Coefficients of every unit, each by itself; visits that do not fit with the rest left out and marked."""


def same_at_all_visits(of_visits: Floats) -> NDArray[np.bool_]:
    """Whether all visits of a unit have the same values: (u) of values (u, v, …)."""
    flat = of_visits.reshape(len(of_visits), -1)
    each = flat.shape[1] // of_visits.shape[1]
    # Each with its neighbour: comparing all with the first would read in steps of one visit.
    return np.asarray((flat[:, each:] == flat[:, :-each]).all(axis=1))


def of(recipe: Recipe) -> Method:
    """The method of a recipe."""
    return cast(Method, plugins.load(PACKAGE, recipe.method)())


def fit_problem(recipe: Recipe, units: Sequence[ReducedVisits]) -> FitProblem:
    """The problem of units whose visits are the same, one by one, in position, seating and truth."""
    first = units[0]
    keys = list(zip(first.position, first.seating, strict=True))
    # Of hand-held visits nobody knows which were alike.
    known = recipe.pose_known
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    true = np.broadcast_to(first.true, (len(units), *first.true.shape))
    return FitProblem(
        mean=np.stack([s.mean for s in units]),
        cov=np.stack([s.cov for s in units]),
        quantisation=np.stack([s.quantisation for s in units]),
        rounding=np.stack([s.quantisation if s.rounding is None else s.rounding for s in units]),
        dof=np.stack([s.dof for s in units]),
        temperature_degC=np.stack([s.temperature_degC for s in units]),
        true=true,
        magnitude=_magnitude(recipe, true),
        pose=np.array([number[k] for k in keys], np.intp) if known else np.arange(len(keys)),
        scatter_pose=np.zeros(len(units)),
        scatter_visit=np.zeros(len(units)),
        pose_std_rad=float(np.deg2rad(recipe.reference.pose_std_deg or 0.0)),
        patterns=np.concatenate([_stated_patterns(recipe, first), _method_patterns(recipe, first)]),
        nuisance=nuisance(recipe, first.position, first.seating, first.true),
        model=recipe.model,
        pose_known=known,
        axes=recipe.axes,
        turned=references.turned(recipe, first.position, first.seating) if known else None,
    )


def _magnitude(recipe: Recipe, true: Floats) -> Floats:
    """Magnitude (u, v) of the truth; of a kind that converts how far its readings move in a turn of one radian."""
    kind = readings.converting_kind(recipe.sensor)
    if kind is not None:
        return np.full(true.shape[:2], kind.unit_per_rad)
    return np.linalg.norm(true, axis=2) if recipe.pose_known else np.full(true.shape[:2], recipe.reference.strength())


def _stated_patterns(recipe: Recipe, visits: ReducedVisits) -> Floats:
    """Turns of nest, base and field as stated: residuals that they explain are no scatter."""
    r = recipe.reference
    degrees = {"nest": r.nest_std_deg or 0.0, "base": r.base_std_deg or 0.0, "field": r.field_std_deg or 0.0}
    if not recipe.pose_known or r.source == "gold":
        return np.zeros((0, len(visits), 3))
    found = references.direction_errors(recipe, visits.position, visits.seating, visits.true, degrees)
    return np.concatenate([np.zeros((0, len(visits), 3)), *found.values(), *_stated_pull(recipe, visits)])


def _stated_pull(recipe: Recipe, visits: ReducedVisits) -> list[Floats]:
    """The g-sensitivity of a gyroscope as stated, where the fit does not take it out."""
    if not recipe.device.g_sensitivity or nuisance(recipe, visits.position, visits.seating, visits.true).shape[1]:
        return []
    found = references.truth_errors(recipe, visits.position, visits.seating, visits.true)
    return [found["g-sensitivity"]] if "g-sensitivity" in found else []


def _method_patterns(recipe: Recipe, visits: ReducedVisits) -> Floats:
    """Cross-axis gains and gains, one a pattern, as far as the recipe's model leaves them out."""
    fixed = recipe.method in ("one-point", "three-point") or recipe.model == "offset-gain"
    if not fixed or not recipe.pose_known or of(recipe).by_magnitude:
        return np.zeros((0, len(visits), 3))
    std = assumptions.unestimated_std(recipe)[3:].reshape(3, 3)
    if recipe.method != "one-point":
        std = std * (1 - np.eye(3))
    there = np.where(np.arange(3) < recipe.axes, 1.0, 0.0)
    out = np.einsum("ij,vj,ik->ijvk", std * there[:, None], visits.true, np.eye(3)).reshape(9, len(visits), 3)
    return np.asarray(out[out.any(axis=(1, 2))])


def nuisance(recipe: Recipe, position: tuple[str, ...], seating: tuple[str, ...], true: Floats) -> Floats:
    """The sensor kind's nuisance regressors (v, q) where visits tell them from the coefficients; q = 0 otherwise."""
    if not recipe.pose_known:
        return np.zeros((len(position), 0))
    found = sensor.of(recipe).nuisance(recipe, position, seating)
    rows = np.column_stack([np.ones(len(true)), true, found])
    apart = found.shape[1] > 0 and len(rows) >= rows.shape[1] and rank.of(rows) == rows.shape[1]
    return found if apart else np.zeros((len(position), 0))
