"""How the simulated line works: its pace, its crew, its room."""

from dataclasses import dataclass

import numpy as np

from station.domain.recipe.moves import ACCELERATION_DEG_S2, SPEED_DEG_S, turn_s


@dataclass(frozen=True, slots=True)
class SimulatedLine:
    """How the simulated line works. Its numbers are those of an ordinary bench; none of them is a defect.

    A unit that goes round again sits in the next nest, and the operators take turns, as a line must do that wants
    to tell the nest from the unit. The room wanders by `wander_degC` (rms) over minutes to hours; a powered unit
    warms itself by `heating_degC` with `heating_tau_s`. A move has a trapezoidal speed.
    """

    nests: int = 2
    stations: int = 1
    lots: int = 2
    operators: int = 2
    speed_deg_s: float = SPEED_DEG_S
    acceleration_deg_s2: float = ACCELERATION_DEG_S2
    changeover_s: float = 45.0
    power_lead_s: float = 2.0
    clamp_lead_s: float = 5.0
    room_degC: float = 24.0
    wander_degC: float = 0.3
    heating_degC: float = 2.5
    heating_tau_s: float = 600.0

    def move_s(self, angle_deg: float) -> float:
        """Duration of a turn: ramps up, runs, ramps down."""
        return float(turn_s(np.array(angle_deg), self.speed_deg_s, self.acceleration_deg_s2))
