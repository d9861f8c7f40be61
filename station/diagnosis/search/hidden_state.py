"""A state that nothing recorded shows: an offset that jumps to and fro, a bond that opens, a nest that rattles at some
visits.

A state of a unit moves all its axes along one direction, whenever it changes; one of a nest turns what lies in it about
one axis. What the readings leave under the floor is white and has no direction. With x = Fᵀe, e (v, 3) white and F what
a change of size 1 along each direction does to a visit, the matrix S = Σ φ^|i−j| x_i x_jᵀ over the pairs of visits of a
run is, but for chance, that of noise drawn afresh, times a number. Its deviation from that, squared and summed over the
units or nests, is the score statistic of one direction for each (Mauchly's sphericity where φ = 0 and F = 1); the noise
drawn says what is usual, a gamma distribution of its mean and variance how rare more is. How much a state explains is
the likelihood of a variance along each direction, its size and the noise integrated out as those of any cause are.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.candidates.kernels import NEST_STATE, STATE
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.two_levels import levels_ahead
from station.diagnosis.search.unseen import NOTHING, Unseen
from station.domain.core.medians import medians
from station.domain.core.types import Floats
from station.model.effects.nest_tilt import NestTilt

#: Shares of a state that are left at the next visit: none, or what one that lasts some visits has.
KEPT = (0.0, 0.5)
#: Variances of a state beside the noise over which its evidence is averaged; what each direction costs, nats.
RATIOS, DIRECTION_NATS = np.geomspace(0.05, 20.0, 14), 2.0
#: Median length of three white numbers, and the length beyond which a visit says no more.
MEDIAN_LENGTH, MOST_LENGTH = 1.538, 3.5
#: A visit shows nothing of a turn whose effect there is less than this share of the largest.
LEAST_SHARE = 0.05
#: Sets of noise that are drawn; visits of the longest run, and units of which a state is looked for; free numbers.
DRAWN, LEAST_VISITS, MOST_VISITS, MOST_UNITS, LEAST_NUMBERS = 256, 4, 120, 24, 4


class _WhiteVisits(NamedTuple):
    """Sets of noise, and the readings as the last one, in white rows (U, R, V, 3, n) of some units; their visits (v),
    the slots of these (U, R, V), and how many numbers are free."""

    sets: Floats
    visits: NDArray[np.bool_]
    slot: NDArray[np.intp]
    dof: int

    @staticmethod
    def of(problem: ScoringProblem, floor: NoiseFloor) -> "_WhiteVisits | None":
        """Those of the first units of a problem; None where too little is free, or runs are few or very long."""
        grid = problem.view.grid
        if grid.k != 3 or not LEAST_VISITS <= grid.slot.shape[2] <= MOST_VISITS:
            return None
        setting, visits = problem.setting.of_units(np.arange(min(grid.units, MOST_UNITS)))
        space, slot = setting.space(floor, moving=False), setting.layout.grid.slot
        U, _, V = slot.shape
        if not space.residual.any():
            return None
        rng = np.random.default_rng(U * V)
        noise = space.free(rng.standard_normal((*space.live.shape, DRAWN)) * space.live[..., None])
        sets = np.concatenate([noise, space.residual[..., None]], axis=2)
        rows = slot[0].size * 3
        e = _calmed(sets[:, :rows].reshape(*slot.shape, 3, -1), slot)
        # Beside what moves within the dwells their contrasts are there, too, and are no visits.
        dof = space.dof - int(np.count_nonzero(space.live[:, rows : rows + space.dwell]))
        return None if dof < LEAST_NUMBERS else _WhiteVisits(e, visits, slot, dof)


def find_states(problem: ScoringProblem, floor: NoiseFloor) -> dict[str, Unseen]:
    """What a direction of each unit, and an axis of each nest, explains of the readings under a floor, under its name
    as a kernel; nothing of few or of very long runs."""
    nothing, white = {STATE: NOTHING, NEST_STATE: NOTHING}, _WhiteVisits.of(problem, floor)
    if white is None:
        return nothing
    frames = _frames(problem, white.visits, white.slot)
    return nothing | {name: frame.found(white.sets, white.slot, white.dof) for name, frame in frames}


def has_levels(problem: ScoringProblem, floor: NoiseFloor) -> bool:
    """Whether units that scatter along one direction do so at two levels, rather than by any size, as where what moves
    all axes of a healthy sensor together makes them scatter."""
    white = _WhiteVisits.of(problem, floor)
    if white is None:
        return False
    last, ahead = _alike(white.sets)[..., -1], 0.0
    for unit, there in zip(last, white.slot >= 0, strict=True):
        e = unit[there]
        spread, directions = np.linalg.eigh(e.T @ e / len(e))
        ahead += levels_ahead(e @ directions[:, -1], float(np.sqrt(spread[:2].mean())))
    return ahead > 0.0


def _frames(
    problem: ScoringProblem, visits: NDArray[np.bool_], slot: NDArray[np.intp]
) -> Iterator[tuple[str, "_Frame"]]:
    """Units by their offsets, and nests by their turns where poses are known and a unit stays in its nest for a run."""
    units = np.broadcast_to(np.arange(len(slot))[:, None], slot.shape[:2])
    yield STATE, _Frame(None, units)
    scene = problem.view.scene
    if not scene.recipe.pose_known or not scene.is_recorded("nest"):
        return
    nests = np.where(slot >= 0, scene.group("nest")[0][visits][slot], -1)
    of_run = nests.max(axis=2)
    turn = problem.view.signature(NestTilt.example(), "common")[0][visits]
    if np.all((nests == of_run[..., None]) | (slot < 0)) and np.any(turn):
        yield NEST_STATE, _Frame(np.where(slot[..., None, None] >= 0, turn[slot], 0.0), of_run)


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """What a change of size 1 along each of three directions does to a visit, F (U, R, V, 3, 3), None where these are
    the unit's axes; and whose direction it is of each run (U, R), −1 where there is none."""

    effect: Floats | None
    whose: NDArray[np.intp]

    def found(self, e: Floats, slot: NDArray[np.intp], dof: int) -> Unseen:
        """What the last of some sets of white rows (U, R, V, 3, n) shows of a state."""
        names, code = np.unique(self.whose, return_inverse=True)
        member = (code.reshape(-1) == np.arange(len(names))[:, None])[names >= 0].astype(float)
        x = _alike(e) if self.effect is None else self.effect.swapaxes(-1, -2) @ e
        sets = np.ascontiguousarray(x.reshape(-1, *x.shape[2:]).transpose(0, 3, 2, 1))
        tests = [_Directions.of(x[..., -1], sets, self.effect, member, slot, kept) for kept in KEPT]
        chance = len(KEPT) * min(_chance(test.statistic) for test in tests)
        # Not every one of them need have a state; its size is of one kind where it has.
        some = [np.logaddexp(0.0, test.likelihoods(dof, member) - DIRECTION_NATS) - np.log(2) for test in tests]
        return Unseen.of(float(log_mean_exp(np.concatenate([s.sum(axis=0) for s in some]))), chance)


