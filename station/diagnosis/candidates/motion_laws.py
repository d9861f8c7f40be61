"""Laws of how the rig came to a visit: its place in the order, the direction of the turn, and the path so far."""

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np

from station.diagnosis.candidates.motion_kernels import LEAST_TURN, remembered, turns_of, way_of
from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Floats

#: Every so many visits something may come again, at any of them.
RETURNS = (3, 4, 5)
#: What sticks slips after so much turning, rad; moves beyond such angles are long, rad.
SLIPS, LONG_TURNS = (3.5, 4.2, 5.0, 6.0, 7.0, 8.5), (1.2, 1.7, 2.2)
#: Waves of what a cable does, in a radian that it is wound up.
CABLE_WAVES = (0.25, 0.35, 0.5, 0.7, 1.0)
#: Shares of what one visit left that the next one keeps, of what the motors did.
MOTOR_KEPT = (0.0, 0.5, 0.75)

#: Covariates, joined by *, and one function (v), or two of two phases, that are on every axis alike.
MotionLaw = tuple[str, tuple[Floats, ...]]


def motion_laws(view: ResidualView, curves: Mapping[str, Floats]) -> Iterator[MotionLaw]:
    """Every law of the rig's motion that these data can show. curves: a function (v) of each covariate."""
    yield from _places_in_order(view, curves)
    yield from _motor_before(view)
    if view.scene.recipe.pose_known:
        yield from _turns(view)


def _places_in_order(view: ResidualView, curves: Mapping[str, Floats]) -> Iterator[MotionLaw]:
    """What recurs every few visits, and what alternates in sign and grows with a covariate."""
    visit = view.scene.visits.visit
    for every in RETURNS:
        yield from (("order", (1.0 * (visit % every == first),)) for first in range(every))
    turn = np.where(visit % 2, -1.0, 1.0)
    yield "order", (turn,)
    yield from ((f"{name}*order", (turn * x,)) for name, x in curves.items())


def _motor_before(view: ResidualView) -> Iterator[MotionLaw]:
    """The motors' drive at earlier visits."""
    motor, previous = view.scene.motor, view.scene.visits.previous
    if motor is not None and np.ptp(motor) > 0:
        before = np.where(previous >= 0, motor[previous] - motor.mean(), 0.0)[:, None]
        yield from (("motor*order", (remembered(before, view, kept)[:, 0],)) for kept in MOTOR_KEPT)
        own = (motor - motor.mean())[:, None]
        yield from (("motor*order", (remembered(own, view, kept)[:, 0],)) for kept in MOTOR_KEPT[1:])


def _turns(view: ResidualView) -> Iterator[MotionLaw]:
    """Effects of the rig's turns, and of a cable that is wound up."""
    yield from (("order", (x,)) for x in functions_of_turns(view))
    wound = remembered(turns_of(view), view, 1.0)
    for x, waves in product((x for x in wound.T if np.ptp(x) > LEAST_TURN), CABLE_WAVES):
        yield "order", (np.cos(waves * x), np.sin(waves * x))


def functions_of_turns(view: ResidualView) -> Iterator[Floats]:
    """Functions (v) of how the rig turned: the way about each axis, and how far, moves that are long, and what sticks
    until it slips."""
    turn = turns_of(view)
    angle = np.linalg.norm(turn, axis=1)
    yield from (x for x in (*way_of(turn).T, *turn.T) if np.any(np.abs(x) > LEAST_TURN))
    for least in LONG_TURNS:
        yield from (np.maximum(angle - least, 0.0), np.minimum(angle, least), 1.0 * (angle > least))
    gone = remembered(angle[:, None], view, 1.0)[:, 0]
    yield from (gone % slip for slip in SLIPS)
