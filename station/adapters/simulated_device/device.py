"""A simulated device: a real CANopen slave on whatever bus it is given, with a sensor, flash, and faults on demand.

It is an actor: it lives in `act`, which takes the frames waiting for it and sends all that was due since the
last call. In simulated time the clock calls it; in real time `serve` does.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from station.adapters.simulated_device.device_fault import InjectedFault
from station.adapters.simulated_device.link import NO_REQUESTS, link_of, request_id_of
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.simulated_device.object_server import ObjectServer, SdoRequest
from station.adapters.simulated_device.objects import SimulatedObjects
from station.adapters.simulated_device.pdo import READINGS_TPDO, ProcessData
from station.adapters.simulated_device.sdo import Agenda, SdoService
from station.adapters.simulated_device.sdo_faults import SdoFaults
from station.adapters.simulated_device.sdo_server import SdoServer
from station.adapters.simulated_device.stream import SimulatedSensor, Timer
from station.adapters.simulated_device.stream_faults import StreamFaults
from station.adapters.simulated_device.template_server import TemplateServer
from station.adapters.simulated_device.uds_server import SeedKey, UdsServer
from station.domain.core.types import ERROR, REMOTE
from station.domain.product.device_map import AXES, DeviceMap, NumberObject
from station.domain.product.object_dictionary import Address, ObjectDictionary, Value
from station.domain.product.preset import preset_axes
from station.ports.bus import Endpoint
from station.ports.clock import Clock

BOOTING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
_NMT, _SYNC, _EMCY, _HEARTBEAT = 0x000, 0x080, 0x080, 0x700
_NMT_STATES = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL}
_START, _RESET_NODE, _RESET_COMMUNICATION = 0x01, 0x81, 0x82
_HEARTBEAT_TIME = 0x1017
_FIRST_MAPPING = 0x1A00
#: Between the emergencies of a storm.
_STORM_PERIOD_S = 0.001


@dataclass(frozen=True, slots=True)
class Timing:
    """How fast a device is. block_s: readings leave in blocks of about this length; 0: each at its instant."""

    turnaround_s: float = 0.001
    boot_s: float = 0.2
    flash_s: float = 0.35
    warm_up_s: float = 0.05
    block_s: float = 0.05


@dataclass(frozen=True, slots=True)
class _TimerObjects:
    """What heartbeat and PDO timers depend on, as of so many changes of the objects."""

    changes: int
    heartbeat_ms: int
    pdo: tuple[int, ...]


def received_ids(node: int, device_map: DeviceMap | None = None, node_of_dbc: int = 1) -> tuple[int, ...]:
    """Identifiers that the device's channel must receive: its requests, and of CANopen (no map says so) NMT, SYNC."""
    device_map = device_map or DeviceMap()
    request_id = request_id_of(device_map, node, node_of_dbc)
    if request_id == NO_REQUESTS:
        return ()
    return (_NMT, _SYNC, request_id) if device_map.protocol == "canopen" else (request_id,)


