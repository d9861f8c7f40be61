"""All readings of one nest, operator, station or lot share an offset.

reading_i gains c_i of the group. Where a unit is always in the same group it is the same as the unit's own offset.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> GroupOffset.example().apply(Signal(None, np.zeros((2, 3)), None), np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]))
array([[0.1, 0. , 0. ],
       [0.2, 0. , 0. ]])
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Signal


@dataclass(frozen=True)
class GroupOffset(SensorEffect):
    """Offset, per nest (or operator, station, lot) and axis."""

    physics = "All readings of one nest, operator, station or lot share an offset."
    remedy = "measure the same unit at both places to find the one that is wrong"
    shown_by = "measure the same unit at both places, and record `station`, `nest`, `lot`, `operator`"
    drawn_over = "group"
    level = "rig"
    of = ("nest", "operator", "station", "lot")
    parameter = Parameter("offset", "u", 5e-4, 5e-5, 2e-3, "differences between seats and crews, .05–2 mg; unchecked")
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """c, wherever and whenever in that group."""
        return np.asarray(c + 0.0 * signal.true)
