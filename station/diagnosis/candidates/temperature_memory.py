"""Temperatures with memory: what lags behind the thermometer, and what takes another branch while it rises.

A part of a package that is heated late follows a lag; stressed glue, plastic and solder return on another branch (play,
the element of Prandtl and Ishlinskii). Each run starts without memory of the one before.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats
from station.model.scene import Scene

#: Range of temperature below which nothing can be laid to it, degC.
MIN_TEMPERATURE_RANGE = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class TemperatureMemory:
    """Temperatures (v) of visits, degC, with the time of each, s, and the rows of each run."""

    temperature_degC: Floats
    time_s: Floats
    runs: tuple["slice[int, int, None]", ...]

    @staticmethod
    def of(scene: Scene) -> "TemperatureMemory | None":
        """Of a scene of one row a visit; None where no temperature changes within its runs."""
        T = scene.temperature_degC
        if T is None:
            return None
        found = TemperatureMemory(T, scene.time_s, tuple(scene.visits.run_slices()))
        return found if found.range_degC >= MIN_TEMPERATURE_RANGE else None

    @property
    def range_degC(self) -> float:
        """How far the temperature usually goes within a run."""
        return float(np.median([np.ptp(self.temperature_degC[rows]) for rows in self.runs]))

    @property
    def duration_s(self) -> float:
        """How long a run usually takes."""
        return float(np.median([np.ptp(self.time_s[rows]) for rows in self.runs]))

    def lagged(self, share: float) -> Floats:
        """Temperatures (v) behind a first-order lag of a share of a run's duration."""
        time_constant_s = max(share * self.duration_s, 1e-9)

        def follow(T: Floats, time_s: Floats) -> Floats:
            steps = -np.expm1(-np.diff(time_s) / time_constant_s)
            out = T.copy()
            for i, step in enumerate(steps):
                # Between two visits the temperature is taken as their mean.
                out[i + 1] = out[i] + step * ((T[i] + T[i + 1]) / 2 - out[i])
            return out

        return self._by_run(follow)

    def branch(self, share: float, start: float = 0.0) -> Floats:
        """−1 … 1 (v): how far the temperature leads what it drags with a play, a share of a run's range; start: the
        branch on which each run begins."""
        half_degC = 0.5 * share * self.range_degC

        def drag(T: Floats, _time_s: Floats) -> Floats:
            out = np.empty(len(T))
            dragged = T[0] - start * half_degC
            for i, now in enumerate(T):
                dragged = min(max(dragged, now - half_degC), now + half_degC)
                out[i] = (now - dragged) / half_degC
            return out

        return self._by_run(drag)

    def relay(self, off_degC: float, on_degC: float) -> Floats:
        """1 (v) from where the temperature is above one limit until it is below the lower one, otherwise 0; a run that
        begins between them begins on the side of the nearer one."""

        def switch(T: Floats, _time_s: Floats) -> Floats:
            out = np.empty(len(T))
            on = 2 * T[0] > off_degC + on_degC
            for i, now in enumerate(T):
                on = now > (off_degC if on else on_degC)
                out[i] = on
            return out

        return self._by_run(switch)

    def _by_run(self, course: Callable[[Floats, Floats], Floats]) -> Floats:
        found = np.zeros(len(self.temperature_degC))
        for rows in self.runs:
            found[rows] = course(self.temperature_degC[rows], self.time_s[rows])
        return found
