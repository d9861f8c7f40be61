"""The offset wanders at random: each visit adds a small step to those before.

reading_i gains the sum of the run's steps so far, this visit's included. It belongs to the noise floor.

>>> import numpy as np
>>> from station.model.scene import Signal
>>> BiasWalk.example().apply(Signal(None, np.zeros((1, 3)), None), np.array([[0.1, 0.0, 0.2]]))
array([[0.1, 0. , 0.2]])
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import Parameter, SensorEffect
from station.model.scene import Scene, Signal


@dataclass(frozen=True)
class BiasWalk(SensorEffect):
    """Standard deviation of a step; coefficients are the steps themselves, per visit and axis."""

    physics = "The offset wanders at random: each visit adds a small step to those before."
    remedy = "dwell longer, visit positions twice, and ask the supplier about low-frequency noise"
    shown_by = "return to one position within a run"
    drawn_over = "order"
    level = "device"
    of = ("visit",)
    parameter = Parameter("step_std", "u", 1e-5, 1e-6, 5e-5, "bias instability of 1–50 µg over seconds; unchecked")
    size: float = parameter.typical

    def apply(self, signal: Signal, c: Floats) -> Floats:
        """The walk so far."""
        return np.asarray(c + 0.0 * signal.true)

    def gather(self, scene: Scene, coefficients: Floats, level: str) -> Floats:
        """Steps (v, 3) summed up within each run."""
        walk = np.cumsum(super().gather(scene, coefficients, level), axis=0)
        before = np.concatenate([np.zeros((1, 3)), walk])
        start = np.maximum.accumulate(np.where(scene.visits.previous < 0, np.arange(len(walk)), 0))
        return np.asarray(walk - before[start])

    def gather_alike(self, scene: Scene, coefficient: Floats, level: str) -> Floats:
        """Steps of one size (n, 3) summed up within each run."""
        every = np.broadcast_to(coefficient, (len(scene.visits), len(coefficient)))
        return self.gather(scene, every, level)[scene.visit]

    def draw(self, groups: int, rng: np.random.Generator) -> Floats:
        """Normal steps (groups, 3)."""
        return np.asarray(self.size * rng.standard_normal((groups, 3)))

    def parameter_rows(self, names: Sequence[str], coefficients: Floats, unit: str) -> list[dict[str, object]]:
        """The standard deviation alone: the steps are noise."""
        del names, coefficients
        return [{"name": "step_std", "axis": None, "of": "common", "value": self.size, "unit": unit}]
