"""The simulated fixture: a virtual bus on virtual time, a positioner in numbers, and devices that sense its physics."""

import math
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from typing import cast

import numpy as np

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import SystemClock, VirtualClock
from station.adapters.positioner.simulated import SimulatedPositioner
from station.adapters.simulated_device import device_fault, live
from station.adapters.simulated_device.device import SimulatedDevice, Timing, received_ids
from station.adapters.simulated_device.drive.node import SimulatedDrive, heard_ids
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.simulated_device.stream import SimulatedSensor
from station.config.documents import Document
from station.config.models import load_model
from station.config.rigs import load_rig
from station.config.settings import Settings
from station.domain.core.types import Frames, NestAssignment
from station.domain.product.product import serial_of
from station.domain.recipe.plan import PlannedVisit
from station.errors import BusFault, UsageError
from station.model.effect import Effect
from station.model.rig import Rig
from station.model.simulate import SimulationJob, parse_effect
from station.ports.bus import Bus, Endpoint
from station.ports.clock import Clock
from station.ports.positioner import Positioner
from station.service.station import Job
from station.wiring.devices import seed_key
from station.wiring.driven_fixture import DRIVEN, DrivenFixture, Surroundings, driven_fixture
from station.wiring.jobs import Source
from station.wiring.options import options_of
from station.wiring.positioners import positioner_options
from station.wiring.run_order import RunOrder
from station.wiring.simulated_objects import simulated_objects

#: How well the simulated positioner repeats, degrees, where config.yaml does not describe it: 3.6″, a dividing head.
#: More of it is a cause of its own, which nobody asked for: `--effect repeatability`.
ERROR_DEG = 0.001
#: Readings of this long leave a simulated device together, s, while nobody looks (during a move).
BLOCK_S = 5.0
#: In place of a serial in `--fault`: the bus itself; the gold reference.
BUS_PREFIX, GOLD_SERIAL = "BUS/", "GOLD"


