"""Fleets of devices with LSS on one simulated bus, a master that is killed at a frame, and what must hold of both."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.lss_master import LSS_ANSWER, CanopenLssMaster
from station.adapters.canopen.network import ServiceNetwork, service_ids
from station.adapters.clock import VirtualClock
from station.adapters.simulated_device.lss import LssDevice, LssSlave
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.ports.lss import UNCONFIGURED, LssIdentity
from station.service.commission import Commissioned, CommissioningBench, NodeSeat, assign_nodes
from station.service.station import Job
from station.wiring.commission import fresh_device
from station.wiring.jobs import Source, load_job

PRODUCT = LssIdentity(0x000CA1B0, 0x00000ACC, 0x00010000, 0)
BOOT_S = 0.5
#: The longest classic frame with eight bytes, stuffed, at 500 kbit/s.
WIRE_S = 135 / 500e3


@cache
def product() -> tuple[Job, Source]:
    return load_job("six-point")


class MasterKilled(Exception):
    """The master's process ends before this frame leaves."""


class _CountingChannel:
    def __init__(self, bus: SimulatedBus, ids: tuple[int, ...], killed_at: int | None) -> None:
        self._channel, self._killed_at, self.sent = bus.service(ids), killed_at, 0
        self.receive, self.drops, self.close = self._channel.receive, self._channel.drops, self._channel.close

    def send(self, can_id: int, data: bytes) -> None:
        if self.sent == self._killed_at:
            raise MasterKilled
        self.sent += 1
        self._channel.send(can_id, data)


@dataclass(frozen=True, slots=True)
class Member:
    """A device of a fleet. stored: the node id it holds already; factory: the one it was made with; fault: what is
    wrong with its LSS."""

    identity: LssIdentity
    stored: int | None = None
    factory: int = UNCONFIGURED
    fault: str = ""


class Fleet:
    """Devices on one bus, in simulated time."""

    def __init__(self, members: Sequence[Member]) -> None:
        self.clock = VirtualClock()
        self.bus = SimulatedBus(self.clock)
        self.devices: list[LssDevice] = []
        self.frames = 0
        job, source = product()
        for one in members:
            memory = NonVolatileMemory()
            if one.stored is not None:
                memory.store({"node": one.stored})
            slave = LssSlave(one.identity, memory, one.factory, one.fault)
            device = fresh_device(self.bus.endpoint, self.clock, job, source, slave)
            self.devices.append(device)
            self.clock.attach(device)
        self.clock.sleep(0.3)

    def close(self) -> None:
        self.bus.close()

    def bench(self, nodes: Sequence[int], killed_at: int | None = None) -> CommissioningBench:
        """A master of its own, which dies before its frame number `killed_at`."""
        channel = _CountingChannel(self.bus, (LSS_ANSWER, *service_ids(tuple(nodes))), killed_at)
        self.channel = channel
        network = ServiceNetwork(channel, self.clock)
        device = cache(lambda node: CanopenDevice(network, node, answer_s=0.02))
        return CommissioningBench(CanopenLssMaster(network), device, self.clock, BOOT_S, probe_s=0.02)

    def commission(self, seats: Sequence[NodeSeat], killed_at: int | None = None) -> Commissioned | None:
        """None: the master was killed."""
        bench = self.bench([s.node for s in seats], killed_at)
        try:
            return assign_nodes(bench, seats, PRODUCT)
        except MasterKilled:
            return None
        finally:
            self.frames = self.channel.sent
            self.channel.close()

    def node_ids(self) -> list[int]:
        """Those in use."""
        return [d.slave.node for d in self.devices if d.slave.node != UNCONFIGURED]

    def power_cycle(self) -> None:
        for device in self.devices:
            device.power_cycle()
        self.clock.sleep(0.3)


def seats_of(nodes: Sequence[int], identities: Sequence[LssIdentity | None]) -> list[NodeSeat]:
    return [NodeSeat(f"N{node}", node, identity) for node, identity in zip(nodes, identities, strict=True)]


def random_fleet(rng: random.Random, most: int = 16) -> tuple[list[Member], list[NodeSeat]]:
    """Fresh devices, devices that share a default id, and devices that hold the id of some nest, with labels for some
    or all. Each member belongs on one of the nests."""
    count = rng.randint(1, most)
    nodes = rng.sample(range(1, 128), count)
    foreign = rng.random() < 0.2
    identities = [
        LssIdentity(*(rng.getrandbits(32) for _ in range(4)))
        if foreign
        else LssIdentity(PRODUCT.vendor, PRODUCT.product, PRODUCT.revision, serial)
        for serial in rng.sample(range(1, 1 << 32), count)
    ]
    if rng.random() < 0.3:
        default = rng.choice(nodes) if rng.random() < 0.5 else rng.randint(1, 127)
        return [Member(i, factory=default) for i in identities], seats_of(nodes, identities)
    holders = rng.sample(nodes, count)
    members = [Member(i, stored=h if rng.random() < 0.3 else None) for i, h in zip(identities, holders, strict=True)]
    labels = [i if rng.random() < 0.5 else None for i in identities]
    return members, seats_of(nodes, labels)


def mistakes(fleet: Fleet, seats: Sequence[NodeSeat], found: Commissioned | None) -> list[str]:
    """What is wrong after a whole commissioning, by the devices' own word, before and after power-off."""
    if found is None or not found.complete or len(found.devices) != len(seats):
        return ["not every nest has its device"]
    wrong = []
    for when in ("before", "after"):
        at = {d.slave.node: d.slave.identity for d in fleet.devices}
        if len(at) != len(fleet.devices) or set(at) != {s.node for s in seats}:
            wrong.append(f"{when} power-off: ids {sorted(fleet.node_ids())}")
        wrong += [f"{when} power-off: {s}" for s in seats if s.identity not in (None, at.get(s.node))]
        wrong += [f"{when} power-off, reported: {d}" for d in found.devices if at.get(d.node) != d.identity]
        fleet.power_cycle()
    return wrong


def killed_and_repeated(members: Sequence[Member], seats: Sequence[NodeSeat], frame: int) -> list[str]:
    """Mistakes of a master that is killed before this frame, and of the one that goes on."""
    fleet = Fleet(members)
    shared_before = len(fleet.node_ids()) - len(set(fleet.node_ids()))
    try:
        fleet.commission(seats, killed_at=frame)
        wrong = _shared(fleet, shared_before, "killed")
        fleet.clock.sleep(1.0)
        wrong += _shared(fleet, shared_before, "a second later")
        return wrong + mistakes(fleet, seats, fleet.commission(seats))
    finally:
        fleet.close()


def _shared(fleet: Fleet, before: int, when: str) -> list[str]:
    ids = fleet.node_ids()
    return [f"{when}: ids {sorted(ids)}"] if len(ids) - len(set(ids)) > before else []
