"""What kernels are made of: functions of the visits as columns, shared at one of the scene's levels."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS, Candidate
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.evidence import Pattern
from station.domain.core.types import Array, Floats
from station.model.effects.nest_tilt import NestTilt


def kernel(name: str, of: str, view: ResidualView, columns: CauseColumns) -> Candidate:
    """A kernel shared at one of the scene's levels."""
    code, names = view.scene.group(of)
    return grouped_kernel(name, of, code, names, columns)


def grouped_kernel(
    name: str, of: str, code: NDArray[np.int32], names: tuple[str, ...], columns: CauseColumns
) -> Candidate:
    """A kernel shared by groups (v) of the visits."""
    pattern: Pattern = "own" if of in PER_UNIT_LEVELS else "shared"
    return Candidate(name, None, of, pattern, code, names, columns)


def kernels_at(view: ResidualView, name: str, columns: Floats, *levels: str) -> Iterator[Candidate]:
    """A kernel of columns (v, 3, c) at each of those levels that differ in these data."""
    packed = CauseColumns.in_bank(view, columns)
    yield from (kernel(name, of, view, packed) for of in levels_that_differ(view, *levels))


def levels_that_differ(view: ResidualView, *levels: str) -> Iterator[str]:
    """Levels that differ in these data."""
    taken: set[tuple[bool, bytes]] = set()
    for of in levels:
        key = (of in PER_UNIT_LEVELS and view.grid.units > 1, view.scene.group(of)[0].tobytes())
        if key not in taken:
            taken.add(key)
            yield of


def each_axis(functions: Array) -> Floats:
    """Functions (v, f) on each axis on its own: columns (v, 3, 3·f)."""
    return np.asarray(np.einsum("ij,vf->vifj", np.eye(3), functions).reshape(len(functions), 3, -1), float)


def own_axis(values: Floats) -> Floats:
    """Values (…, 3) of each axis on that axis alone: columns (…, 3, 3)."""
    return np.asarray(np.eye(3) * values[..., None, :])


def packed_codes(code: Array) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Codes without gaps, and names for them."""
    names, packed = np.unique(code, return_inverse=True)
    return packed.astype(np.int32), tuple(f"group:{n}" for n in names)


def steps_before(view: ResidualView, a: Floats) -> Floats:
    """By how much what each axis feels (v, 3) was another at the visit before."""
    previous = view.scene.visits.previous
    return np.where(previous[:, None] >= 0, a[previous] - a, 0.0)


def scaled(values: Floats) -> Floats:
    """Values brought to −1 … 1."""
    low, high = float(values.min()), float(values.max())
    return np.asarray(2 * (values - low) / max(high - low, 1e-300) - 1)


def ones(view: ResidualView) -> CauseColumns:
    """Anything on each axis."""
    return CauseColumns.in_bank(view, np.broadcast_to(np.eye(3), (len(view.reduced.mean), 3, 3)))


def turns_of_nests(view: ResidualView) -> Iterator[Floats]:
    """What small turns of the nests do to the readings (v, 3, 3), where they do anything; of a gold's truth, which the
    simulation has in the same nest, by the turn of what it reads."""
    if not view.scene.recipe.pose_known:
        return
    turn = view.signature(NestTilt.example(), "common")[0]
    if view.scene.is_recorded("gold") and not view.scene.recipe.converts:
        a, seats = view.stimulus, view.scene.visits.seat_R
        turn = np.cross(a[:, None, :], seats).transpose(0, 2, 1)
    if np.any(turn):
        yield turn
