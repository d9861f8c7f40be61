"""Node ids for the devices of a fixture, one device at a time; killed at any frame, no two devices share an id.

An id is given only after a read at it was answered by nobody; it is stored before it becomes active, so a device that
answers at its id keeps it; a device that leaves an id stores that it has none before another one gets it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from station.errors import DeviceSilent, WrongUnit
from station.messages import Message
from station.ports.clock import Clock
from station.ports.device import Device
from station.ports.lss import UNCONFIGURED, LssIdentity, LssMaster

How = Literal["label", "scan", "stays", "proven"]


@dataclass(frozen=True, slots=True)
class NodeSeat:
    """A nest, the node id of its device, and the device's identity where its label was scanned."""

    nest: str
    node: int
    identity: LssIdentity | None = None


@dataclass(frozen=True, slots=True)
class AddressedDevice:
    """A device at its node id, proven by a read there. how: by its label, by a scan, it had the id, or its
    nest was proven by taking it out."""

    nest: str
    node: int
    identity: LssIdentity
    how: How


@dataclass(frozen=True, slots=True)
class Commissioned:
    """Devices in the order of their nests, and what the person must know."""

    devices: tuple[AddressedDevice, ...]
    findings: tuple[Message, ...]

    @property
    def complete(self) -> bool:
        """Whether every nest has its device, and none is left over."""
        return all(m.id == "commission-nest-unproven" for m in self.findings)


@dataclass(frozen=True, slots=True)
class CommissioningBench:
    """device: node id → the device there; boot_s: a device has booted by then; probe_s: silence that means nobody."""

    lss: LssMaster
    device: Callable[[int], Device]
    clock: Clock
    boot_s: float
    probe_s: float = 0.2


def assign_nodes(
    bench: CommissioningBench,
    seats: Sequence[NodeSeat],
    hint: LssIdentity | None,
    tell: Callable[[Message], None] = lambda _: None,
) -> Commissioned:
    """Labelled devices first, then those found by scans, in the order of the nests; a second time nothing changes.

    Errors: DeviceSilent where a labelled device does not answer (nothing was changed), or not at its new id;
    WrongUnit where an id cannot be freed; those of LssMaster.
    """
    left_over = bench.lss.holds_any()
    bench.lss.release()
    if left_over:
        bench.clock.sleep(bench.boot_s)  # a killed master's device boots now, at an id that must be seen
    labelled = [seat for seat in seats if seat.identity is not None]
    _clear_other_ids(bench, labelled)
    done = {}
    for seat in labelled:
        done[seat.nest] = _address_labelled(bench, seat)
        tell(addressed_message(done[seat.nest]))
    for seat in (s for s in seats if s.identity is None):
        found = _address_unknown(bench, seat, hint)
        if found is not None:
            done[seat.nest] = found
            tell(addressed_message(found))
    return Commissioned(
        tuple(done[s.nest] for s in seats if s.nest in done), tuple(_findings(bench, seats, done, hint))
    )


def _clear_other_ids(bench: CommissioningBench, labelled: Sequence[NodeSeat]) -> None:
    """Finds every labelled device before anything is changed; then those at another id give it up."""
    present = []
    for seat in labelled:
        assert seat.identity is not None
        if not bench.lss.select(seat.identity):
            raise DeviceSilent("commission-label-silent", nest=seat.nest, serial=seat.identity.serial)
        present.append((seat.identity, seat.node, bench.lss.node_id()))
        bench.lss.release()
    for identity, target, node in present:
        if node not in (target, UNCONFIGURED):
            _give_up(bench, identity, node)


def _give_up(bench: CommissioningBench, identity: LssIdentity, node: int) -> None:
    if not bench.lss.select(identity):
        raise WrongUnit("commission-node-taken", node=node, serial=identity.serial)
    bench.lss.configure_node(UNCONFIGURED)
    bench.lss.store()
    bench.lss.release()
    bench.device(node).nmt("reset-communication")


