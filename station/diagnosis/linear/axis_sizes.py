"""A floor of which each axis has its own sizes: one scatters or wanders further than the others beside the same noise
of its samples, or hardly at all.

Its variances θ are the noise and the walk of each axis, and the turns. Each is taken to its best by its own squares,
θ·(yᵀPVPy)/tr(PV), or the root of that factor where the whole one leads down (Zhou, Hu, Qiao, Lange, J. Comput. Graph.
Stat. 28 (2019) 350, eq. 3). Visits of the common size beside those of each axis keep few visits from telling much.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from station.diagnosis.linear.noise_floor import FittedFloor, FloorStructure
from station.diagnosis.linear.projection import (
    UNITS_AT_ONCE,
    DataColumns,
    NuisanceColumns,
    ResidualSpace,
    residual_space,
)
from station.diagnosis.linear.run_filter import split_blocks
from station.domain.core.types import Floats

#: Visits of the common size beside those of each axis.
COMMON_VISITS = 2.0
#: Where nothing walks, the search begins at such a share of the noise; no variance falls below a trifle of the noise.
FIRST_WALK_SHARE, LEAST_SHARE = 1e-2, 1e-9
#: Rounds at the most, nats for which no other is worth while, and the rounds after which a share of what is wanted is
#: gained, where it is there.
MOST_ROUNDS, LEAST_GAIN, FIRST_ROUNDS, FIRST_SHARE = 40, 0.02, 3, 0.5


class AxisSizes(NamedTuple):
    """The structure of a floor with own sizes for each axis, and the restricted log-likelihood that they gain, nats."""

    structure: FloorStructure
    gain: float


def own_sizes(
    fitted: FittedFloor,
    known: NuisanceColumns,
    readings: tuple[DataColumns, int],
    upper: Floats,
    wanted: float,
) -> AxisSizes | None:
    """The best sizes of each axis beside a floor that all axes have in common; upper (3): bounds of its variances. None
    where they gain no more than is wanted, nats, or where the readings have no axes."""
    parts, first = fitted.parts, fitted.space.loglik
    if parts.walk.shape[3] != 3:
        return None
    common, most = (np.repeat(x, (3, 1, 3)) for x in (fitted.floor.variances, np.where(parts.shown, upper, 0.0)))
    least = np.minimum(LEAST_SHARE * common[0], most)
    at = common.copy()
    at[4:] = np.maximum(common[4:], FIRST_WALK_SHARE * common[0])
    at = np.clip(at, least, most)
    structure, here = parts, fitted.space
    for i in range(MOST_ROUNDS):
        before = here.loglik if i else -np.inf
        factor = _factor(structure, here, at, common) if i else np.ones(7)
        for power in (1.0, 0.5):
            trial = np.clip(at * factor**power, least, most)
            shaped, variances = _shaped(parts, trial)
            there = residual_space(shaped.covariance(variances), known, *readings)
            if there.loglik > before:
                at, structure, here = trial, shaped, there
                break
        if here.loglik - before < LEAST_GAIN:
            break
        if i == FIRST_ROUNDS and here.loglik - first < FIRST_SHARE * wanted:
            return None
    gain = here.loglik - first
    return AxisSizes(structure, gain) if gain > wanted else None


def _shaped(parts: FloorStructure, variances: Floats) -> tuple[FloorStructure, Floats]:
    """The structure with variances (7) of the noise of each axis, the turns and the walk of each axis, and the three of
    the whole: the walk's is that of the axis that walks furthest, as far as any may."""
    noise, walk = variances[:3].mean(), variances[4:].max()
    far = variances[4:] / walk if walk > 0 else np.ones(3)
    return of_axes(parts, variances[:3] / noise, far), np.array([noise, variances[3], walk])


def of_axes(parts: FloorStructure, noise: Floats, walk: Floats) -> FloorStructure:
    """A structure in which the noise and the walk of each axis have so many times their variance (3), (3)."""
    C, B, v, k = parts.walk.shape[:4]
    white, walked = parts.white * np.tile(noise, v), parts.walk * np.sqrt(walk)
    both = np.minimum(parts.taken[..., :, None], parts.taken[..., None, :])[..., :, None, :, None]
    rows = walked.reshape(C, B, v * k, 3)
    inside = both * (rows @ rows.swapaxes(-1, -2)).reshape(C, B, v, k, v, k)
    sizes = tuple(float(x) for x in (*noise, *walk))
    return replace(parts, white=white, walk=walked, inside=inside.reshape(C, B, v * k, v * k), sizes=sizes)


def _factor(parts: FloorStructure, now: ResidualSpace, at: Floats, common: Floats) -> Floats:
    """By what each variance (7) is to be multiplied: its squares over how many are expected. parts: the structure with
    the sizes that the axes have now."""
    runs, whole = now.covariance.runs, np.r_[np.full(3, at[:3].mean()), at[3], np.full(3, at[4:].max())]
    squares, taken = np.zeros(7), np.zeros(7)
    U, R = runs.member.shape

    def squares_of(rows: Floats, units: slice) -> Floats:
        visits = rows[:, : R * runs.rows].reshape(len(rows), R, runs.rows, -1)
        return _squares(replace(parts, member=parts.member[units]), runs.of_units(units).transposed(visits))

    for first in range(0, U, UNITS_AT_ONCE):
        units = slice(first, first + UNITS_AT_ONCE)
        squares += squares_of(now.residual[units][..., None], units)
        taken += squares_of(np.concatenate([now.basis[units], now.shared_basis[units]], axis=2), units)
    expected = whole * (parts.axis_traces(runs)[runs.member].sum((0, 1)) - taken)
    prior = np.where(np.arange(7) == 3, 0.0, COMMON_VISITS)
    return np.asarray((whole * squares + prior * common / np.maximum(at, 1e-300)) / np.maximum(expected + prior, 1e-12))


def _squares(parts: FloorStructure, rows: Floats) -> Floats:
    """rowᵀ·V·row (7) of each variance's part V of some units, over all columns of rows (U, R, m, c)."""
    C, B, v, k = parts.walk.shape[:4]
    by_visit = split_blocks(rows, B * v, k, axis=2)
    white, turn, walk = (x.reshape(C, B * v, k, -1)[parts.member] for x in (parts.white, parts.turn, parts.walk))
    step = parts.step.reshape(C, B * v)[parts.member]
    # What a step from each visit on does to that visit and those after it.
    onward = (walk.swapaxes(-1, -2) @ by_visit)[:, :, ::-1].cumsum(2)[:, :, ::-1]
    noise, walked = np.einsum("urvkn,urvkc->k", white, by_visit**2), np.einsum("urv,urvkc->k", step, onward**2)
    return np.concatenate([noise, [np.sum((turn.swapaxes(-1, -2) @ by_visit) ** 2)], walked])
