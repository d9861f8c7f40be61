"""The last proof: what the device itself puts out, corrected by its own new coefficients, against the truth."""

from dataclasses import dataclass

import numpy as np

from station.domain.recipe import Recipe
from station.domain.types import Floats, Reason


@dataclass(frozen=True, slots=True, eq=False)
class Verified:
    """One verify position: mean (3) of the compensated output, true (3) stimulus (NaN where the pose is unknown)
    and its magnitude, in the recipe's unit."""

    position: str
    mean: Floats
    true: Floats
    strength: float

    @property
    def error(self) -> float:
        """Length of the difference, in the recipe's unit; of the magnitudes where the pose is unknown."""
        if not np.isfinite(self.true).all():
            return abs(float(np.linalg.norm(self.mean)) - self.strength)
        return float(np.linalg.norm(self.mean - self.true))


def check(verified: tuple[Verified, ...], recipe: Recipe) -> tuple[Reason, ...]:
    """A reason for each verify position whose error is beyond the recipe's limit."""
    limit = recipe.verify.limit
    if limit is None:
        return ()
    return tuple(
        Reason(
            "verify",
            f"at {v.position!r} the device's own output is {v.error:.3g} {recipe.unit} off, more than {limit:g}",
            v.error,
            limit,
            recipe.unit,
        )
        for v in verified
        if not v.error <= limit
    )
