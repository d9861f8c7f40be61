"""The room and the warm device: temperature, its rate, and the clocks that causes run on."""

from functools import cache
from typing import NamedTuple, TypedDict

import numpy as np

from station.domain.core.types import Array, Floats
from station.model.effect import random_stream
from station.model.simulated_line import SimulatedLine

#: Angular frequencies of the room, rad/s: waves of 10 minutes to 8 hours.
ROOM_WAVES_RAD_S = 2 * np.pi / np.geomspace(600.0, 28800.0, 5)


class Climate(TypedDict):
    """Covariates of samples (n), as a Scene names them."""

    started_s: Floats
    since_power_s: Floats
    since_clamp_s: Floats
    temperature_degC: Floats
    temperature_rate: Floats


class Swing(NamedTuple):
    """Warming by size_degC (n) up to the middle of runs of length_s (n), and cooling up to their end: a sin²."""

    size_degC: Array
    length_s: Array

    def value(self, time_s: Floats) -> Floats:
        """How much warmer it is (n), degC, at times from the start of the run."""
        return np.asarray(self.size_degC * np.sin(np.pi * self._share(time_s)) ** 2)

    def rate(self, time_s: Floats) -> Floats:
        """How fast it warms (n), degC/s."""
        return np.asarray(self.size_degC * np.pi / self.length_s * np.sin(2 * np.pi * self._share(time_s)))

    def _share(self, time_s: Floats) -> Floats:
        return np.clip(time_s / self.length_s, 0.0, 1.0)


def climate(
    time_s: Floats,
    started_s: Floats,
    powered_s: Array,
    clamped_s: Array,
    offset_degC: Array,
    swing: Swing,
    *,
    line: SimulatedLine,
    seed: int,
) -> Climate:
    """What holds for samples (n) at time_s from the start of a run that started at started_s (n).

    powered_s, clamped_s, offset_degC (n): how long before the run's start the unit was powered and clamped, and how
    much warmer it is kept; swing: how it is warmed and cools beside that.
    """
    powered = time_s + powered_s
    room_degC, drift = room_temperature(time_s + started_s, line, seed)
    remaining_degC = line.heating_degC * np.exp(-powered / line.heating_tau_s)
    return Climate(
        started_s=started_s,
        since_power_s=powered,
        since_clamp_s=time_s + clamped_s,
        temperature_degC=room_degC + offset_degC + swing.value(time_s) + line.heating_degC - remaining_degC,
        temperature_rate=drift + swing.rate(time_s) + remaining_degC / line.heating_tau_s,
    )


def room_temperature(time_s: Floats, line: SimulatedLine, seed: int) -> tuple[Floats, Floats]:
    """Room temperature (n), degC, and its rate, degC/s: a few slow waves."""
    size = line.wander_degC * np.sqrt(2 / len(ROOM_WAVES_RAD_S))
    temperature, rate = np.full(len(time_s), line.room_degC), np.zeros(len(time_s))
    for w, p in zip(ROOM_WAVES_RAD_S, _phases_rad(seed), strict=True):
        temperature += size * np.sin(w * time_s + p)
        rate += size * w * np.cos(w * time_s + p)
    return temperature, rate


@cache
def _phases_rad(seed: int) -> tuple[float, ...]:
    """Where each of the room's waves begins."""
    return tuple(random_stream(seed, "room").uniform(0, 2 * np.pi, len(ROOM_WAVES_RAD_S)).tolist())


def motor_level(seed: int, load: int, run: int, visit: int) -> float:
    """Drive level of the line's motors at one visit of one fixture load, where they are on: 0 … 1."""
    return round(float(random_stream(seed, "motor", load, run, visit).uniform()), 2)