def _calmed(e: Floats, slot: NDArray[np.intp]) -> Floats:
    """White rows (U, R, V, 3, n) in the noise of most visits, where those beyond it are drawn in: a few visits that are
    wrong by much are no state."""
    length = np.sqrt(np.sum(e**2, axis=3, keepdims=True))
    usual = medians(length[slot >= 0, 0].T) / MEDIAN_LENGTH
    e = e / usual * np.minimum(1.0, MOST_LENGTH / np.maximum(length / usual, 1e-300))
    return np.asarray(e / np.sqrt(np.sum(e**2, axis=(0, 1, 2, 3)) / (3 * np.count_nonzero(slot >= 0))))


def _alike(e: Floats) -> Floats:
    """The rows with each axis in its own noise, that of all units: a kind of sensor whose axes scatter apart is no
    state of a unit."""
    square = np.sum(e**2, axis=(0, 1, 2), keepdims=True)
    return np.asarray(e * np.sqrt(np.mean(square, axis=3, keepdims=True) / np.maximum(square, 1e-300)))


@dataclass(frozen=True, slots=True, eq=False)
class _Directions:
    """How much of each set (n) has a direction; of the last one the parts along it of each run (U, R, V), by the
    principal axes of what lasts, and the variances (V) of these; the share of each run that shows anything (U, R, 1).
    """

    statistic: Floats
    along: Floats
    spread: Floats
    live: Floats

    @staticmethod
    def of(
        last: Floats,
        sets: Floats,
        effect: Floats | None,
        member: Floats,
        slot: NDArray[np.intp],
        kept: float,
    ) -> "_Directions":
        """Of sets x (U·R, n, 3, V), the last of which is (U, R, V, 3), too, for states of which a share is left at the
        next visit. member (groups, U·R): whose direction that of a run is."""
        U, R, V = slot.shape
        lasting = kept ** np.abs(np.subtract.outer(np.arange(V), np.arange(V))).astype(float)
        smooth = sets @ lasting if kept else sets
        of_runs = (sets @ smooth.swapaxes(-1, -2)).reshape(U * R, -1)
        S = (member @ of_runs).reshape(len(member), -1, 3, 3)
        usual, root = _usual(S[:, :-1].mean(axis=1))
        S = usual[:, None, None, None] * (root[:, None] @ S @ root[:, None])
        S = S - np.trace(S, axis1=2, axis2=3)[..., None, None] / 3 * np.eye(3)
        direction = np.einsum("gij,gj->gi", root, np.linalg.eigh((S[:, -1] + S[:, -1].swapaxes(1, 2)) / 2)[1][..., -1])
        u = (member.T @ direction).reshape(U, R, 3)
        size = np.linalg.norm(u[:, :, None] if effect is None else np.einsum("urvak,urk->urva", effect, u), axis=3)
        seen = (slot >= 0) & (size > LEAST_SHARE * size.max())
        part = np.where(seen, np.einsum("urvi,uri->urv", last, u) / np.where(seen, size, 1.0), 0.0)
        spread, axes = np.linalg.eigh(lasting)
        return _Directions(
            np.sum(S**2, axis=(0, 2, 3)), part @ axes, np.maximum(spread, 0.0), np.mean(seen, axis=2, keepdims=True)
        )

    def likelihoods(self, dof: int, member: Floats) -> Floats:
        """Log-likelihood of each size (groups, ratios) beside none, the noise's at its best, of rows whose mean square
        is 1."""
        grown = RATIOS[:, None] * self.spread
        # All rows together, of which the known takes some, have as many squares as rows.
        rows = 3 * self.live.sum() * self.along.shape[2]
        taken = member @ np.einsum("sk,urk->urs", grown / (1 + grown), self.along**2).reshape(-1, len(RATIOS)) / rows
        free = (member @ self.live.ravel())[:, None] * np.log1p(grown).sum(1)
        return np.asarray(-0.5 * dof * np.log1p(-np.minimum(taken, 1 - 1e-9)) - 0.5 * free)


def _usual(S: Floats) -> tuple[Floats, Floats]:
    """The mean size (g) of what noise has along each direction, and what makes it alike along all of them (g, 3, 3)."""
    size, axes = np.linalg.eigh((S + S.swapaxes(1, 2)) / 2)
    held = size > 1e-6 * np.maximum(size[:, -1:], 1e-300)
    inverse = np.where(held, 1 / np.sqrt(np.where(held, size, 1.0)), 0.0)
    return size.mean(axis=1), np.einsum("gik,gk,gjk->gij", axes, inverse, axes)


def _chance(statistic: Floats) -> float:
    """How often noise has as much as the last of the sets, by the moments of all others."""
    usual, found = statistic[:-1], statistic[-1]
    mean, variance = float(np.mean(usual)), float(np.var(usual))
    if variance <= 0.0:
        return 1.0
    return float(scipy.special.gammaincc(mean**2 / variance, found * mean / variance))
