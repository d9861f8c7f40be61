"""What a simulated device sends by itself: readings and temperature as frames, made in bulk."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.adapters.simulated_device.stream_faults import StreamFaults
from station.domain.can import encode, signals
from station.domain.can.sensor_layout import SensorLayout
from station.domain.core.types import Array, Floats, Frames

Sense = Callable[[Floats], Floats]
Correction = tuple[Floats, Floats] | None

#: Bits of the status nibble, as the DBC describes them.
CLIPPED, COMPENSATED, UNSETTLED = 2, 4, 8
_NO_INSTANTS = np.zeros(0)
_ENDLESS = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True)
class SimulatedSensor:
    """The physical side of a device.

    layout: of its frames; sense: instants (n), monotonic s → readings (n, 3) in the layout's unit, uncompensated;
    temperature: instant → degC; rate_hz: of the readings, None: as the EDS says.
    """

    layout: SensorLayout
    sense: Sense
    temperature: Callable[[float], float]
    rate_hz: float | None = None


class Timer:
    """Instants `period_s` apart; none while it is stopped."""

    def __init__(self) -> None:
        self.next_s = math.inf
        self._period_s = math.inf

    def start(self, now_s: float, period_s: float) -> None:
        """First instant one period from now; a period of 0 stops it."""
        self._period_s = period_s
        self.next_s = now_s + period_s if period_s > 0 else math.inf

    def stop(self) -> None:
        """No more instants."""
        self.next_s = math.inf

    def due(self, until_s: float) -> Floats:
        """Instants (n) up to `until_s`, in order, that have not been given yet."""
        if until_s < self.next_s:
            return _NO_INSTANTS
        count = int((until_s - self.next_s) / self._period_s + 1e-6) + 1
        times_s = self.next_s + self._period_s * np.arange(count)
        self.next_s = float(times_s[-1]) + self._period_s
        return np.asarray(np.minimum(times_s, until_s))


class SignalChain:
    """The sensor: senses, quantises like its converter, compensates if told to, counts, protects, and may be spoiled.

    faults: what is wrong with it.
    """

    def __init__(self, sensor: SimulatedSensor, faults: StreamFaults) -> None:
        self._layout, self._axes = sensor.layout, sensor.layout.axes
        self._limits = np.array([_ENDLESS if axis.is_float else axis.raw_limits() for axis in self._axes])
        self._sense, self._temperature_at = sensor.sense, sensor.temperature
        self._faults = faults
        self._count = 0

    def raw(self, times_s: Floats) -> Floats:
        """Readings (n, 3) as the converter gives them: multiples of its step, within its range; 0 for no axis."""
        return self._physical(self._converted(times_s))

    def corrected(self, raw: Floats, correction: Correction) -> Floats:
        """matrix⁻¹ · (raw − offset) for readings (n, 3), in the output's own steps; raw when there is no correction."""
        if correction is None:
            return raw
        offset, matrix = correction
        return self._physical(self.counts(np.asarray(np.linalg.solve(matrix, (raw - offset).T).T, np.float64)))

    def counts(self, readings: Floats) -> Array:
        """Readings (n, 3) as raw values (n, axes) of their signals: integers, unless the DBC sends floats."""
        columns = zip(readings.T, self._axes, strict=False)
        return np.stack([encode.to_raw(values, axis) for values, axis in columns], axis=1)

    def frames(self, times_s: Floats, time_ns: NDArray[np.int64], correction: Correction, settled_s: float) -> Frames:
        """One frame for each instant. settled_s: before it the status says that the sensor has not settled."""
        if not len(times_s):
            return Frames.empty()
        counts = self._converted(times_s)
        readings = self.corrected(self._physical(counts), correction)
        status = (
            CLIPPED * self._clipped(counts) + COMPENSATED * (correction is not None) + UNSETTLED * (times_s < settled_s)
        )
        frames = self._faults.encode(time_ns, readings, self._count, status, times_s, self._temperature(times_s))
        self._count = (self._count + len(times_s)) % self._layout.counter_values
        return self._faults.spoil_frames(frames, times_s)

    def _temperature(self, times_s: Floats) -> Array | float:
        """degC (n) where the readings' message shows it."""
        if not self._layout.temperature_rides:
            return 0.0
        return np.array([self._faults.temperature(self._temperature_at(t), t) for t in times_s.tolist()])

    def _converted(self, times_s: Floats) -> Array:
        return self.counts(self._faults.spoil_readings(np.asarray(self._sense(times_s), float), times_s))

    def _physical(self, counts: Array) -> Floats:
        found = np.zeros((len(counts), 3))
        for column, (values, axis) in enumerate(zip(counts.T, self._axes, strict=True)):
            found[:, column] = signals.physical(values, axis)
        return found

    def _clipped(self, counts: Array) -> NDArray[np.bool_]:
        low, high = self._limits.T
        return np.asarray(((counts <= low) | (counts >= high)).any(axis=1))
