"""`station commission`: the buses and the LSS master of a fixture, or fresh simulated devices in their place."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.canopen import eds
from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.lss_master import LSS_ANSWER, CanopenLssMaster
from station.adapters.canopen.lss_transfer import BIT_TIMINGS
from station.adapters.canopen.network import ServiceNetwork, service_ids
from station.adapters.clock import SystemClock, VirtualClock
from station.adapters.simulated_device.device import SimulatedDevice, received_ids
from station.adapters.simulated_device.lss import LSS_RECEIVED, LssDevice, LssSlave
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.simulated_device.stream import SimulatedSensor
from station.config.settings import Settings, load_config
from station.domain.product.object_dictionary import ObjectDictionary
from station.domain.product.product import serial_of
from station.errors import ProductError, UsageError
from station.messages import Message
from station.ports.bus import Bus, Endpoint
from station.ports.clock import Actor, Clock
from station.ports.lss import LssIdentity
from station.service.commission import Commissioned, CommissioningBench, NodeSeat, assign_nodes, store_bit_rate
from station.service.prove_nests import assign_proven_nodes
from station.service.station import Job
from station.wiring.bench import units_bus_of
from station.wiring.jobs import Source, load_job
from station.wiring.rehearsal import is_rehearsal

_IDENTITY = 0x1018


@dataclass(frozen=True, slots=True)
class CommissionOrder:
    """serials, nests: scanned labels and the nests they are in, in pairs; device_state: where simulated devices keep
    their node ids; None: they are fresh at each start; bit_rate_kbit_s: what they keep beside the node ids;
    prove_nests: a person takes out one unit at a time."""

    config: Path | None = None
    recipe: str | None = None
    simulate: bool = False
    serials: tuple[str, ...] = ()
    nests: tuple[str, ...] = ()
    device_state: Path | None = None
    bit_rate_kbit_s: int | None = None
    prove_nests: bool = False


def commission_fixture(
    order: CommissionOrder, tell: Callable[[Message], None], confirm: Callable[[Message], None]
) -> Commissioned:
    """Addresses the fixture's devices. confirm: has a person do something; simulated units take themselves out.

    Errors: InputError before anything is sent; those of assign_nodes and assign_proven_nodes.
    """
    if (kbit_s := order.bit_rate_kbit_s) is not None and kbit_s not in BIT_TIMINGS:
        raise UsageError("lss-bit-rate", kbit_s=kbit_s, known=tuple(BIT_TIMINGS))
    settings, document = load_config(order.config)
    job, source = load_job(order.recipe or settings.recipe)
    if settings.buses:
        raise UsageError("commission-one-bus")
    simulate = order.simulate or is_rehearsal(settings)
    if order.device_state is not None and not simulate:
        raise UsageError("option-needs-simulate", option="--device-state")
    product = product_identity(job, source)
    seats = _seats(settings, job, order, product)
    with ExitStack() as opened:
        if simulate:
            clock, bus, confirm = _simulated(settings, job, source, order, product)
        else:
            clock = SystemClock()
            bus = units_bus_of(settings, document, clock, opened)
        opened.callback(bus.close)
        bench = commissioning_bench(bus, clock, [s.node for s in seats], settings.timeouts.boot_s)
        if order.prove_nests:
            found = assign_proven_nodes(bench, seats, product, tell, confirm)
        else:
            found = assign_nodes(bench, seats, product, tell)
        if order.bit_rate_kbit_s is not None:
            store_bit_rate(bench, found.devices, order.bit_rate_kbit_s, tell)
        return found
    raise AssertionError("unreachable: ExitStack swallows nothing")


def commissioning_bench(bus: Bus, clock: Clock, nodes: Sequence[int], boot_s: float) -> CommissioningBench:
    """The LSS master of a bus, and the devices at these node ids or any other."""
    network = ServiceNetwork(bus.service((LSS_ANSWER, *service_ids(tuple(nodes)))), clock)
    device = cache(lambda node: CanopenDevice(network, node, answer_s=0.1))
    return CommissioningBench(CanopenLssMaster(network), device, clock, boot_s)


def product_identity(job: Job, source: Source) -> LssIdentity:
    """Vendor, product and revision as the product file states them, else its EDS; what neither knows is 0, serial too.
    Of a least revision that is stated beside one in the EDS the latter counts."""
    stated = job.product.identity
    entries = {} if source.eds is None else eds.load(source.eds, 1, frozenset()).entries
    defaults = [entries[_IDENTITY, sub].default if (_IDENTITY, sub) in entries else 0 for sub in range(1, 4)]
    vendor, product, revision = (value if isinstance(value, int) else 0 for value in defaults)
    return LssIdentity(
        vendor if stated.vendor is None else stated.vendor,
        product if stated.product is None else stated.product,
        revision or stated.revision_at_least or 0,
        0,
    )


def _seats(settings: Settings, job: Job, order: CommissionOrder, product: LssIdentity) -> list[NodeSeat]:
    if len(order.serials) != len(order.nests):
        raise UsageError("commission-pairs", serials=len(order.serials), nests=len(order.nests))
    known = tuple(nest.name for nest in settings.nests)
    for nest in order.nests:
        if nest not in known:
            raise UsageError("commission-nest-unknown", nest=nest[:40], known=known)
    for name, values in (("--nest", order.nests), ("--serial", order.serials)):
        if len(set(values)) < len(values):
            raise UsageError("commission-twice", option=name)
    labels = dict(zip(order.nests, order.serials, strict=True))
    return [
        NodeSeat(n.name, n.node, _labelled(job, product, labels[n.name]) if n.name in labels else None)
        for n in settings.nests
    ]


def _labelled(job: Job, product: LssIdentity, label: str) -> LssIdentity:
    """The identity of the unit with this label. Errors: UsageError where the product's label does not tell 0x1018:4."""
    place = job.product.map.serial_object
    number = serial_of(job.product.map, label)
    if place is None or place.address != (_IDENTITY, 4) or not isinstance(number, int):
        raise UsageError("commission-label-elsewhere", product=job.product.name)
    if not 0 <= number < 1 << 32:
        raise UsageError("commission-label-range", label=label[:40])
    return LssIdentity(product.vendor, product.product, product.revision, number)


