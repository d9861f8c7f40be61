"""The process data of a simulated device: readings by timer or SYNC, temperature, and the babble of a broken node."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from station.adapters.simulated_device.objects import SimulatedObjects
from station.adapters.simulated_device.stream import Correction, SignalChain, SimulatedSensor, Timer
from station.adapters.simulated_device.stream_faults import StreamFaults
from station.domain.can import encode
from station.domain.core.types import Floats, Frames
from station.ports.bus import Endpoint
from station.ports.clock import Clock

READINGS_TPDO, TEMPERATURE_TPDO = 0x1800, 0x1801
_OFF = 0x8000_0000
_EVENT_DRIVEN, _LAST_SYNCHRONOUS = 254, 240
_BABBLE_ID, _BABBLE_PERIOD_S = 0x001, 0.0002


class ProcessData:
    """Sends TPDO 1 and 2 as objects 0x1800 and 0x1801 say; a product without them sends at the sensor's rate.

    block_s: readings leave in blocks that end at its multiples, the same instants for every device. wakes_s: when
    somebody looks next: what is due before, by timer or SYNC, leaves together then.
    """

    def __init__(
        self,
        channel: Endpoint,
        clock: Clock,
        objects: SimulatedObjects,
        sensor: SimulatedSensor,
        faults: StreamFaults,
        *,
        block_s: float,
        wakes_s: Callable[[], float],
    ) -> None:
        self._channel = channel
        self._clock = clock
        self._objects = objects
        self._sensor = sensor
        self._faults = faults
        self._block_s, self._wakes_s = block_s, wakes_s
        self._requested_s: list[float] = []  # instants of SYNC whose readings have not left yet
        self._pdo = _pdo_of(objects, sensor)
        self._readings = SignalChain(sensor, faults)
        self._timer, self._slow_timer, self._babble = Timer(), Timer(), Timer()
        self._babble.start(faults.starts_s("babble"), _BABBLE_PERIOD_S)
        self._syncs = 0
        self.settled_s = 0.0
        self.last_payload = bytes(8)

    def next_due_s(self) -> float:
        """When something leaves next."""
        return min(
            self._block_end_s(self._timer.next_s), self._slow_timer.next_s, self._block_end_s(self._babble.next_s)
        )

    def settings(self) -> tuple[int, ...]:
        """The objects that the timers depend on: when they change, the timers start anew."""
        return tuple(
            self._objects.number(index, sub, 0) for index in (self._pdo, TEMPERATURE_TPDO) for sub in (1, 2, 5)
        )

    def start(self, now_s: float) -> None:
        """Starts the timers, as when the device becomes operational."""
        self._send_due(now_s)
        self._timer.start(now_s, self._period_s(self._pdo))
        self._slow_timer.start(now_s, self._period_s(TEMPERATURE_TPDO))

    def stop(self) -> None:
        """Sends no more by itself."""
        self._answer_sync(math.inf)
        self._send_due(self._clock.monotonic_s())
        self._timer.stop()
        self._slow_timer.stop()

    def on_sync(self, now_s: float) -> None:
        """A SYNC came: sends a reading where the transmission type says so (CiA 301, 7.5.2.37)."""
        kind = self._objects.number(self._pdo, 2, _EVENT_DRIVEN)
        self._syncs += 1
        if kind <= _LAST_SYNCHRONOUS and self._syncs % max(kind, 1) == 0 and not self._is_off(self._pdo):
            self._requested_s.append(now_s)
            self._answer_sync(now_s)

    def produce(self, now_s: float) -> None:
        """Sends all that is due until now."""
        self._answer_sync(now_s)
        if now_s >= min(self._wakes_s(), self._block_end_s(self._timer.next_s)):
            self._send_due(now_s)
        if len(times_s := self._slow_timer.due(now_s)):
            shown = np.array([self.temperature(t) for t in times_s.tolist()])
            node = self._objects.dictionary.node
            self._send(encode.temperature_frames(self._sensor.layout, node, self._epoch_ns(times_s), shown))
        if len(times_s := self._babble.due(now_s)):
            n = len(times_s)
            ids, lengths = np.full(n, _BABBLE_ID, np.uint32), np.full(n, 8, np.uint8)
            self._send(Frames(self._epoch_ns(times_s), ids, lengths, np.zeros((n, 8), np.uint8)))

    def temperature(self, at_s: float) -> float:
        """What the thermometer shows at an instant, degC."""
        return self._faults.temperature(self._sensor.temperature(at_s), at_s)

    def counts(self, at_s: float, correction: Correction) -> NDArray[np.int64]:
        """The reading at an instant, as the integers (3) of its signals."""
        raw = self._readings.raw(np.array([at_s]))
        return np.asarray(self._readings.counts(self._readings.corrected(raw, correction))[0])

    def _answer_sync(self, now_s: float) -> None:
        """Readings that SYNC asked for, as soon as anybody looks."""
        if self._requested_s and now_s >= self._wakes_s():
            requested_s, self._requested_s = np.array(self._requested_s), []
            self._send_readings(requested_s)

    def _send_due(self, now_s: float) -> None:
        """Readings of the timer's instants until now."""
        if len(times_s := self._timer.due(now_s)):
            self._send_readings(times_s)

    def _send_readings(self, times_s: Floats) -> None:
        if self._faults.active("stream-stops", float(times_s[-1])):
            return
        frames = self._readings.frames(times_s, self._epoch_ns(times_s), self._objects.correction(), self.settled_s)
        if len(frames):
            self.last_payload = frames.data[-1].tobytes()
        self._send(frames)

    def _send(self, frames: Frames) -> None:
        if len(frames):
            self._channel.send_many(frames)

    def _period_s(self, pdo: int) -> float:
        """Period of a PDO; 0 when it does not send by itself."""
        if self._is_off(pdo) or self._objects.number(pdo, 2, _EVENT_DRIVEN) < _EVENT_DRIVEN:
            return 0.0
        rate_hz = self._sensor.rate_hz
        timer_ms = self._objects.number(pdo, 5, round(1000 / (rate_hz or 100)))
        # A rate such as 400 Hz is no whole number of milliseconds: it stands until another timer is written.
        exact = pdo == self._pdo and rate_hz is not None and timer_ms == round(1000 / rate_hz)
        period_s = 1 / rate_hz if exact and rate_hz else timer_ms / 1000
        return period_s / self._faults.speed(self._clock.monotonic_s())

    def _is_off(self, pdo: int) -> bool:
        return bool(self._objects.number(pdo, 1, 0) & _OFF)

    def _epoch_ns(self, times_s: Floats) -> NDArray[np.int64]:
        origin_ns = self._clock.epoch_ns() - round(self._clock.monotonic_s() * 1e9)
        return np.asarray(np.rint(times_s * 1e9).astype(np.int64) + origin_ns)

    def _block_end_s(self, next_s: float) -> float:
        if self._block_s <= 0 or math.isinf(next_s):
            return next_s
        return max(next_s, math.ceil(next_s / self._block_s) * self._block_s)


def _pdo_of(objects: SimulatedObjects, sensor: SimulatedSensor) -> int:
    """The PDO that carries the readings: the one with their identifier, else the first."""
    can_id = sensor.layout.id_of(sensor.layout.sample, objects.dictionary.node)
    numbers = range(READINGS_TPDO, READINGS_TPDO + 8)
    return next((n for n in numbers if objects.number(n, 1, 0) & 0x7FF == can_id), READINGS_TPDO)
