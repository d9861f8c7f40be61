"""A simulated device on a virtual bus in virtual time, the station's device opposite it, and a raw endpoint."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from station.adapters import dbc
from station.adapters.bus.simulated import SimulatedBus
from station.adapters.canopen import eds
from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.network import ServiceNetwork, service_ids
from station.adapters.clock import VirtualClock
from station.adapters.simulated_device import device_fault
from station.adapters.simulated_device.device import SimulatedDevice, Timing, received_ids
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.simulated_device.stream import SimulatedSensor
from station.config.products import load_product
from station.domain.can.sensor_layout import SensorLayout, resolve
from station.domain.core.types import Floats, Frames
from station.domain.product.product import Product
from station.ports.bus import Endpoint

DBC = Path(__file__).parents[2] / "dbc"
KEY = bytes.fromhex("3143414c")


def still(at: Sequence[float] | Floats = (0.1, -0.2, 1.0)) -> Callable[[Floats], Floats]:
    """A world in which the sensor feels always the same."""
    return lambda times_s: np.tile(np.asarray(at, float), (len(times_s), 1))


@dataclass
class DeviceRig:
    """One bus with one device of a shipped product at `node`; `faults` in their text form."""

    node: int = 5
    faults: Sequence[str] = ()
    product_name: str = "accelerometer"
    sense: Callable[[Floats], Floats] = field(default_factory=still)
    temperature: Callable[[float], float] = lambda _: 23.5
    rate_hz: float | None = None
    serial: int = 42
    memory: NonVolatileMemory = field(default_factory=NonVolatileMemory)
    timing: Timing = field(default_factory=Timing)
    answer_s: float = 0.5

    def __post_init__(self) -> None:
        self.clock = VirtualClock()
        self.bus = SimulatedBus(self.clock)
        self.product: Product = load_product(self.product_name)
        self.layout: SensorLayout = resolve(self.product.frames, dbc.read_layouts(DBC / self.product.frames.dbc))
        self.dictionary = eds.load(DBC / f"{self.product_name}.eds", self.node)
        self.device = SimulatedDevice(
            self.bus.service(received_ids(self.node)),
            self.clock,
            self.dictionary,
            self.product.map,
            SimulatedSensor(self.layout, self.sense, self.temperature, self.rate_hz),
            serial=self.serial,
            memory=self.memory,
            timing=self.timing,
            faults=[device_fault.parse(text) for text in self.faults],
        )
        self.raw: Endpoint = self.bus.service(())
        self.stream = self.bus.stream(self.layout.ids(self.node))
        self.network = ServiceNetwork(self.bus.service(service_ids((self.node,))), self.clock)
        self.station = CanopenDevice(
            self.network, self.node, answer_s=self.answer_s, timeouts_s=self.product.map.timeouts()
        )
        self.clock.attach(self.device)

    def query(self, request: str) -> list[str]:
        """Sends one SDO request as hex; the answers that come within 50 ms, as hex."""
        self.raw.receive(0.0)
        self.raw.send(0x600 + self.node, bytes.fromhex(request))
        self.clock.sleep(0.05)
        return [data for can_id, data in self.heard() if can_id == 0x580 + self.node]

    def heard(self) -> list[tuple[int, str]]:
        """All that came since the last look: (identifier, hex)."""
        frames = self.raw.receive(0.0)
        return [
            (int(i), d[:n].tobytes().hex(" "))
            for i, n, d in zip(frames.can_id, frames.length, frames.data, strict=True)
        ]

    def readings(self, duration_s: float) -> Frames:
        """What the stream brings from now on."""
        self.clock.settle()
        self.stream.receive(0.0)
        self.clock.sleep(duration_s)
        return self.stream.receive(0.0)

    def unlock(self) -> None:
        """Lets coefficients be written."""
        self.station.download(0x2104, 0, KEY)

    def close(self) -> None:
        """Leaves the bus."""
        self.bus.close()
