"""The fixture of a simulated PLC: it turns about the shortest way with a trapezium of speed, and stops where it is."""

import math
from dataclasses import dataclass

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.recipe.moves import ACCELERATION_DEG_S2, SPEED_DEG_S, turn_s


@dataclass(slots=True)
class TurningFixture:
    """Attitudes are nest → station rotations (3, 3); instants are s of one clock."""

    speed_deg_s: float
    acceleration_deg_s2: float
    origin: Floats
    turn: Floats
    began_s: float = 0.0
    arrives_s: float = 0.0

    @staticmethod
    def at_rest(speed_deg_s: float = SPEED_DEG_S, acceleration_deg_s2: float = ACCELERATION_DEG_S2) -> "TurningFixture":
        """Parked."""
        return TurningFixture(speed_deg_s, acceleration_deg_s2, np.eye(3), np.zeros(3))

    def start(self, goal: Floats, now_s: float, slower: float = 1.0) -> None:
        """Turns to `goal` from now on; slower: by so much."""
        self.origin = self.attitude(now_s)
        self.turn = rotation.to_vector(goal @ self.origin.T)
        angle_deg = math.degrees(float(np.linalg.norm(self.turn)))
        took_s = float(turn_s(np.array(angle_deg), self.speed_deg_s, self.acceleration_deg_s2)) * slower
        self.began_s, self.arrives_s = now_s, now_s + took_s

    def stop(self, now_s: float) -> None:
        """Stands where it is."""
        self.origin, self.turn = self.attitude(now_s), np.zeros(3)
        self.began_s = self.arrives_s = now_s

    def moving(self, now_s: float) -> bool:
        """Whether it is on its way."""
        return self.began_s <= now_s < self.arrives_s

    def attitude(self, now_s: float) -> Floats:
        """Where it is."""
        return np.asarray(self.attitudes(np.array([now_s]))[0])

    def attitudes(self, times_s: Floats) -> Floats:
        """Where it was (n, 3, 3) at instants (n) from the last start on."""
        took_s = self.arrives_s - self.began_s
        share = np.ones(len(times_s)) if took_s <= 0 else np.clip((times_s - self.began_s) / took_s, 0.0, 1.0)
        smooth = share * share * (3 - 2 * share)
        return np.asarray(rotation.from_vector(smooth[:, None] * self.turn) @ self.origin)
