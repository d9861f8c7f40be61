"""A cause at one group of a fleet."""

from dataclasses import dataclass

from station.diagnosis.fleet.moments import FleetCell
from station.diagnosis.fleet.response import SharedCause
from station.domain.core.types import Floats


@dataclass(frozen=True, slots=True, eq=False)
class SharedCandidate:
    """A cause at one group. members (c): share of each cell's units in which it is at work; score (a): what those units
    say of its sizes; columns (r, a): whitened, None where they go with a covariate, `at` of the moments' columns."""

    cause: SharedCause
    level: str
    group: FleetCell
    members: Floats
    score: Floats
    columns: Floats | None
    at: slice
