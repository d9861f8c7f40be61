"""The faults of a simulated device's stream: readings, counters and frames that are not as they should be."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station.adapters.simulated_device.device_fault import InjectedFault
from station.domain.can import encode
from station.domain.can.sensor_layout import SensorLayout
from station.domain.core.types import Array, Floats, Frames


class StreamFaults:
    """Applies those `faults` that concern the stream, from `born_s + after_s` on. Random choices repeat by node."""

    def __init__(self, faults: Sequence[InjectedFault], layout: SensorLayout, node: int, born_s: float) -> None:
        self._layout = layout
        self._node = node
        self._faults = {fault.kind: fault for fault in faults}
        self._born_s = born_s
        self._rng = np.random.default_rng([node, len(faults)])
        self._held: float | None = None
        self._frozen: float | None = None

    def active(self, kind: str, now_s: float) -> InjectedFault | None:
        """The fault of that kind, when there is one and its time has come."""
        fault = self._faults.get(kind)
        return fault if fault is not None and now_s - self._born_s >= fault.after_s else None

    def starts_s(self, kind: str) -> float:
        """Instant at which a fault of that kind begins; infinity when there is none."""
        fault = self._faults.get(kind)
        return np.inf if fault is None else self._born_s + fault.after_s

    def speed(self, now_s: float) -> float:
        """How much faster than it should the device's clock runs."""
        fault = self.active("clock-fast", now_s)
        return 1.0 + (fault.fraction if fault else 0.0)

    def temperature(self, value: float, now_s: float) -> float:
        """What the thermometer shows."""
        if self.active("thermometer-frozen", now_s) is None:
            return value
        if self._frozen is None:
            self._frozen = value
        return self._frozen

    def spoil_readings(self, readings: Floats, times_s: Floats) -> Floats:
        """Readings (n, 3) with an axis that stands still."""
        fault = self.active("stuck-axis", float(times_s[-1])) if len(times_s) else None
        if fault is None:
            return readings
        axis = int(fault.value) % 3
        if self._held is None:
            self._held = float(readings[0, axis])
        readings = readings.copy()
        readings[:, axis] = self._held
        return readings

    def encode(
        self,
        time_ns: NDArray[np.int64],
        readings: Floats,
        count: int,
        status: Array,
        times_s: Floats,
        temperature_degC: Array | float,
    ) -> Frames:
        """Frames of the readings, counted from `count` on unless the counter is stuck."""
        stuck = self.active("counter-stuck", float(times_s[-1])) is not None
        first, step = (0, 0) if stuck else (count, 1)
        if fault := self.active("status", float(times_s[-1])):
            status = status | int(fault.value)
        layout, node = self._layout, self._node
        return encode.sample_frames(
            layout, node, time_ns, readings, first_count=first, count_step=step, status=status,
            temperature_degC=temperature_degC,
        )  # fmt: skip

    def spoil_frames(self, frames: Frames, times_s: Floats) -> Frames:
        """Frames with wrong CRCs, lost, repeated, or out of order."""
        now_s = float(times_s[-1])
        if (fault := self.active("crc-errors", now_s)) and self._layout.map.e2e is not None:
            data = frames.data.copy()
            data[self._chosen(fault, len(frames)), self._layout.crc_byte] ^= 0x5A
            frames = Frames(frames.time_ns, frames.can_id, frames.length, data)
        if fault := self.active("frames-lost", now_s):
            frames = frames[~self._chosen(fault, len(frames))]
        if fault := self.active("frames-repeated", now_s):
            frames = frames[np.repeat(np.arange(len(frames)), 1 + self._chosen(fault, len(frames)))]
        if fault := self.active("frames-swapped", now_s):
            frames = self._swapped(frames, fault)
        return frames

    def _swapped(self, frames: Frames, fault: InjectedFault) -> Frames:
        """Payloads change places; the instants stay in order, as a receiver stamps them."""
        order = np.arange(len(frames))
        for i in np.flatnonzero(self._chosen(fault, max(len(frames) - 1, 0))):
            order[[i, i + 1]] = order[[i + 1, i]]
        return Frames(frames.time_ns, frames.can_id, frames.length[order], frames.data[order])

    def _chosen(self, fault: InjectedFault, count: int) -> NDArray[np.bool_]:
        return self._rng.random(count) < fault.fraction