def _address_labelled(bench: CommissioningBench, seat: NodeSeat) -> AddressedDevice:
    assert seat.identity is not None
    occupant = identity_at(bench, seat.node)
    if occupant not in (None, seat.identity):
        assert occupant is not None
        _give_up(bench, occupant, seat.node)
        if identity_at(bench, seat.node) is not None:
            raise WrongUnit("commission-node-taken", node=seat.node, serial=occupant.serial)
    if not bench.lss.select(seat.identity):
        raise DeviceSilent("commission-label-silent", nest=seat.nest, serial=seat.identity.serial)
    return _give(bench, seat, seat.identity, "label" if occupant != seat.identity else "stays")


def _address_unknown(bench: CommissioningBench, seat: NodeSeat, hint: LssIdentity | None) -> AddressedDevice | None:
    occupant = identity_at(bench, seat.node)
    if occupant is not None:
        if not bench.lss.select(occupant):
            raise WrongUnit("commission-node-taken", node=seat.node, serial=occupant.serial)
        return _give(bench, seat, occupant, "stays")
    found = bench.lss.scan(hint)
    return None if found is None else _give(bench, seat, found, "scan")


def _give(bench: CommissioningBench, seat: NodeSeat, identity: LssIdentity, how: How) -> AddressedDevice:
    """The selected device gets the id, which nobody else has; stored before it is active, then read there."""
    bench.lss.configure_node(seat.node)
    bench.lss.store()
    bench.lss.release()
    deadline_s = bench.clock.monotonic_s() + bench.boot_s
    while (there := identity_at(bench, seat.node)) is None and bench.clock.monotonic_s() < deadline_s:
        pass
    if there is None:
        raise DeviceSilent("commission-not-there", node=seat.node, serial=identity.serial, timeout_s=bench.boot_s)
    if there != identity:
        raise WrongUnit("commission-other-there", node=seat.node, serial=identity.serial, found=there.serial)
    return AddressedDevice(seat.nest, seat.node, identity, how)


def identity_at(bench: CommissioningBench, node: int) -> LssIdentity | None:
    """0x1018 of whoever answers at this id; None where nobody does. Errors: BusFault where two do."""
    device = bench.device(node)
    try:
        numbers = [int.from_bytes(device.upload(0x1018, sub, bench.probe_s), "little") for sub in range(1, 5)]
    except DeviceSilent:
        return None
    return LssIdentity(*numbers)


def _findings(
    bench: CommissioningBench, seats: Sequence[NodeSeat], done: dict[str, AddressedDevice], hint: LssIdentity | None
) -> list[Message]:
    found = [Message("commission-nest-empty", nest=s.nest, node=s.node) for s in seats if s.nest not in done]
    scanned = sum(d.how == "scan" for d in done.values())
    if scanned > 1:
        found.append(Message("commission-nest-unproven", count=scanned))
    if len(done) == len(seats):  # else a scan has just found nobody
        further = bench.lss.scan(hint)
        bench.lss.release()
        if further is not None:
            found.append(Message("commission-left-over", serial=further.serial))
    return found


def addressed_message(device: AddressedDevice) -> Message:
    """The sentence about a device that has its node id."""
    return Message(f"commission-{device.how}", nest=device.nest, node=device.node, serial=device.identity.serial)


def store_bit_rate(
    bench: CommissioningBench,
    devices: Sequence[AddressedDevice],
    kbit_s: int,
    tell: Callable[[Message], None] = lambda _: None,
) -> None:
    """Each device keeps another bit rate, from its next power-on: until then all still hear each other.

    Errors: DeviceSilent where one is gone; UsageError for a bit rate that LSS does not know; UnitFault where a device
    refuses it, with those before it set.
    """
    for device in devices:
        if not bench.lss.select(device.identity):
            raise DeviceSilent("commission-label-silent", nest=device.nest, serial=device.identity.serial)
        bench.lss.configure_bit_rate(kbit_s)
        bench.lss.store()
        bench.lss.release()
    tell(Message("commission-bit-rate", count=len(devices), kbit_s=kbit_s))
