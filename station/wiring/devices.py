"""The devices of a bench, by the protocol of its product, and who else commands them."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.metadata import entry_points

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.foreign_traffic import ForeignTrafficWatch
from station.adapters.canopen.network import SentListener, ServiceNetwork, service_ids
from station.adapters.object_access.client import ObjectClient
from station.adapters.object_access.device import ObjectDevice
from station.adapters.object_access.frame_transport import FrameTransport
from station.adapters.object_access.sending_device import SendingDevice
from station.adapters.object_access.template import TemplateProtocol, template_written
from station.domain.product import map_check, number_format
from station.domain.product.access import TemplateAccess, UdsAccess
from station.domain.product.device_map import DeviceMap, NumberObject
from station.domain.product.product import Product
from station.errors import ProductError
from station.ports.bus import Bus
from station.ports.clock import Clock
from station.ports.device import Device
from station.service.preset_offset import with_presets

#: Installed packages that make keys name them here (docs/device-map.md).
KEYS = "station.uds_keys"
Address = tuple[int, int]
SeedKey = Callable[[int, bytes], bytes]


def open_devices(
    bus: Bus, clock: Clock, nodes: Sequence[int], product: Product, answer_s: float
) -> tuple[Callable[[int], Device], ForeignTrafficWatch]:
    """One device a node for as long as the bus is open: boot-ups and quarantines outlive a fixture load.

    Errors: ProductError where a key algorithm or a library is missing; BusFault.
    """
    device_map, nodes = product.map, tuple(nodes)
    access = device_map.uds or device_map.template
    if device_map.protocol == "none":
        senders = {node: SendingDevice(node) for node in nodes}
        return senders.__getitem__, ForeignTrafficWatch(bus, nodes, {})
    if access is None:
        foreign = ForeignTrafficWatch(bus, nodes)
        network = ServiceNetwork(bus.service(service_ids(nodes)), clock, foreign.sent)
        timeouts, sizes = device_map.timeouts(), number_sizes(device_map)
        made: Mapping[int, Device] = {
            node: with_presets(
                CanopenDevice(network, node, answer_s=answer_s, timeouts_s=timeouts, sizes=sizes), device_map
            )
            for node in nodes
        }
        return made.__getitem__, foreign
    ids = {node: access.of_node(node, product.frames.node_of_dbc) for node in nodes}
    written = _written(access)
    foreign = ForeignTrafficWatch(bus, nodes, {node: request for node, (request, _) in ids.items()}, written)
    answers = tuple(dict.fromkeys(response for _, response in ids.values()))
    network = _network(bus, clock, answers, foreign.sent)
    made = {
        node: with_presets(ObjectDevice(network, _client(network, node, ids[node], product, answer_s)), device_map)
        for node in nodes
    }
    return made.__getitem__, foreign


def seed_key(device_map: DeviceMap) -> SeedKey | None:
    """What makes the keys of a locked UDS device; None where it is not locked. Errors: ProductError."""
    security = None if device_map.uds is None else device_map.uds.security
    if security is None:
        return None
    found = {point.name: point for point in entry_points(group=KEYS)}
    if security.algorithm not in found:
        raise ProductError("uds-key-missing", file="uds", algorithm=security.algorithm, known=tuple(found))
    key: SeedKey = found[security.algorithm].load()
    return key


def _network(bus: Bus, clock: Clock, answers: tuple[int, ...], sent: SentListener) -> ServiceNetwork:
    return ServiceNetwork(bus.service(answers), clock, sent)


def _client(
    network: ServiceNetwork, node: int, ids: tuple[int, int], product: Product, answer_s: float
) -> ObjectClient:
    device_map, (request_id, response_id) = product.map, ids
    if device_map.uds is not None:
        return _uds_client(network, node, (request_id, response_id), device_map, device_map.uds, answer_s)
    assert device_map.template is not None
    commands = {c.address: name for name in ("save", "restore") if (c := getattr(device_map, name)) is not None}
    readable = (*map_check.readable(device_map), *sorted(product.identity.required))
    protocol = TemplateProtocol(device_map.template, node, number_sizes(device_map), commands, readable)
    transport = FrameTransport(network, request_id, response_id)
    return ObjectClient(network, node, protocol, transport, answer_s, device_map.timeouts())


def _uds_client(
    network: ServiceNetwork, node: int, ids: tuple[int, int], device_map: DeviceMap, access: UdsAccess, answer_s: float
) -> ObjectClient:
    try:
        from station.adapters.object_access.isotp_transport import IsoTpTransport
        from station.adapters.object_access.uds import UdsProtocol
    except ModuleNotFoundError:
        raise ProductError("uds-not-installed") from None
    commands = (device_map.save, device_map.restore)
    protocol = UdsProtocol(
        session=access.session,
        pending_s=access.pending_s,
        routines={c.address: sum(c.address) for c in commands if c is not None},
        numbers=frozenset(number_sizes(device_map)) if access.byte_order == "big" else frozenset(),
        level=1 if access.security is None else access.security.level,
        key=seed_key(device_map),
    )
    return ObjectClient(network, node, protocol, IsoTpTransport(network, *ids), answer_s, device_map.timeouts())


def _written(access: UdsAccess | TemplateAccess) -> Callable[[bytes], Address | None]:
    if isinstance(access, TemplateAccess):
        return partial(template_written, access)
    try:
        from station.adapters.object_access.uds import uds_written
    except ModuleNotFoundError:
        raise ProductError("uds-not-installed") from None
    return uds_written


def number_sizes(device_map: DeviceMap) -> dict[Address, int]:
    """Bytes of every object of the map that keeps a number."""
    sizes = {
        o.address: number_format.parse(o.type).size
        for o in map_check.objects_of(device_map)
        if isinstance(o, NumberObject)
    }
    if (serial := device_map.serial_object) is not None and serial.kind == "number":
        sizes.setdefault(serial.address, 4)
    if device_map.checksum is not None:
        sizes[device_map.checksum.address] = 4
    return sizes
