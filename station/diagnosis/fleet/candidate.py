"""A cause at one group of a fleet, and how likely chance makes it look so strong."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln
from scipy.stats import chi2

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


def log_chance(test: float, rank: int) -> float:
    """Logarithm of P(χ² ≥ test), also where that is no number any more: (k/2 − 1) ln x − x − ln Γ(k/2), x = test/2
    (Abramowitz and Stegun, 6.5.32)."""
    found = float(chi2.logsf(test, rank))
    return found if np.isfinite(found) else (rank / 2 - 1) * np.log(test / 2) - test / 2 - float(gammaln(rank / 2))
