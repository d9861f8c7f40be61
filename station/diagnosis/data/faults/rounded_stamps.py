"""Rates from stamps that were rounded: which periods leave every stamp within its rounding.

Frame k of a stretch, sent at t₀ + kP and stamped on a grid q, rounded or cut off, keeps |s_k − s_j − (k − j)P| ≤ q with
every other one. All pairs together leave an interval of P that holds the true one, whatever the phases are and
whether the visits share them or not. A slope by least squares is off by what the roundings add up to, and where the
visits begin in step with the host's clock by the same in each. Stamps that are late by more leave no such interval.
"""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats

#: Grids of stamps that are looked for, s, and the share of a step by which one may lie beside it.
STAMP_GRIDS_S, ON_GRID = (1 / 64, 1e-2, 1e-3, 1e-4), 1e-3
#: Of two frames whose stamps differ by a step more than they should, no rounding is to blame: less than a step.
LESS = 1 - 1e-6
#: All periods of an interval are as likely: of how much of it so many standard deviations are made.
SHARE_COVERED, NORMAL_COVERED = 0.95, 1.96
#: Phases of a grid over which the slope of a rounding is averaged, and periods of which the worst counts.
PHASES, PERIODS = 16, 5


def stamp_grid(time_s: Floats) -> float:
    """The coarsest usual grid on which all stamps lie, s; 0 where they lie on none."""
    return next((q for q in STAMP_GRIDS_S if np.all(np.abs(time_s - q * np.rint(time_s / q)) < ON_GRID * q)), 0.0)


def period_within_rounding(time_s: Floats, number: Array, group: Array) -> tuple[float, float] | None:
    """The period of frames by their numbers and stamps (n), s, and its standard deviation, where stamps on a grid err
    by their rounding alone; each group of neighbours has a phase of its own. None where they err by more, or nothing
    bounds the period."""
    first = np.flatnonzero(np.diff(group, prepend=-1))
    last = np.append(first[1:], len(group)) - 1
    frames = number[last] - number[first]
    grid, longest = stamp_grid(time_s), int(frames.argmax())
    if not grid or frames[longest] < 1:
        return None
    time_s, within = grid * np.rint(time_s / grid), LESS * grid
    usual, reach = (time_s[last] - time_s[first])[longest] / frames[longest], within / frames[longest]
    low = _bound(time_s, number, first, within, usual - reach, rising=True)
    high = None if low is None else _bound(time_s, number, first, within, usual + reach, rising=False)
    if low is None or high is None or high < low or low <= 0:
        return None
    # A lateness of a small share of the grid may leave hardly anything; so much is left by the rounding alone.
    half = max((high - low) / 2, reach / len(time_s))
    return (low + high) / 2, half * SHARE_COVERED / NORMAL_COVERED


def _bound(
    time_s: Floats, number: Array, first: NDArray[np.intp], within: float, period: float, *, rising: bool
) -> float | None:
    """The end of the interval of periods, from one that lies beyond it: the two frames that are farthest apart move it
    to where they fit, until all do. None where two ask for the other way."""
    end = np.append(first[1:], len(time_s))
    while True:
        beside = time_s - number * period
        apart = np.maximum.reduceat(beside, first) - np.minimum.reduceat(beside, first)
        group = int(apart.argmax())
        if apart[group] <= within:
            return period
        of = slice(first[group], end[group])
        steps = int(number[of][beside[of].argmax()] - number[of][beside[of].argmin()])
        if (steps > 0) != rising:
            return None
        moved = period + float(apart[group] - within) / steps
        if moved == period:
            return period
        period = moved


def deviation_of_rounding(time_s: Floats, number: Array, group: Array, period_s: float) -> float:
    """Standard deviation of what rounded stamps (n) put on the slope of all groups of frames alike, per s: roundings
    that follow each other rise and fall like a saw, and groups that begin at the same phase of the grid have the same.
    What they do not share, their scatter shows."""
    grid = stamp_grid(time_s)
    if not grid or not len(time_s):
        return 0.0
    first = np.flatnonzero(np.diff(group, prepend=-1))
    count = np.diff(np.append(first, len(group)))
    frame = number - np.repeat(number[first], count)
    begin = np.add.reduceat(time_s - frame * period_s, first) / count
    # A slope that is off by what a rounding does looks like a period that keeps to the grid.
    others = period_s + grid / max(int(frame.max()), 1) * np.linspace(-1.0, 1.0, PERIODS)
    worst = max(_variance_of_rounding(frame, first, count, period, grid) for period in others)
    return float(np.sqrt(_share_in_step(begin[count > 1] / grid) * worst))


def _variance_of_rounding(
    frame: Array, first: NDArray[np.intp], count: NDArray[np.intp], period_s: float, grid_s: float
) -> float:
    """Mean square of the slopes of roundings, per s, over groups of frames, numbered from 0, and phases of the grid."""
    at = frame * period_s
    t = at - np.repeat(np.add.reduceat(at, first) / count, count)
    weight, live = np.add.reduceat(t * t, first), count > 1
    steps = [at / grid_s + phase for phase in np.arange(PHASES) / PHASES]
    slopes = [grid_s * np.add.reduceat(t * (np.rint(x) - x), first)[live] / weight[live] for x in steps]
    return float(np.mean(np.square(slopes))) if live.any() else 0.0


def _share_in_step(phase: Floats) -> float:
    """How much of a variance cyclic phases (groups, in turns) share: 1 where all are the same, about 0 where they are
    drawn; the square of their mean direction without what chance leaves of it."""
    groups = max(len(phase), 1)
    length = float(np.abs(np.mean(np.exp(2j * np.pi * phase))) ** 2)
    return max(groups * length - 1, 0.0) / (groups - 1) if groups > 1 else 1.0
