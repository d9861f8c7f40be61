"""What goes round while a rate table turns: the Earth's rate across the table's axis, and gravity about a level one.

A sine and a cosine of the table's angle stand for it at each visit, as nobody records at which angle a dwell begins.
Over whole turns they leave the mean as it is and show within the dwell; over parts of a turn they move the mean, too.
How large they may be the recipe says: by its site, or by all of the Earth's rate, and by the device's g-sensitivity.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.reduce import NODES, WEIGHTS, ReducedScene, TableAngles, mean_and_contrasts
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.projection import DataColumns
from station.domain.core.types import Floats
from station.domain.recipe import assumptions, gravity
from station.domain.recipe.recipe import Recipe

#: Columns of a unit at most; of more visits those count where it shows most.
MOST_COLUMNS = 240
#: Squared length in white readings, over all visits, below which nothing shows it.
LEAST_SHOWN = 1.0
#: A level part of up (in g) below this is a digit of the pose.
UPRIGHT = 1e-3


class GoingRound(NamedTuple):
    """Columns whose coefficients are 0 ± 1, of each unit or shared by all."""

    columns: DataColumns
    shared: bool


def going_round_columns(view: ResidualView) -> GoingRound | None:
    """What goes round at each visit; None where nothing turns, or too little to show."""
    recipe = view.scene.recipe
    if not (recipe.feels_rotation and recipe.pose_known and any(p.rate is not None for p in recipe.positions)):
        return None
    mean, contrast = _by_visit(view)
    # A few visits hardly tell their noise, their samples do.
    noise = view.sigma / np.sqrt(view.reduced.count.sum(1))
    shown = np.sum((mean / noise[:, None, None]) ** 2, axis=1) + np.sum((contrast / view.sigma) ** 2, axis=(1, 2))
    if shown.sum() < LEAST_SHOWN:
        return None
    shared = view.reduced.table_angles != "own"
    column = _columns_of(_angles(view), shown) if shared else _own_columns(shown, view.scene.visits.unit.code)
    width = int(column.max()) + 1
    means, contrasts = np.zeros((*mean.shape[:2], width)), np.zeros((*contrast.shape[:3], width))
    visit, which = np.nonzero(column >= 0)
    means[visit, :, column[visit, which]] = mean[visit, :, which]
    contrasts[visit, :, :, column[visit, which]] = contrast[visit, :, :, which]
    return GoingRound(view.rows(means, contrasts), shared)


def possible_angles(view: ResidualView) -> tuple[TableAngles, ...]:
    """Whose the angles may be in a campaign, each unit's own first."""
    U, R, V = view.grid.slot.shape
    if going_round_columns(view) is None:
        return ()
    together: tuple[TableAngles, ...] = ("ridden-together",) if U > 1 and R * V <= MOST_COLUMNS // 2 else ()
    again: tuple[TableAngles, ...] = ("position",) if R > 1 else ()
    return ("own", *together, *again)


def _angles(view: ResidualView) -> NDArray[np.intp]:
    """Which visits (v) begin at one angle."""
    visits, slot = view.scene.visits, view.grid.slot
    if view.reduced.table_angles == "position":
        return np.asarray(visits.position.code, np.intp)
    place = np.empty(len(visits), np.intp)
    place[slot[slot >= 0]] = np.broadcast_to(np.arange(slot[0].size).reshape(slot[0].shape), slot.shape)[slot >= 0]
    return place


def _columns_of(group: NDArray[np.intp], shown: Floats) -> NDArray[np.intp]:
    """Which column each column of a visit is where the visits of a group (v) share theirs; −1 for none."""
    number = np.unique(group, return_inverse=True)[1]
    return np.where(shown > 0, number[:, None] * shown.shape[1] + np.arange(shown.shape[1]), -1)


