"""Which visits read as another position than the one that they are called after: a face skipped, or two exchanged."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import BlockGain, FaultParameter, GrossFault, block_gain
from station.diagnosis.data.row_place import where_is
from station.domain.core import rotation
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.evaluation.unit_dwells import visit_boundaries
from station.domain.recipe import plan
from station.domain.recipe.recipe import Recipe
from station.domain.recognition.quantities import sphere

#: A reading this far from its position's stimulus, in stimuli, is of another one, and of one that is so near: as
#: directions are that are 45° and 20° apart. No offset moves it so, and no nest.
FAR, NEAR = 0.765, 0.347
#: So many visits of a unit read as they are called where some are at no position.
MOST_AS_CALLED = 0.6
#: One matrix and one offset leave less than this share of the stimulus where axes are others, or the unit is turned.
MAPPED = 0.25
#: Standard deviation of an angle that two positions alone tell, rad: offsets and gains of a sensor, nests.
ANGLE_STD = 0.05

Ints = NDArray[np.int32]
Marks = NDArray[np.bool_]


def seating_of_visits(recipe: Recipe, table: SampleTable, begin: NDArray[np.int64]) -> Labels | None:
    """The seating of each visit (v) that begins at a row, stated or by the recipe's run; None where a position or a
    seating is of no recipe."""
    if not set(table.position.names) <= {p.name for p in recipe.positions}:
        return None
    stated = table.labels.get("seating")
    run = table.run[begin]
    seating = plan.seating_of_passes(recipe, run) if stated is None else Labels(stated.names, stated.code[begin])
    return seating if set(seating.names) <= {"home", *recipe.seatings} else None


@dataclass(frozen=True, slots=True, eq=False)
class MisplacedVisit:
    """A visit, by its number in a table in order, that reads as another position. angle (3): rotation vector in the
    nest's frame that turns the part so; called, other (3): what a perfect device reads at either, in the recipe's
    unit."""

    visit: int
    name: str
    angle: Floats
    called: Floats
    other: Floats


def elsewhere(recipe: Recipe, table: SampleTable, begin: NDArray[np.int64], mean: Floats) -> list[MisplacedVisit]:
    """Visits of a table in order that read as another position. mean (v, 3): their readings."""
    if not recipe.pose_known:
        return []
    seating = seating_of_visits(recipe, table, begin)
    if seating is None:
        return []
    names = [p.name for p in recipe.positions]
    nest = np.array([recipe.felt_vector(p) for p in recipe.positions])
    true = np.array([[recipe.true_vector(p, s) for p in recipe.positions] for s in seating.names])
    position = np.array([names.index(name) for name in table.position.names], np.intp)[table.position.code[begin]]
    unit, found = table.unit.code[begin], list[MisplacedVisit]()
    for u in np.unique(unit):
        own = np.flatnonzero(unit == u)
        at, called = true[seating.code[own]], true[seating.code[own], position[own]]
        read, there = _comparable(mean[own], at, called, spins=recipe.reference.source == "rate")
        off = np.linalg.norm(there - read[:, None], axis=2)
        far, near = off[np.arange(len(own)), position[own]] > FAR, off.min(axis=1) < NEAR
        odd = far
        if far.any():
            odd = _in_no_order(there[np.arange(len(own)), position[own]], read, table.run[begin[own]], far, near)
        nearest = np.argmin(off, axis=1)
        found += [
            MisplacedVisit(
                int(own[v]),
                names[nearest[v]],
                _turn(nest[nearest[v]], nest[position[own[v]]]),
                called[v],
                at[v, nearest[v]],
            )
            for v in np.flatnonzero(odd)
        ]
    return found


def _comparable(mean: Floats, at: Floats, called: Floats, *, spins: bool) -> tuple[Floats, Floats]:
    """Means of visits (v, 3) and what a perfect device reads at all positions (v, p, 3), in stimuli: directions about
    the middle of the readings; of spins, whose sizes differ, shares of the fastest, whatever the unit."""
    if not spins:
        return _directions(mean - sphere(mean)[0]), _directions(at)
    fastest, size = np.linalg.norm(at, axis=2).max(initial=1e-300), np.linalg.norm(called, axis=1)
    turning = size > 0.1 * fastest
    factor = np.median(np.linalg.norm(mean[turning], axis=1) / size[turning]) if turning.any() else 1.0
    return np.asarray(mean / max(factor * fastest, 1e-300)), np.asarray(at / fastest)


def _in_no_order(called: Floats, read: Floats, run: Ints, far: Marks, near: Marks) -> Marks:
    """Which visits (v) of a unit, of those far from their directions (v, 3) called and near another's, no other axes
    and no seating put where they are read (v, 3)."""
    odd = far & near
    if not near.all() and np.mean(~far) < MOST_AS_CALLED:
        return np.zeros_like(odd)
    if np.linalg.matrix_rank(_columns(called), 1e-6) < 4 or _mapping(called, read) is not None:
        return np.zeros_like(odd)
    for r in np.unique(run[odd]):
        rows = run == r
        turned = _mapping(called[rows], read[rows])
        if (
            turned is not None
            and np.linalg.matrix_rank(_columns(called[rows]), 1e-6) == 4
            and np.linalg.det(turned) > 0
        ):
            odd = odd & ~rows
    return odd


def _columns(called: Floats) -> Floats:
    return np.asarray(np.c_[called, np.ones(len(called))])


def _mapping(called: Floats, read: Floats) -> Floats | None:
    """The matrix (3, 3) that with one offset makes directions (v, 3) what is read (v, 3) in all visits: other axes, or
    a unit that sits turned; None where none does."""
    found = np.linalg.lstsq(_columns(called), read, rcond=None)[0]
    left = read - _columns(called) @ found
    return np.asarray(found[:3].T) if np.linalg.norm(left, axis=1).max() < MAPPED else None


def as_cause(table: SampleTable, found: list[MisplacedVisit]) -> GrossFault:
    """Visits of a table in order that read as another position, as the cause that they are."""
    begin, end = visit_boundaries(table)
    places = [where_is(table, int(begin[one.visit])) for one in found]
    labels = [f"visit:{at['serial']}/{at['run']}/{at['visit']}" for at in places]
    numbers = tuple(
        FaultParameter("angle", axis, label, float(one.angle[i]), ANGLE_STD, "rad")
        for one, label in zip(found, labels, strict=True)
        for i, axis in enumerate("xyz")
    )
    sentence = f"{len(found)} of {len(begin)} visits read as another position than they are called"
    gain = _gain([table.reading[begin[one.visit] : end[one.visit]] for one in found], found)
    return GrossFault("disturbed-visit", "visit", numbers, sentence, gain.total if gain else 0.0, gain=gain)


def _gain(readings: list[Floats], found: list[MisplacedVisit]) -> BlockGain | None:
    """By how much likelier readings (n, 3) of each visit are of the other position than of the one stated, by the means
    of its halves, axis by axis; nothing is fitted to them. None of one visit of one reading."""
    halves = [(one, part.mean(axis=0)) for one, own in zip(found, readings, strict=True) for part in _halves(own)]
    called, other = (np.array([getattr(one, name) for one, _ in halves]) for name in ("called", "other"))
    read = np.array([mean for _, mean in halves])
    before, after = read - called, read - other
    std = ANGLE_STD * max(float(np.linalg.norm([called, other], axis=2).max()), 1e-300)
    # The halves share the sensor's own offset and gain: both together count once.
    scores, moved = 0.25 * (before**2 - after**2) / std**2, np.abs(called - other) > std
    rms = float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2)))
    return block_gain(scores[moved], np.ones(np.count_nonzero(moved)), None, "visit", rms)


def _halves(own: Floats) -> list[Floats]:
    return [part for part in np.array_split(own, 2) if len(part)]


def _turn(read: Floats, called: Floats) -> Floats:
    """The rotation vector (3) that turns what is read (3) to what the position called after has (3); none where either
    is a rest."""
    if not (read.any() and called.any()):
        return np.zeros(3)
    turn = rotation.to_vector(rotation.shortest(_directions(read), _directions(called)))
    return np.asarray(np.round(turn, 9) + 0.0)


def _directions(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300))