class SimulatedFixture:
    """Everything that `station run --simulate` needs in place of a bench."""

    timing = Timing(block_s=BLOCK_S)

    def __init__(
        self,
        settings: Settings,
        document: Document,
        job: Job,
        source: Source,
        order: RunOrder,
    ) -> None:
        self._settings, self._job, self._order = settings, job, order
        self._opened = ExitStack()
        self.clock, self.bus = self._world()
        self.positioner: Positioner
        kind = settings.positioner.kind
        if order.mounted and kind != "cia402":
            raise UsageError("mounted-without-drives", kind=kind)
        if kind in DRIVEN:
            self.positioner = driven = self._driven(document)
            plate = driven.plate
        else:
            numbers = SimulatedPositioner(self._positioner_settings(document), self.clock, self._go)
            self.positioner, plate = numbers, numbers.plate
        effects = tuple(_effect(text, job) for text in order.effects)
        model = load_model(order.model, job.recipe.unit)
        self._rig = Rig(SimulationJob(job.recipe, (), order.seed, effects, model), plate)
        for text in order.faults:
            if text.startswith(BUS_PREFIX):
                self._break_wire(text.removeprefix(BUS_PREFIX))
        self._faults = [_parse_fault(text) for text in order.faults if not text.startswith(BUS_PREFIX)]
        self._devices: list[tuple[SimulatedDevice, _DisturbedEndpoint]] = []
        self._dictionary = simulated_objects(job.product, source.product)

    def _world(self) -> tuple[Clock, Bus]:
        """Time and bus. The record's dates are today's; nothing that is computed depends on them."""
        self._events = VirtualClock(SystemClock().epoch_ns())
        self._virtual = SimulatedBus(self._events)
        return self._events, self._virtual

    def _driven(self, document: Document) -> DrivenFixture:
        mounted = load_rig(self._order.mounted) if self._order.mounted else None
        moves = self._go, self._arrived
        around = Surroundings(self._settings, document, self.clock, self.bus, self._endpoint, self._attach, *moves)
        return driven_fixture(around, self._opened, mounted)

    def close(self) -> None:
        """Lets go of a machine that is another process; nothing runs on behind a virtual bus."""
        self._opened.close()

    def _break_wire(self, fault: str) -> None:
        self._virtual.break_wire(fault)

    def _attach(self, device: SimulatedDevice | SimulatedDrive) -> None:
        self._events.attach(device)

    def _detach(self, device: SimulatedDevice) -> None:
        self._events.detach(device)

    def _endpoint(self, can_ids: tuple[int, ...]) -> Endpoint:
        return self._virtual.endpoint(can_ids)

    def place(self, seats: Sequence[NestAssignment]) -> None:
        """Takes the old units out, and puts a new device for each seat into its nest."""
        for device, channel in self._devices:
            self._detach(device)
            channel.close()
        labels = {"station": self._settings.station, "operator": self._settings.operator, "lot": self._settings.lot}
        self._rig.load(
            {seat.nest: seat.serial for seat in seats},
            self.clock.monotonic_s(),
            {k: v for k, v in labels.items() if v},
        )
        self._devices = [self._device(seat) for seat in seats]
        if self._job.gold_node is not None:
            self._devices.append(self._gold(seats[0].nest, self._job.gold_node))
        for device, _ in self._devices:
            self._attach(device)

    def _device(self, seat: NestAssignment) -> "tuple[SimulatedDevice, _DisturbedEndpoint]":
        sheet, folder = self._job.recipe.device, self._order.device_state
        sensor = SimulatedSensor(
            layout=self._job.layout,
            sense=partial(self._rig.sense, seat.nest),
            temperature=lambda time_s: float(self._rig.temperature_degC(seat.nest, np.array([time_s]))[0]),
            rate_hz=sheet.rate_hz * (1 + self._rig.rate_error(seat.nest)),
        )
        memory = NonVolatileMemory() if folder is None else NonVolatileMemory.of_serial(folder, seat.serial)
        faults = [f for serial, f in self._faults if serial in ("", seat.serial)]
        serial = serial_of(self._job.product.map, seat.serial)
        return self._build_device(seat.nest, seat.node, sensor, serial, memory, faults)

    def _gold(self, nest: str, node: int) -> "tuple[SimulatedDevice, _DisturbedEndpoint]":
        """A gold reference beside the first nest; a fault of serial GOLD is its own."""
        sensor = SimulatedSensor(
            layout=self._job.layout,
            sense=partial(self._rig.gold, nest),
            temperature=lambda time_s: float(self._rig.temperature_degC(nest, np.array([time_s]))[0]),
            rate_hz=self._job.recipe.device.rate_hz,
        )
        return self._build_device(
            nest, node, sensor, 0, NonVolatileMemory(), [f for s, f in self._faults if s == GOLD_SERIAL]
        )

    def _build_device(
        self,
        nest: str,
        node: int,
        sensor: SimulatedSensor,
        serial: int | str,
        memory: NonVolatileMemory,
        faults: list[device_fault.InjectedFault],
    ) -> "tuple[SimulatedDevice, _DisturbedEndpoint]":
        channel = _DisturbedEndpoint(self._endpoint(_received_ids(self._job, node)), self._rig, nest)
        device = SimulatedDevice(
            channel,
            self.clock,
            self._dictionary(node),
            self._job.product.map,
            sensor,
            timing=self.timing,
            serial=serial,
            memory=memory,
            faults=faults,
            key=seed_key(self._job.product.map),
            wakes_s=self._wakes_s,
        )
        return device, channel

    def _wakes_s(self) -> float:
        return self._events.wakes_s

    def _positioner_settings(self, document: Document) -> SimulatedPositioner.Settings:
        if self._settings.positioner.kind != "simulated":
            return SimulatedPositioner.Settings(error_deg=ERROR_DEG, seed=self._order.seed)
        own = self._settings.positioner.options
        return options_of("positioner", own, document, SimulatedPositioner.Settings)

    def _arrived(self, now_s: float) -> None:
        self._rig.arrive(now_s)

    def _go(self, stop: PlannedVisit, departs_s: float, arrives_s: float) -> None:
        self._rig.go(stop, departs_s, arrives_s)