def _own_columns(shown: Floats, unit: NDArray[np.integer]) -> NDArray[np.intp]:
    """Which column of its unit (v, c) each column of a visit is, by how much it shows (v, c); −1 for none."""
    column = np.full(shown.shape, -1)
    for u in np.unique(unit):
        rows = np.flatnonzero(unit == u)
        seen = np.argsort(-shown[rows], axis=None, kind="stable")[: np.count_nonzero(shown[rows])][:MOST_COLUMNS]
        visit, which = np.unravel_index(np.sort(seen), (len(rows), shown.shape[1]))
        column[rows[visit], which] = np.arange(len(seen))
    return column


def _by_visit(view: ResidualView) -> tuple[Floats, Floats]:
    """What goes round at each visit: mean (v, 3, c) and contrasts (v, B−1, 3, c), one standard deviation each."""
    reduced, visits = view.reduced, view.scene.visits
    code, names = visits.position.code, visits.position.names
    axis, speed, earth, pull = (
        np.array(part)[code] for part in zip(*(_of_position(view.scene.recipe, n) for n in names), strict=True)
    )
    cosine, sine = _table_angles(reduced, np.deg2rad(speed))
    across = _across(axis)
    turned = [
        cosine[..., None] * across[:, None, 0] - sine[..., None] * across[:, None, 1],
        sine[..., None] * across[:, None, 0] + cosine[..., None] * across[:, None, 1],
    ]
    patterns = [earth[:, None, None] * one for one in turned]
    if pull.any():
        # Whichever axis feels whichever part of gravity: each its own share of both.
        patterns += [pull[:, None, None] * wave[..., None] * one for one in np.eye(3) for wave in (cosine, sine)]
    seated = np.einsum("vji,cvbj->vbic", visits.seat_R, np.array(patterns))
    return mean_and_contrasts(seated, reduced.count)


def _of_position(recipe: Recipe, name: str) -> tuple[Floats, float, float, float]:
    """Axis (3) of the table in the nest's frame, speed, deg/s, and what goes round about it: standard deviation of the
    Earth's rate in each direction across it and of an axis' pull by gravity, in the recipe's unit; 0 at rest."""
    position = recipe.position(name)
    rate = np.array(position.rate or (0.0, 0.0, 0.0), float)
    speed = float(np.linalg.norm(rate))
    if speed == 0:
        return np.array([1.0, 0.0, 0.0]), 0.0, 0.0, 0.0
    axis = position.matrix() @ rate / speed
    site, unknown = recipe.reference.site, assumptions.unknown_earth_rate(recipe)
    known = np.zeros(3) if site is None else gravity.earth_rate(site.latitude_deg, site.heading_deg)
    squares = _square_across(known, axis) + sum(_square_across(part, axis) for part in np.diag(unknown))
    level = float(np.sqrt(_square_across(np.array([0.0, 0.0, 1.0]), axis)))
    pull = assumptions.g_sensitivity(recipe) * level if level > UPRIGHT else 0.0
    return rate / speed, speed, float(np.sqrt(squares / 2)), pull


def _square_across(vector: Floats, axis: Floats) -> float:
    return float(vector @ vector - (vector @ axis) ** 2)


def _across(axis: Floats) -> Floats:
    """Two unit vectors (v, 2, 3) across each axis (v, 3), which turn from the first to the second about it."""
    other = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = np.cross(axis, other)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(axis, first)], axis=1)


def _table_angles(reduced: ReducedScene, speed: Floats) -> tuple[Floats, Floats]:
    """Mean cosine and sine (v, B) of the table's angle in each block, from speed (v), rad/s; blocks may hold many
    turns."""
    inside = reduced.fine.time_s.reshape(*reduced.count.shape, len(NODES))
    late = inside @ WEIGHTS - reduced.scene.time_s[:, None]
    half = (inside[..., -1] - inside[..., 0]) / (NODES[-1] - NODES[0]) * np.sqrt(3.0)
    left = np.sinc(speed[:, None] * half / np.pi)
    angle = speed[:, None] * late
    return left * np.cos(angle), left * np.sin(angle)
