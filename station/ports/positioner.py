"""What turns the fixture: one positioner carries all nests."""

from dataclasses import dataclass
from typing import Protocol

from station.domain.core.types import Floats
from station.domain.recipe.plan import PlannedVisit


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPose:
    """Where a positioner itself says it stands. attitude: nest → station rotation (3, 3); angles_deg: what the encoders
    of its axes read, outer axis first; empty for one without axes."""

    attitude: Floats
    angles_deg: tuple[float, ...] = ()


class Positioner(Protocol):
    """Moves the fixture from stop to stop. Errors: PositionerFault when stuck, late or at the wrong place."""

    @property
    def by_hand(self) -> bool:
        """True when a person turns the fixture: the run then waits for the right face in the frames."""

    @property
    def turns_nothing(self) -> bool:
        """True when it is simulated: units on a wire are refused then."""

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        """Brings the fixture to a stop and returns when it is there (by hand: asks for it and returns at once)."""

    def where(self) -> MeasuredPose | None:
        """Where it stands by its own measure; None when it cannot tell."""

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        """Time the move is expected to take, s; origin None is the parked place."""

    def park(self, timeout_s: float) -> None:
        """Brings the fixture to its safe place, from wherever it is; called whatever happened before."""
