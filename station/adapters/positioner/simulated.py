"""A positioner that exists only in numbers: it turns at a limited rate and arrives with a small error."""

import math
from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.recipe.fields import NotNegative, Positive, StrictModel
from station.domain.recipe.moves import turn_s
from station.domain.recipe.plan import PlannedVisit
from station.errors import PositionerFault
from station.messages import Message
from station.ports.clock import Clock
from station.ports.positioner import MeasuredPose

#: Told of each move as it begins: the stop, when it departs and when it arrives, monotonic s.
MoveListener = Callable[[PlannedVisit, float, float], None]


class SimulatedPositioner:
    """Turns about the shortest way, with a trapezium of speed; where() is what its encoders say.

    moving: whoever simulates what stands on it learns of each move as it begins.

    positioner: {kind: simulated, speed_deg_s: 90, acceleration_deg_s2: 180, error_deg: 0.02, seed: 1}
    """

    by_hand = False
    turns_nothing = True

    class Settings(StrictModel):
        """error_deg: standard deviation of each arrival about each axis; fault: what breaks after `after` stops;
        encoder_lies: where() says what was asked for.
        """

        speed_deg_s: Positive = 90.0
        acceleration_deg_s2: Positive = 180.0
        error_deg: NotNegative = 0.0
        encoder_deg: NotNegative = 0.0
        seed: int = 1
        fault: Literal["none", "stuck", "slow", "wrong-place"] = "none"
        after: Annotated[int, Field(ge=0)] = 0
        encoder_lies: bool = False

    def __init__(
        self, settings: "SimulatedPositioner.Settings", clock: Clock, moving: MoveListener | None = None
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._moving = moving
        self._rng = np.random.default_rng(settings.seed)
        self._origin = np.eye(3)
        self._turn = np.zeros(3)
        self._began_s = self._arrives_s = clock.monotonic_s()
        self._moves = 0
        self._commanded = np.eye(3)

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Turns to the stop and waits until it is there; PositionerFault when that takes longer than `timeout_s`."""
        self.begin(stop)
        self._wait(timeout_s, Message("place-position", position=stop.position))

    def begin(self, stop: PlannedVisit) -> None:
        """Starts the turn to a stop and returns at once."""
        error = self._rng.normal(0.0, math.radians(self._settings.error_deg), 3)
        goal = rotation.from_vector(error) @ stop.nest
        if self._broken("wrong-place"):
            goal = rotation.about(np.array([1.0, 1.0, 0.0]), 90.0) @ goal
        self._moves += 1
        self._commanded = stop.nest
        self._go(goal, stop)

    def where(self) -> MeasuredPose:
        """As the encoders read it."""
        error = self._rng.normal(0.0, math.radians(self._settings.encoder_deg), 3)
        attitude = self._commanded if self._settings.encoder_lies else self.at(self._clock.monotonic_s())
        return MeasuredPose(np.asarray(rotation.from_vector(error) @ attitude))

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        """Time of the move by the trapezium of speed."""
        start = np.eye(3) if origin is None else origin.nest
        return self._duration_s(_angle_deg(rotation.to_vector(stop.nest @ start.T)))

    def park(self, timeout_s: float) -> None:
        """Turns back to the identity, where units are loaded."""
        self._go(np.eye(3), None)
        self._wait(timeout_s, Message("place-parking"))

    def plate(self, time_s: Floats) -> Floats:
        """True nest → station rotations (n, 3, 3) at instants (n) of the clock's monotonic seconds, from the last
        move on."""
        took = self._arrives_s - self._began_s
        share = np.ones(len(time_s)) if took <= 0 else np.clip((time_s - self._began_s) / took, 0.0, 1.0)
        smooth = share * share * (3 - 2 * share)
        return np.asarray(rotation.from_vector(smooth[:, None] * self._turn) @ self._origin)

    def at(self, time_s: float) -> Floats:
        """True nest → station rotation (3, 3) at one instant."""
        return np.asarray(self.plate(np.array([time_s]))[0])

    def _go(self, goal: Floats, stop: PlannedVisit | None) -> None:
        now_s = self._clock.monotonic_s()
        self._origin = self.at(now_s)
        self._turn = rotation.to_vector(goal @ self._origin.T)
        took_s = self._duration_s(_angle_deg(self._turn)) * (1000.0 if self._broken("slow") else 1.0)
        if self._broken("stuck"):
            self._turn, took_s = np.zeros(3), math.inf
        self._began_s, self._arrives_s = now_s, now_s + took_s
        if stop is not None and self._moving is not None:
            self._moving(stop, self._began_s, self._arrives_s)

    def _wait(self, timeout_s: float, place: Message) -> None:
        took_s = self._arrives_s - self._began_s
        self._clock.sleep(min(took_s, timeout_s))
        if took_s > timeout_s:
            self._origin, self._turn = self.at(self._clock.monotonic_s()), np.zeros(3)
            raise PositionerFault("positioner-timed-out", place=place, timeout_s=timeout_s)

    def _broken(self, how: str) -> bool:
        return self._settings.fault == how and self._moves > self._settings.after

    def _duration_s(self, angle_deg: float) -> float:
        """Trapezium, or triangle where full speed is never reached."""
        return float(turn_s(np.array(angle_deg), self._settings.speed_deg_s, self._settings.acceleration_deg_s2))


def _angle_deg(rotvec_rad: Floats) -> float:
    return math.degrees(float(np.linalg.norm(rotvec_rad)))
