"""`station device`: simulated devices on a real bus, in a world that text commands turn."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from station.adapters.clock import SystemClock
from station.adapters.dbc import read_layouts
from station.adapters.simulated_device import device_fault
from station.adapters.simulated_device.device import SimulatedDevice, Timing, received_ids
from station.adapters.simulated_device.live import Hub, serve
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.simulated_device.stream import SimulatedSensor
from station.config.products import load_product, product_path
from station.domain.can.sensor_layout import SensorLayout, resolve, used_signals
from station.domain.core.types import Floats
from station.domain.product.product import serial_of
from station.domain.recipe.position import UP
from station.errors import UsageError
from station.ports.bus import Endpoint
from station.wiring.buses import named_bus, open_endpoint
from station.wiring.simulated_objects import simulated_objects

#: Spread of the units: gain and cross-axis, 1; offset and noise, as fractions of full scale.
_GAIN_STD, _OFFSET_STD, _NOISE_STD = 0.01, 0.01, 0.0002
_NODES = range(1, 128)


@dataclass(frozen=True, slots=True)
class Population:
    """Which devices are wanted, one serial per node. memory: folder of what they save; faults: in their text form;
    block_s: readings leave in blocks of about this length, 0: each at its instant.
    """

    product: str
    channel: str
    nodes: tuple[int, ...]
    serials: tuple[str, ...]
    rate_hz: float | None = None
    seed: int = 1
    memory: Path | None = None
    faults: tuple[str, ...] = ()
    flash_s: float = Timing().flash_s
    block_s: float = 0.0
    interface: str = "socketcan"


class World:
    """What every device of the process feels: the true vector in its own frame, and the temperature."""

    def __init__(self) -> None:
        self.true = np.array([0.0, 0.0, 1.0])
        self.temperature_degC = 23.0

    def obey(self, line: str) -> None:
        """One command: `up +x`, `true X Y Z` or `temperature DEGC`. Errors: UsageError."""
        verb, *words = line.split() or [""]
        try:
            if verb == "up":
                self.true = UP[words[0]].copy()
            elif verb == "true":
                self.true = np.array([float(word) for word in words]).reshape(3)
            else:
                self.temperature_degC = {"temperature": float(words[0])}[verb]
        except (ValueError, KeyError, IndexError):
            raise UsageError("live-command-unknown", text=line[:40]) from None


@dataclass(frozen=True, slots=True, eq=False)
class TrueErrors:
    """One unit's true errors: measured = matrix · true + offset + noise; offset (3), noise in the sensor's unit."""

    matrix: Floats
    offset: Floats
    noise: float

    def sensed(self, world: World, rng: np.random.Generator) -> Callable[[Floats], Floats]:
        """instants (n) → readings (n, 3)."""
        return lambda times_s: (
            self.matrix @ world.true + self.offset + self.noise * rng.standard_normal((len(times_s), 3))
        )


class LiveDevices:
    """The devices of one process on one bus. channel: hears what `listens` says; bodies: serial → true errors.

    Errors: those of product and bus; UsageError where nodes and serials do not pair up.
    """

    def __init__(self, wanted: Population, channel: Endpoint) -> None:
        where = product_path(wanted.product)
        product = load_product(wanted.product)
        self.world, self.bodies = World(), dict[str, TrueErrors]()
        self._wanted, self._map, self._objects = wanted, product.map, simulated_objects(product, where)
        self._layout: SensorLayout = resolve(
            product.frames, read_layouts(where.parent / product.frames.dbc, used_signals(product.frames))
        )
        self._clock = SystemClock()
        self._channel, self._hub = channel, Hub(channel)
        self._devices = [self._device(n, s) for n, s in zip(wanted.nodes, wanted.serials, strict=True)]

    @classmethod
    def open(cls, wanted: Population) -> "LiveDevices":
        """The devices on their CAN interface."""
        _check(wanted)
        product_path(wanted.product)
        bus = named_bus(wanted.interface, wanted.channel)
        return cls(wanted, open_endpoint(bus, SystemClock(), population_ids(wanted)))

    def live(self, go_on: Callable[[], bool]) -> None:
        """Serves the bus for as long as `go_on()`, then leaves it."""
        try:
            serve(self._hub, self._devices, self._clock, go_on)
        finally:
            self._channel.close()

    def _device(self, node: int, serial: str) -> SimulatedDevice:
        wanted, rng = self._wanted, np.random.default_rng([self._wanted.seed, node])
        full_scale = self._layout.axes[0].raw_limits()[1] * self._layout.axes[0].scale
        matrix = np.eye(3) + _GAIN_STD * rng.standard_normal((3, 3))
        offset = _OFFSET_STD * full_scale * rng.standard_normal(3)
        body = self.bodies[serial] = TrueErrors(matrix, offset, _NOISE_STD * full_scale)
        sense = body.sensed(self.world, rng)
        return SimulatedDevice(
            self._hub.endpoint(),
            self._clock,
            self._objects(node),
            self._map,
            SimulatedSensor(self._layout, sense, lambda _: self.world.temperature_degC, wanted.rate_hz),
            serial=serial_of(self._map, serial),
            memory=None if wanted.memory is None else NonVolatileMemory.of_serial(wanted.memory, serial),
            timing=Timing(turnaround_s=0.0, flash_s=wanted.flash_s, block_s=wanted.block_s),
            faults=[device_fault.parse(text) for text in wanted.faults],
        )


def population_ids(wanted: Population) -> tuple[int, ...]:
    """Identifiers that the devices' channel must receive."""
    return tuple(sorted({can_id for node in wanted.nodes for can_id in received_ids(node)}))


def _check(wanted: Population) -> None:
    if len(wanted.nodes) != len(wanted.serials):
        raise UsageError("nodes-and-serials", nodes=len(wanted.nodes), serials=len(wanted.serials))
    for node in wanted.nodes:
        if node not in _NODES or wanted.nodes.count(node) > 1:
            raise UsageError("node-taken", node=node)