class Rehearsal(SimulatedFixture):
    """The simulated fixture in real time, its devices on a real bus: `bus` is the station's end of it, `far` theirs.

    A thread of its own serves the devices; it begins with `begin` and ends with `close`.
    """

    timing = Timing(turnaround_s=0.0)

    def __init__(
        self,
        settings: Settings,
        document: Document,
        job: Job,
        source: Source,
        order: RunOrder,
        *,
        near: Bus,
        far: Bus,
    ) -> None:
        self._near, self._far_bus = near, far
        nodes = [nest.node for nest in settings.nests] + ([] if job.gold_node is None else [job.gold_node])
        can_ids = {i for node in nodes for i in _received_ids(job, node)}
        if settings.positioner.kind == "cia402":
            rig = load_rig(positioner_options(settings, document).map)
            can_ids |= {i for axis in rig.axes for i in heard_ids(axis.node, rig.station_node)}
        self._hub = live.Hub(cast(Endpoint, far.service(tuple(sorted(can_ids)))))
        self._served: list[SimulatedDevice | SimulatedDrive] = []
        self._changing, self._ended = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None
        super().__init__(settings, document, job, source, order)

    def begin(self) -> None:
        """Devices and drives live from now on."""
        self._thread = threading.Thread(target=self._serve, name="rehearsal", daemon=True)
        self._thread.start()

    def place(self, seats: Sequence[NestAssignment]) -> None:
        """As in simulated time."""
        with self._changing:
            super().place(seats)

    def close(self) -> None:
        """Ends the devices' thread and their end of the bus."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join(5.0)
        self._far_bus.close()
        super().close()

    def _serve(self) -> None:
        clock = SystemClock()
        while not self._ended.is_set():
            try:
                with self._changing:
                    wait_s = live.act_all(self._served, clock)
                self._hub.wait(wait_s)
            except BusFault:
                # As on a wire: the frame is lost and the devices live on. The station's own end reports a dead bus.
                self._ended.wait(live.POLL_S)

    def _world(self) -> tuple[Clock, Bus]:
        return SystemClock(), self._near

    def _wakes_s(self) -> float:
        return -math.inf

    def _attach(self, device: SimulatedDevice | SimulatedDrive) -> None:
        self._served.append(device)

    def _detach(self, device: SimulatedDevice) -> None:
        self._served.remove(device)

    def _endpoint(self, _can_ids: tuple[int, ...]) -> Endpoint:
        return self._hub.endpoint()

    def _break_wire(self, fault: str) -> None:
        raise UsageError("rehearsal-without-wire", fault=fault[:60])


class _DisturbedEndpoint:
    """A device's endpoint; what it sends in blocks arrives as the simulated bus faults let it."""

    def __init__(self, channel: Endpoint, rig: Rig, nest: str) -> None:
        self._channel, self._rig, self._nest = channel, rig, nest

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one frame."""
        self._channel.send(can_id, data)

    def send_many(self, frames: Frames) -> None:
        """Sends a block, after the causes that act on the bus."""
        self._channel.send_many(self._rig.deliver(self._nest, frames))

    def receive(self, timeout_s: float) -> Frames:
        """What came for the device."""
        return self._channel.receive(timeout_s)

    def drops(self) -> int:
        """Frames dropped here."""
        return self._channel.drops()

    def close(self) -> None:
        """Leaves the bus."""
        self._channel.close()


def _received_ids(job: Job, node: int) -> tuple[int, ...]:
    return received_ids(node, job.product.map, job.product.frames.node_of_dbc)


def _effect(text: str, job: Job) -> Effect:
    name, _, size = text.partition("=")
    return parse_effect(name, job.recipe, size or None)


def _parse_fault(text: str) -> tuple[str, device_fault.InjectedFault]:
    """`SERIAL/KIND:…` or `KIND:…` → (serial or '', fault)."""
    head, slash, rest = text.partition("/")
    return (head, device_fault.parse(rest)) if slash else ("", device_fault.parse(text))
