"""Moves between positions: how long a turn takes, and the order of a run that costs least (`recipe.ordering`)."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.recipe import ordering
from station.domain.recipe.blocks import Run
from station.domain.recipe.ordering import FORBIDDEN_S, MoveTimes
from station.domain.recipe.position import Position
from station.domain.recipe.recipe import Recipe

#: Speeds of an ordinary bench: `order: fastest` must not depend on the bench, or a run could not be replayed elsewhere.
SPEED_DEG_S, ACCELERATION_DEG_S2 = 90.0, 180.0
#: Poses that differ by less are one, degrees.
SAME_DEG = 1e-3


def turn_s(
    angle_deg: Floats, speed_deg_s: float = SPEED_DEG_S, acceleration_deg_s2: float = ACCELERATION_DEG_S2
) -> Floats:
    """Duration of turns: a trapezium of speed, or a triangle where full speed is never reached."""
    angle = np.asarray(angle_deg, float)
    short = 2.0 * np.sqrt(angle / acceleration_deg_s2)
    long = angle / speed_deg_s + speed_deg_s / acceleration_deg_s2
    return np.where(angle < speed_deg_s**2 / acceleration_deg_s2, short, long)


def angles_deg(origin: Floats, goal: Floats) -> Floats:
    """Shortest turns (n, m) from nest → station rotations (n, 3, 3) to others (m, 3, 3)."""
    turn = goal[None] @ origin[:, None].transpose(0, 1, 3, 2)
    return np.asarray(np.rad2deg(np.linalg.norm(rotation.to_vector(turn), axis=-1)))


def bench_move_times(positions: Sequence[Position], start: Floats, end: Floats | None) -> MoveTimes:
    """Moves at the speeds of an ordinary bench, from rotation `start` (3, 3) and to `end`, None where nobody knows."""
    nests = np.stack([p.matrix() for p in positions])
    back = np.zeros(len(nests)) if end is None else turn_s(angles_deg(nests, end[None])[:, 0])
    return MoveTimes(turn_s(angles_deg(nests, nests)), turn_s(angles_deg(start[None], nests)[0]), back)


def allowed_moves(moves: MoveTimes, positions: Sequence[Position], run: Run) -> MoveTimes:
    """The moves with those forbidden that the run must not make.

    The run's own first and last position stay there; positions at one pose do not follow each other, for only coming
    back to a pose shows how well it is come back to.
    """
    nests = np.stack([p.matrix() for p in positions])
    rates = [p.rate for p in positions]
    same = (angles_deg(nests, nests) < SAME_DEG) & np.array([[a == b for b in rates] for a in rates])
    names = [p.name for p in positions]
    first, last = (None if name is None else names.index(name) for name in (run.first, run.last))
    return MoveTimes(np.where(same, FORBIDDEN_S, moves.between), moves.start, moves.end).fixed(first, last)


def fastest(recipe: Recipe, run: Run, start: Floats, end: Floats | None) -> tuple[Position, ...]:
    """The positions of a run in the order of least moving time at the speeds of an ordinary bench."""
    moves = allowed_moves(bench_move_times(recipe.positions, start, end), recipe.positions, run)
    order = _fastest(moves.between.tobytes(), moves.start.tobytes(), moves.end.tobytes())
    return tuple(recipe.positions[i] for i in order)


@lru_cache(maxsize=64)
def _fastest(between: bytes, start: bytes, end: bytes) -> tuple[int, ...]:
    first, last = np.frombuffer(start), np.frombuffer(end)
    return tuple(ordering.fastest(MoveTimes(np.frombuffer(between).reshape(len(first), -1), first, last)).tolist())
