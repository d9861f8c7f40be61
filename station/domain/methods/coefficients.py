"""The twelve coefficients of measured = matrix · true + offset: offset x y z, then the matrix row by row."""

import numpy as np

from station.domain.core.types import Floats

AXES = "xyz"

#: Names for people and files, in the order of a covariance.
NAMES = (
    *(f"offset {a}" for a in AXES),
    *(f"gain {a}" if a == b else f"cross-axis {a} from {b}" for a in AXES for b in AXES),
)

#: A perfect sensor.
NOMINAL = np.r_[np.zeros(3), np.eye(3).ravel()]

#: Which of the twelve are offsets, own gains and cross-axis gains.
OFFSETS = np.r_[np.ones(3, bool), np.zeros(9, bool)]
GAINS = np.r_[np.zeros(3, bool), np.eye(3, dtype=bool).ravel()]
CROSS = ~(OFFSETS | GAINS)


def unit_of(index: int, unit: str) -> str:
    """Unit of a coefficient: offsets in the recipe's unit, the rest are ratios."""
    return unit if index < 3 else "1"


def offset_of(theta: Floats) -> Floats:
    """Offsets (…, 3) of coefficients (…, 12)."""
    return theta[..., :3]


def matrix_of(theta: Floats) -> Floats:
    """Matrix (…, 3, 3) of coefficients (…, 12)."""
    return theta[..., 3:].reshape(*theta.shape[:-1], 3, 3)