class SimulatedDevice:
    """One device with the node id of its `dictionary`.

    channel: its own endpoint on the bus; device_map: of its product; sensor: its physical side; serial: as the
    serial object keeps it; memory: what was saved; faults: what is wrong with it; key: of a UDS device that is locked;
    wakes_s: when somebody looks next at what it sends, in the past where that may be at any instant.
    """

    def __init__(
        self,
        channel: Endpoint,
        clock: Clock,
        dictionary: ObjectDictionary,
        device_map: DeviceMap,
        sensor: SimulatedSensor,
        *,
        serial: int | str,
        memory: NonVolatileMemory | None = None,
        timing: Timing = Timing(),
        faults: Sequence[InjectedFault] = (),
        key: SeedKey | None = None,
        wakes_s: Callable[[], float] = lambda: -math.inf,
    ) -> None:
        self.node = dictionary.node
        self.state = BOOTING
        self._channel = channel
        self._timing = timing
        self._now_s = self._born_s = clock.monotonic_s()
        self._powered = True
        self._heartbeat, self._beat_s = Timer(), -math.inf
        self._agenda, self._external_events = Agenda(), Agenda()
        self._sdo_faults = SdoFaults(faults)
        self._sensor = sensor
        self._stream_faults = StreamFaults(faults, sensor.layout, self.node, self._born_s)
        place = device_map.serial_object
        fixed: dict[Address, Value] = {} if place is None else {place.address: serial}
        entry = dictionary.entries.get((READINGS_TPDO, 5))
        if sensor.rate_hz and not (entry is not None and entry.default == 0):
            fixed[READINGS_TPDO, 5] = round(1000 / sensor.rate_hz)
        fixed |= {(f.index or 0, f.sub or 0): f.value for f in faults if f.kind == "holds"}
        self.objects = SimulatedObjects(
            dictionary,
            device_map,
            memory or NonVolatileMemory(),
            fixed=fixed,
            computed=self._computed(device_map),
            spoil=self._spoilt_value,
        )
        self._pdo = ProcessData(
            channel, clock, self.objects, sensor, self._stream_faults, block_s=timing.block_s, wakes_s=wakes_s
        )
        self._pdo.settled_s = self._now_s + timing.warm_up_s
        self._managed = device_map.protocol == "canopen"
        self._link = link_of(device_map, self.node, sensor.layout.map.node_of_dbc, channel.send)
        self._sdo = SdoService(
            self.objects,
            self._server(device_map, key),
            self,
            self._agenda,
            self._sdo_faults,
            turnaround_s=timing.turnaround_s,
            flash_s=timing.flash_s,
        )
        self._timed_by = _TimerObjects(-1, 0, ())
        self._plan(faults)
        self._agenda.at(self._now_s, self._boot_up)

    def next_due_s(self) -> float:
        """When it next does something by itself."""
        return min(self._agenda.next_s, self._external_events.next_s, self._heartbeat.next_s, self._pdo.next_due_s())

    def act(self, now_s: float) -> None:
        """Brings the device up to `now_s`: what was due, then what came in, then what is due by that."""
        self._now_s = now_s
        self._pdo.produce(now_s)
        self._run(now_s)
        frames = self._channel.receive(0.0)
        if not len(frames):
            return
        for can_id, length, data in zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True):
            self._hear(can_id, data[:length].tobytes())
        self._run(now_s)

    @property
    def is_operational(self) -> bool:
        """Whether it sends its readings."""
        return self.state == OPERATIONAL

    def reset(self, *, communication_only: bool = False) -> None:
        """Starts again, as after NMT reset: what was not saved is lost."""
        self._fall_silent()
        self.objects.start(communication_only=communication_only)
        self._agenda.at(self._now_s + self._timing.boot_s, self._boot_up)

    def cut_power(self, back_after_s: float) -> None:
        """Loses power; it comes back after that time, or never for 0."""
        self._fall_silent()
        self._powered = False
        if back_after_s > 0:
            self._external_events.at(self._now_s + back_after_s, self.power_on)

    def power_on(self) -> None:
        """Power comes back; the device boots."""
        self._powered = True
        self._pdo.settled_s = self._now_s + self._timing.warm_up_s
        self.reset()

    def send_answers(self, answers: tuple[bytes, ...], off: int = 0) -> None:
        """Sends answers; off: by how much the node id in them is wrong."""
        for answer in answers:
            self._link.answer(answer, off)

    def _server(self, device_map: DeviceMap, key: SeedKey | None) -> ObjectServer:
        if device_map.uds is not None:
            return UdsServer(self.objects, device_map.uds, key)
        if device_map.template is not None:
            return TemplateServer(self.objects, device_map.template, self.node)
        return SdoServer(self.objects)

    def _run(self, now_s: float) -> None:
        self._external_events.run(now_s)
        self._agenda.run(now_s)
        stopped = self._stream_faults.active("heartbeat-stops", now_s)
        if len(self._heartbeat.due(now_s)) and not stopped and self._managed and not self._slow(now_s):
            self._channel.send(_HEARTBEAT + self.node, bytes([self.state]))
            self._beat_s = now_s

    def _slow(self, now_s: float) -> bool:
        fault = self._stream_faults.active("heartbeat-slow", now_s)
        return fault is not None and now_s < self._beat_s + fault.seconds

    def _fall_silent(self) -> None:
        self.state = BOOTING
        self._agenda.clear()
        self._sdo.reset()
        self._pdo.stop()
        self._heartbeat.stop()

    def _boot_up(self) -> None:
        silent = self._sdo_faults.fires("no-boot-up", SdoRequest(0, 0, "write", starts=False, segment=False))
        if not self._managed:
            if not silent:
                self._obey(_START)
            return
        self.state = PRE_OPERATIONAL
        if not silent:
            self._channel.send(_HEARTBEAT + self.node, bytes([BOOTING]))
        self._start_heartbeat()

    def _start_heartbeat(self) -> None:
        self._heartbeat.start(self._now_s, self.objects.number(_HEARTBEAT_TIME, 0, 0) / 1000)

    def _hear(self, can_id: int, data: bytes) -> None:
        if not self._powered or self.state == BOOTING or can_id & (ERROR | REMOTE):
            return
        if can_id == self._link.request_id and self.state != STOPPED:
            for request in self._link.hear(data):
                self._serve(request)
        elif not self._managed:
            return
        elif can_id == _NMT and len(data) >= 2 and data[1] in (0, self.node):
            self._obey(data[0])
        elif can_id == _SYNC and self.state == OPERATIONAL:
            self._pdo.on_sync(self._now_s)

    def _obey(self, command: int) -> None:
        if command in (_RESET_NODE, _RESET_COMMUNICATION):
            self.reset(communication_only=command == _RESET_COMMUNICATION)
        elif command in _NMT_STATES and not self._ignores(command):
            before, self.state = self.state, _NMT_STATES[command]
            if self.state != OPERATIONAL:
                self._pdo.stop()
            elif before != OPERATIONAL:
                self._pdo.start(self._now_s)
                self._plan_emergency()

    def _ignores(self, command: int) -> bool:
        started = _NMT_STATES[command] == OPERATIONAL
        return started and self._stream_faults.active("not-operational", self._now_s) is not None

    def _fall_back(self) -> None:
        if self.state == OPERATIONAL:
            self._obey(0x80)

    def _remap(self) -> None:
        """Two objects of the first PDO change places."""
        first, second = (self.objects.number(_FIRST_MAPPING, sub, 0) for sub in (3, 4))
        self.objects.replace((_FIRST_MAPPING, 3), second)
        self.objects.replace((_FIRST_MAPPING, 4), first)

    def _serve(self, data: bytes) -> None:
        before = self._timer_objects()
        self._sdo.take(data, self._now_s)
        after = self._timer_objects()
        if after.pdo != before.pdo and self.state == OPERATIONAL:
            self._pdo.start(self._now_s)
        if after.heartbeat_ms != before.heartbeat_ms:
            self._start_heartbeat()

    def _timer_objects(self) -> "_TimerObjects":
        """Read again only after an object changed, which thousands of segments of a download do not."""
        if self._timed_by.changes != self.objects.changes:
            heartbeat_ms = self.objects.number(_HEARTBEAT_TIME, 0, 0)
            self._timed_by = _TimerObjects(self.objects.changes, heartbeat_ms, self._pdo.settings())
        return self._timed_by

    def _plan(self, faults: Sequence[InjectedFault]) -> None:
        for fault in faults:
            due_s = self._born_s + fault.after_s
            if fault.kind == "emergency" and not fault.seconds:
                for number in range(max(1, fault.times)):
                    self._external_events.at(due_s + _STORM_PERIOD_S * number, partial(self._emergency, fault))
            elif fault.kind == "falls-back":
                self._external_events.at(due_s, self._fall_back)
            elif fault.kind == "remap":
                self._external_events.at(due_s, self._remap)
            elif fault.kind == "spontaneous-reset":
                self._external_events.at(due_s, self.reset)

    def _plan_emergency(self) -> None:
        fault = self._stream_faults.active("emergency", self._now_s)
        if fault and fault.seconds:
            self._agenda.at(self._now_s + fault.seconds, partial(self._emergency, fault))

    def _emergency(self, fault: InjectedFault) -> None:
        if self._managed and self.state in (PRE_OPERATIONAL, OPERATIONAL):
            code = fault.code.to_bytes(4, "little")[:2]
            self._channel.send(_EMCY + self.node, code + bytes([fault.register & 0xFF]) + bytes(5))

    def _spoilt_value(self, index: int, sub: int) -> Value | None:
        fault = self._sdo_faults.fires("reads", SdoRequest(index, sub, "read", starts=True, segment=False))
        return None if fault is None else fault.value

    def _computed(self, device_map: DeviceMap) -> dict[Address, Callable[[], Value]]:
        """Objects that are measured when they are read."""
        found: dict[Address, Callable[[], Value]] = {(0x2112, 0): self._hundredths}
        for axis in range(3):
            found[0x2110, axis + 1] = partial(self._count, axis, corrected=False)
            found[0x2111, axis + 1] = partial(self._count, axis, corrected=True)
        for place in range(2):
            found[0x2113, place + 1] = partial(self._payload_byte, place)
        for axis in range(3):
            found[0x2113, axis + 3] = partial(self._payload_word, axis)
        for preset in preset_axes(device_map).values():
            found[preset.reading.address] = partial(self._reading, AXES.index(preset.name), preset.reading)
        return found

    def _reading(self, axis: int, number: NumberObject) -> float:
        """What a map's object shows of the reading, in its counts."""
        signal = self._sensor.layout.axes[axis]
        counts = self._pdo.counts(self._now_s, self.objects.correction())[axis]
        return number.sign * float(counts * signal.scale + signal.offset) / number.scale

    def _count(self, axis: int, *, corrected: bool) -> int:
        return int(self._pdo.counts(self._now_s, self.objects.stored() if corrected else None)[axis])

    def _payload_byte(self, place: int) -> int:
        return self._pdo.last_payload[place]

    def _payload_word(self, axis: int) -> int:
        at = 2 + 2 * axis
        return int.from_bytes(self._pdo.last_payload[at : at + 2], "little", signed=True)

    def _hundredths(self) -> int:
        return round(100 * self._pdo.temperature(self._now_s))