class SimulatedHands:
    """Does with simulated devices what a person is asked to do: one nest at a time is empty."""

    def __init__(self, clock: VirtualClock, fitted: Mapping[str, LssDevice]) -> None:
        self._clock, self._fitted = clock, fitted
        self._out: LssDevice | None = None

    def __call__(self, action: Message) -> None:
        """Puts back what is out; then takes out the unit of the nest that the action names."""
        if self._out is not None:
            self._out.power_cycle()
            self._clock.attach(self._out)
            self._out = None
        nest = action.parameters.get("nest")
        if nest is not None:
            self._out = self._fitted[str(nest)]
            self._clock.detach(self._out)


def _simulated(
    settings: Settings, job: Job, source: Source, order: CommissionOrder, product: LssIdentity
) -> tuple[Clock, Bus, SimulatedHands]:
    """A bus with a fresh device in every nest: those with the scanned labels, then SN0001, SN0002 …

    These begin in the last nest, so that a scan alone gets the nests wrong. Errors: ProductError without an EDS.
    """
    if source.eds is None:
        raise ProductError("product-without-eds", file=str(source.product))
    clock = VirtualClock(SystemClock().epoch_ns())
    bus = SimulatedBus(clock)
    serials = dict(zip(order.nests, order.serials, strict=True))
    unlabelled = [n.name for n in reversed(settings.nests) if n.name not in serials]
    others = (s for s in (f"SN{i:04d}" for i in range(1, 1000)) if s not in order.serials)
    serials |= dict(zip(unlabelled, others, strict=False))
    fitted = {}
    for nest, serial in serials.items():
        memory = (
            None if order.device_state is None else NonVolatileMemory.of_serial(order.device_state, f"{serial}.lss")
        )
        number = serial_of(job.product.map, serial)
        identity = LssIdentity(
            product.vendor, product.product, product.revision, number if isinstance(number, int) else 0
        )
        slave = LssSlave(identity, memory or NonVolatileMemory())
        fitted[nest] = fresh_device(bus.endpoint, clock, job, source, slave)
        clock.attach(fitted[nest])
    return clock, bus, SimulatedHands(clock, fitted)


def fresh_device(
    endpoint: Callable[[tuple[int, ...]], Endpoint], clock: Clock, job: Job, source: Source, slave: LssSlave
) -> LssDevice:
    """A simulated device of the product behind this slave, at rest; its serial object is the slave's serial."""

    @cache
    def dictionary(node: int) -> ObjectDictionary:
        assert source.eds is not None
        made = eds.load(source.eds, node, frozenset())
        own = {(_IDENTITY, sub): number for sub, number in enumerate(slave.identity.numbers, start=1)}
        known = {a: replace(made.entries[a], default=number) for a, number in own.items() if a in made.entries}
        return ObjectDictionary(node, {**made.entries, **known})

    def build(node: int) -> tuple[Actor, Endpoint]:
        channel = endpoint(received_ids(node))
        sensor = SimulatedSensor(job.layout, lambda at: np.tile([0.0, 0.0, 1.0], (len(at), 1)), lambda _: 23.0)
        serial = slave.identity.serial
        return SimulatedDevice(channel, clock, dictionary(node), job.product.map, sensor, serial=serial), channel

    return LssDevice(slave, endpoint(LSS_RECEIVED), clock, build)
