"""A device map against the device's own EDS: what would be refused half-way through a write is found at the desk."""

from collections.abc import Iterator, Mapping

from station.domain.product import number_format
from station.domain.product.device_map import DeviceMap, DeviceObject, NumberObject, StoreCommand, UnlockObject
from station.domain.product.object_dictionary import TYPES, ObjectDictionary, ObjectEntry
from station.domain.product.preset import preset_axes
from station.domain.product.sdo_codes import address
from station.messages import Message

_BYTES = ("<?", "<B")


def mismatches(device_map: DeviceMap, dictionary: ObjectDictionary) -> tuple[Message, ...]:
    """Every contradiction: objects that are missing, of another type, not writable, or of less range."""
    return tuple(_mismatches(device_map, dictionary))


def addresses(device_map: DeviceMap) -> frozenset[tuple[int, int]]:
    """Every object that the map uses."""
    return frozenset(part.address for _, part, _ in parts(device_map))


def readable(device_map: DeviceMap) -> tuple[tuple[int, int], ...]:
    """Every object of the map that has a value, coefficients first."""
    commands = (StoreCommand, UnlockObject)
    return tuple(part.address for _, part, _ in parts(device_map) if not isinstance(part, commands))


def objects_of(device_map: DeviceMap) -> Iterator[DeviceObject]:
    """Every object that the map uses."""
    return (part for _, part, _ in parts(device_map))


def _mismatches(device_map: DeviceMap, dictionary: ObjectDictionary) -> Iterator[Message]:
    for name, part, is_written in parts(device_map):
        where = {"name": name, "object": address(*part.address)}
        if part.address not in dictionary:
            yield Message("map-object-missing", **where)
            continue
        entry = dictionary[part.address]
        if is_written and not entry.writable:
            yield Message("map-object-not-writable", access=entry.access, **where)
        if isinstance(part, NumberObject):
            yield from _type(where, part, entry)
    for name, number in device_map.coefficients():
        if number.address in dictionary:
            where = {"name": name, "object": address(*number.address)}
            yield from _range(where, number, device_map.nominal(name), dictionary[number.address])


def parts(device_map: DeviceMap) -> Iterator[tuple[str, DeviceObject, bool]]:
    """(name, object, whether it is written)."""
    for name, number in device_map.coefficients():
        yield name, number, device_map.preset is None
    for axis in preset_axes(device_map).values():
        yield f"preset {axis.name}", axis.command, True
        yield f"reading {axis.name}", axis.reading, False
    for name in ("switch", "unlock", "valid", "temperature", "record", "save", "restore"):
        part: DeviceObject | None = getattr(device_map, name)
        if name == "save" and not device_map.writes:
            continue
        if part is not None:
            yield "output" if name == "switch" else name, part, True
    for setting in device_map.settings:
        yield setting.name, setting, setting.calibrating is not None
    if device_map.serial_object is not None:
        yield "serial", device_map.serial_object, False
    if device_map.checksum is not None:
        yield "checksum", device_map.checksum, False


def _type(where: Mapping[str, str], number: NumberObject, entry: ObjectEntry) -> Iterator[Message]:
    ours, theirs = number_format.parse(number.type).code, TYPES[entry.type][1]
    if ours != theirs and not (ours in _BYTES and theirs in _BYTES):
        yield Message("map-type-differs", type=number.type, eds_type=entry.type_name, **where)


def _range(where: Mapping[str, str], number: NumberObject, nominal: float, entry: ObjectEntry) -> Iterator[Message]:
    """Whether the device may refuse a value that the map lets through."""
    if number.limits is None or (entry.low is None and entry.high is None):
        return
    step = number_format.parse(number.type).step or 1.0
    ends = sorted(number.sign * (limit - nominal) / number.scale / step for limit in number.limits)
    low = entry.low if entry.low is not None else ends[0]
    high = entry.high if entry.high is not None else ends[1]
    if ends[0] < low or ends[1] > high:
        yield Message("map-range-differs", low=ends[0], high=ends[1], eds_low=low, eds_high=high, **where)
