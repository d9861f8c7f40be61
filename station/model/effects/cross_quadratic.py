"""The reading has a term in the product of its own axis and another: a side load changes the gain.

reading_i gains c · a_i · a_j; axis x:y means on x, of x · y. At six faces one of them is 0.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> c = np.array([[0.1, 0.0, 0.0, 0.0, 0.2, 0.0]])
>>> CrossQuadratic.example().apply(Signal(None, np.array([[0.5, 0.5, 0.5]]), None), c)
array([[0.025, 0.   , 0.05 ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class CrossQuadratic(SensorEffect):
    """Coefficient of a_i · a_j, per unit and pair."""

    physics = "The reading has a term in the product of its own axis and another: a side load changes the gain."
    remedy = "add the product of two axes to the compensation, or ask the supplier about the lot"
    shown_by = "add positions at edges and corners: at six faces the product is zero"
    drawn_over = "input-product"
    level = "device"
    of = ("unit", "common")
    axes = ("x:y", "x:z", "y:x", "y:z", "z:x", "z:y")
    parameter = Parameter(
        "coefficient", "1/u", 1e-4, 1e-5, 2e-4, "cross-coupling terms of IEEE 1293, 10–200 µg/g²; unchecked"
    )
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c · a_i · a_j."""
        a = signal.true
        others = a[:, [[1, 2], [0, 2], [0, 1]]]
        return np.asarray((c.reshape(-1, 3, 2) * others).sum(axis=2) * a)
