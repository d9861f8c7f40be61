"""What one unit's visits say of nest, base, positions and noise: few numbers, each in its own unit.

measured = M · true + offset is solved by least squares over the visits at home; what is left is projected on what a
base out of level and a position off its place would leave there. Turning the part by ω changes the stimulus by
−ω × true, so a nest that holds its part askew is the antisymmetric part of M.
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats, ReducedVisits
from station.domain.recipe.recipe import Recipe

#: A direction that shows with less than this share of the strongest is invisible.
_VISIBLE = 0.1
_UNKNOWNS = 4
_TINY = 1e-30


@dataclass(frozen=True, slots=True)
class WatchedSignal:
    """What is watched: kind, and where: position, or "" for all of the nest."""

    kind: str
    position: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """components (m, 3v): applied to the visits' means less the stimulus; directions (m, 3) of the components."""

    components: Floats
    directions: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Projector:
    """Made once for each order of visits: residual_of (3v, 3v) takes the solved part away; freedom: what is left."""

    home: tuple[int, ...]
    nominal: Floats
    residual_of: Floats
    freedom: int
    projections: dict[WatchedSignal, Projection]

    def values(self, visits: ReducedVisits) -> dict[WatchedSignal, Floats]:
        """Components of each signal of one unit; of `residual` and `noise` the natural logarithm."""
        rows = list(self.home)
        # A gold reference sees its own stimulus: what it differs from the nominal is taken away.
        apart = (visits.mean[rows] - visits.true[rows]).ravel()
        found = {signal: p.components @ apart for signal, p in self.projections.items()}
        if self.freedom:
            left = self.residual_of @ apart
            found[WatchedSignal("residual")] = np.array([0.5 * np.log(max(float(left @ left) / self.freedom, _TINY))])
        found[WatchedSignal("noise")] = np.array([np.log(max(float(np.median(visits.std[rows])), _TINY))])
        return {signal: v for signal, v in found.items() if np.isfinite(v).all()}


def projector(recipe: Recipe, visits: ReducedVisits) -> Projector | None:
    """For visits in this order; None where the recipe does not know where the stimulus points, or none is at home."""
    home = tuple(i for i, seating in enumerate(visits.seating) if seating == "home")
    if not recipe.pose_known or not home:
        return None
    names = [visits.position[i] for i in home]
    true = np.array([recipe.true_vector(recipe.position(name)) for name in names])
    design = np.column_stack([np.ones(len(true)), true])
    full = np.linalg.matrix_rank(design, tol=1e-3 * np.linalg.norm(design)) == _UNKNOWNS
    design = design if full else design[:, :1]
    solve = np.linalg.pinv(design)
    residual_of = np.kron(np.eye(len(true)) - design @ solve, np.eye(3))
    freedom = 3 * (len(true) - design.shape[1])
    projections = {WatchedSignal("offset"): Projection(np.kron(solve[0], np.eye(3)), np.eye(3))}
    if full:
        projections |= _of_matrix(solve)
    for signal, columns in _errors_of_place(recipe, names, true).items():
        if freedom and (found := _visible(residual_of, columns)) is not None:
            projections[signal] = found
    return Projector(home, true, residual_of, freedom, projections)


def _of_matrix(solve: Floats) -> dict[WatchedSignal, Projection]:
    """Gains, and the rotation of the part: M − 1 = −[ω]× in its antisymmetric part."""
    # Entry (i, j) of the matrix less 1: row j + 1 of the solution, of axis i.
    entry = {(i, j): np.kron(solve[j + 1], np.eye(3)[i]) for i in range(3) for j in range(3)}
    gain = np.array([entry[i, i] for i in range(3)])
    turn = np.array([entry[1, 2] - entry[2, 1], entry[2, 0] - entry[0, 2], entry[0, 1] - entry[1, 0]]) / 2
    return {WatchedSignal("gain"): Projection(gain, np.eye(3)), WatchedSignal("nest-tilt"): Projection(turn, np.eye(3))}


def _errors_of_place(recipe: Recipe, names: list[str], true: Floats) -> dict[WatchedSignal, Floats]:
    """Columns (3v, 3): how 1 rad of a base out of level and of each position off its place changes all readings."""
    turned = -rotation.cross_matrix(np.eye(3))  # (k, 3, 3): −e_k × a
    found = {}
    if recipe.reference.source != "rate":
        level = np.array([_base(recipe, name, turned) for name in names])
        found[WatchedSignal("base-tilt")] = level.reshape(-1, 3)
    for name in dict.fromkeys(names):
        here = np.array([n == name for n in names])
        columns = np.einsum("kij,vj->vik", turned, true) * here[:, None, None]
        found[WatchedSignal("index-error", name)] = columns.reshape(-1, 3)
    return found


def _base(recipe: Recipe, name: str, turned: Floats) -> Floats:
    position = recipe.position(name)
    return np.asarray(position.matrix().T @ np.einsum("kij,j->ik", turned, recipe.stimulus(position)))


def _visible(residual_of: Floats, columns: Floats) -> Projection | None:
    """Least squares on what the solution leaves of the columns, along the directions that show at all."""
    u, s, v = np.linalg.svd(residual_of @ columns, full_matrices=False)
    shown = s > _VISIBLE * max(float(np.linalg.norm(columns, 2)), _TINY)
    if not shown.any():
        return None
    return Projection((u[:, shown] / s[shown]).T @ residual_of, v[shown])
