"""Commissioning of a rig: slow moves, readings of the units, and what they say of the mounting. The face prints it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from station.domain.core.types import Floats
from station.domain.rig import commissioning
from station.domain.rig.commissioning import DriveStep, MountingFit, Reading
from station.domain.rig.rig_map import RigMap
from station.errors import PositionerFault
from station.messages import Message

#: Speed of commissioning, degrees/s: a person can reach the emergency stop.
SLOW_DEG_S = 15.0
#: Acceleration over speed, 1/s.
_SHARPNESS = 4.0
MOVE_S = 120.0


class TurningRig(Protocol):
    """A rig of drives, as commissioning commands it."""

    def turn_to(self, angles_deg: tuple[float, ...], timeout_s: float) -> None:
        """Turns the axes to angles of its map. Errors: PositionerFault."""

    def park(self, timeout_s: float) -> None:
        """Brings it to its parking place and takes the power away."""

    def prove_watch(self) -> None:
        """Shows that the drives stop when the station falls silent. Errors: PositionerFault."""

    def close(self) -> None:
        """Leaves the bus."""


@dataclass(frozen=True, slots=True)
class RigCheck:
    """What commissioning found. findings: what is wrong, none where all is well; corrected: the map as it should be."""

    rig: RigMap
    steps: tuple[DriveStep, ...]
    fit: MountingFit
    findings: tuple[Message, ...]
    corrected: RigMap


def slow(rig: RigMap, speed_deg_s: float) -> RigMap:
    """The map with the speed of commissioning."""
    axes = [
        axis.model_copy(
            update={
                "speed_deg_s": min(speed_deg_s, axis.speed_deg_s),
                "acceleration_deg_s2": min(_SHARPNESS * speed_deg_s, axis.acceleration_deg_s2),
            }
        )
        for axis in rig.axes
    ]
    return commissioning.with_axes(rig, axes)


def check_rig(
    rig: RigMap,
    make: Callable[[RigMap], TurningRig],
    read: Callable[[], Mapping[str, Floats]],
    tell: Callable[[Message], None] = lambda _: None,
    speed_deg_s: float = SLOW_DEG_S,
) -> RigCheck:
    """Commissions a rig. make: positioner of a map; read: mean reading (3) in g of each unit, in the frame of its nest.

    Errors: PositionerFault where it does not move as commanded, or gravity does not show what a drive turned.
    """
    steps = _steps(rig, make(slow(rig, speed_deg_s)), read, tell)
    by_steps = commissioning.corrected_by_steps(rig, steps)
    fit = _fit(by_steps, make(slow(by_steps, speed_deg_s)), read, tell)
    found = commissioning.findings(by_steps, steps, fit)
    return RigCheck(rig, steps, fit, found, commissioning.corrected_by_fit(by_steps, fit))


def _steps(
    rig: RigMap, turning: TurningRig, read: Callable[[], Mapping[str, Floats]], tell: Callable[[Message], None]
) -> tuple[DriveStep, ...]:
    """One small step of each drive, there and back."""
    try:
        home = rig.park_deg
        turning.turn_to(home, MOVE_S)
        start: Reading = home, read()
        after: list[Reading] = []
        for number, axis in enumerate(rig.axes):
            tell(Message("rig-check-step", axis=axis.name, angle_deg=commissioning.STEP_DEG))
            goal = tuple(a + commissioning.STEP_DEG * (i == number) for i, a in enumerate(home))
            turning.turn_to(goal, MOVE_S)
            after.append((goal, read()))
            turning.turn_to(home, MOVE_S)
        tell(Message("rig-check-watch"))
        turning.prove_watch()
    finally:
        turning.close()
    steps = commissioning.steps_of(rig, start, after)
    if steps is None:
        raise PositionerFault("rig-check-blind")
    return steps


def _fit(
    rig: RigMap, turning: TurningRig, read: Callable[[], Mapping[str, Floats]], tell: Callable[[Message], None]
) -> MountingFit:
    """Slowly all around, and parked."""
    try:
        readings: list[Reading] = []
        for pose in commissioning.poses_of(rig):
            tell(Message("rig-check-pose", angles=pose))
            turning.turn_to(pose, MOVE_S)
            readings.append((pose, read()))
        turning.park(MOVE_S)
    finally:
        turning.close()
    return commissioning.fit_mounting(rig, readings)
