"""Kernels of how the rig came to a visit: the direction of the turn, the path so far, and what remains of earlier
visits.

A dragged cable pulls by the sign of the turn and winds up with it; a gear leans against the flank that it drives;
grease, glue and rubber forget over several visits, and so does what the motors heated or shook loose.
"""

from collections.abc import Iterator

import numpy as np
from numpy.polynomial import legendre

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.kernel_columns import each_axis, kernels_at, own_axis, scaled, steps_before
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.grid import VisitGrid
from station.domain.core import rotation
from station.domain.core.types import Floats
from station.model.effects.base_tilt import BaseTilt
from station.model.effects.nest_tilt import NestTilt

#: Shares of what one visit left that the next one keeps: of what was felt, of a long move, of what the motors did.
FELT_KEPT, MOVE_KEPT, MOTOR_KEPT = (0.5, 0.8), 0.6, (0.0, 0.75)
#: A move is long from this share of the longest.
LONG_MOVE = 0.8
#: Bends of what a cable does by how far it is wound up, and one more.
CABLE_DEGREE = 3
#: A turn about an axis below this is none, rad.
LEAST_TURN = 1e-6


def motion_kernels(view: ResidualView) -> Iterator[Candidate]:
    """Every kernel of the rig's motion that these data can show."""
    yield from _turns(view)
    yield from _memories(view)
    yield from _motor_before(view)


def _turns(view: ResidualView) -> Iterator[Candidate]:
    """Which way the rig turned about its axes, whether it reversed, how far it turned, and how far it is wound up about
    each axis; and how base and nests lean with it."""
    if not view.scene.recipe.pose_known:
        return
    turn = turns_of(view)
    way, wound = way_of(turn), _wound_up(turn, view)
    # A cable winds up about one axis, and is bent by that in any way.
    bent = [legendre.legvander(scaled(x), CABLE_DEGREE)[:, 1:] for x in wound.T if np.ptp(x) > LEAST_TURN]
    for functions in (way, _reversals(way, view), *bent):
        if np.any(functions):
            yield from kernels_at(view, "order", each_axis(functions), "unit", "common")
    # How far it turned: a cable in one nest drags as in no other.
    angle = np.linalg.norm(turn, axis=1)[:, None]
    yield from kernels_at(view, "order", each_axis(angle), "unit", "nest", "common")
    yield from kernels_at(view, "order", each_axis(angle**2), "unit", "common")
    base, nest = (view.signature(cause.example(), "common")[0] for cause in (BaseTilt, NestTilt))
    for tilt, functions, levels in ((base, way, ()), (base, wound, ()), (nest, way, ("nest",))):
        leaning = np.einsum("via,vk->viak", tilt, functions).reshape(len(way), 3, -1)
        yield from kernels_at(view, "order", leaning, *levels, "common")


def turns_of(view: ResidualView) -> Floats:
    """Rotation vectors (v, 3), rad, of the moves in the station's frame; zero at the first visit of a run."""
    R, previous = view.scene.visits.nest_R, view.scene.visits.previous
    return np.where(previous[:, None] >= 0, rotation.to_vector(R @ R[previous].transpose(0, 2, 1)), 0.0)


def way_of(turn: Floats) -> Floats:
    """The signs of turns about each axis, zero where there is none."""
    return np.asarray(np.sign(turn) * (np.abs(turn) > LEAST_TURN))


def _reversals(way: Floats, view: ResidualView) -> Floats:
    """The direction (v, 3) where it differs from that of the last turn about the same axis, otherwise zero."""
    grid = VisitGrid(view.grid.slot, 1)
    ways = grid.spread(way[:, None])
    # Of each visit the last one up to it that turned about an axis; −1 where none did.
    turned = np.where(ways != 0, np.arange(ways.shape[2])[:, None], -1)
    last = np.maximum.accumulate(turned, axis=2)[:, :, :-1]
    before = np.where(last >= 0, np.take_along_axis(ways, np.maximum(last, 0), axis=2), 0.0)
    reversed_ = np.zeros_like(ways)
    reversed_[:, :, 1:] = ways[:, :, 1:] * (ways[:, :, 1:] * before < 0)
    return grid.gathered(reversed_)


def _wound_up(turn: Floats, view: ResidualView) -> Floats:
    """Turns (v, 3) summed up over each run."""
    return remembered(turn, view, 1.0)


def _memories(view: ResidualView) -> Iterator[Candidate]:
    """What each axis felt at earlier visits, how far these were, and whether they were far, the most recent weighing
    most."""
    a, previous = view.nominal_stimulus, view.scene.visits.previous
    came = steps_before(view, a)
    felt = [own_axis(remembered(np.where(previous[:, None] >= 0, a[previous], 0.0), view, kept)) for kept in FELT_KEPT]
    yield from kernels_at(view, "order", np.concatenate(felt, axis=2), "unit", "common")
    length = np.linalg.norm(came, axis=1)[:, None]
    for moved in (length, (length > LONG_MOVE * length.max(initial=0.0)).astype(float)):
        yield from kernels_at(view, "order", each_axis(remembered(moved, view, MOVE_KEPT)), "unit", "common")


def _motor_before(view: ResidualView) -> Iterator[Candidate]:
    """The motors' drive at the previous visit, and at all earlier ones."""
    motor, previous = view.scene.motor, view.scene.visits.previous
    if motor is None or not np.ptp(motor):
        return
    before = np.where(previous >= 0, motor[previous] - motor.mean(), 0.0)[:, None]
    functions = np.concatenate([remembered(before, view, kept) for kept in MOTOR_KEPT], axis=1)
    yield from kernels_at(view, "motor", each_axis(functions), "unit", "common")


def remembered(values: Floats, view: ResidualView, kept: float) -> Floats:
    """Values (v, f) that decay by a factor `kept` from each visit to the next of its run."""
    grid = VisitGrid(view.grid.slot, 1)
    found, reach = grid.spread(values[:, None]).copy(), 1
    # What the last visits leave, then what twice as many do.
    while reach < found.shape[2]:
        found[:, :, reach:] += kept**reach * found[:, :, :-reach]
        reach *= 2
    return grid.gathered(found)
