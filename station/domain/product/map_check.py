"""A device map against the device's own EDS: what would be refused half-way through a write is found at the desk."""

from collections.abc import Iterator

from station.domain.product import number_format
from station.domain.product.device_map import DeviceMap, DeviceObject, NumberObject
from station.domain.product.object_dictionary import TYPES, ObjectDictionary, ObjectEntry
from station.domain.product.sdo_codes import address

_BYTES = ("<?", "<B")


def mismatches(device_map: DeviceMap, dictionary: ObjectDictionary) -> tuple[str, ...]:
    """Every contradiction in words: objects that are missing, of another type, not writable, or of less range."""
    return tuple(_mismatches(device_map, dictionary))


def _mismatches(device_map: DeviceMap, dictionary: ObjectDictionary) -> Iterator[str]:
    for name, part, is_written in _parts(device_map):
        where = f"{name} at {address(*part.address)}"
        if part.address not in dictionary:
            yield f"{where} is not in the EDS"
            continue
        entry = dictionary[part.address]
        if is_written and not entry.writable:
            yield f"{where} is {entry.access} in the EDS, so it cannot be written"
        if isinstance(part, NumberObject):
            yield from _type(where, part, entry)
    for name, number in device_map.coefficients():
        if number.address in dictionary:
            where = f"{name} at {address(*number.address)}"
            yield from _range(where, number, device_map.nominal(name), dictionary[number.address])


def _parts(device_map: DeviceMap) -> Iterator[tuple[str, DeviceObject, bool]]:
    """(name, object, whether it is written)."""
    for name, number in device_map.coefficients():
        yield name, number, True
    for name in ("output", "unlock", "valid", "temperature", "record", "save", "restore"):
        part: DeviceObject | None = getattr(device_map, name)
        if part is not None:
            yield name, part, True
    for setting in device_map.settings:
        yield setting.name, setting, setting.calibrating is not None
    yield "serial", device_map.serial, False
    if device_map.checksum is not None:
        yield "checksum", device_map.checksum, False


def _type(where: str, number: NumberObject, entry: ObjectEntry) -> Iterator[str]:
    ours, theirs = number_format.parse(number.type).code, TYPES[entry.type][1]
    if ours != theirs and not (ours in _BYTES and theirs in _BYTES):
        yield f"{where} is {number.type} in the map but {entry.type_name} in the EDS"


def _range(where: str, number: NumberObject, nominal: float, entry: ObjectEntry) -> Iterator[str]:
    """Whether the device may refuse a value that the map lets through."""
    if number.limits is None or (entry.low is None and entry.high is None):
        return
    step = number_format.parse(number.type).step or 1.0
    ends = sorted(number.sign * (limit - nominal) / number.scale / step for limit in number.limits)
    low = entry.low if entry.low is not None else ends[0]
    high = entry.high if entry.high is not None else ends[1]
    if ends[0] < low or ends[1] > high:
        yield f"{where} keeps {ends[0]:g} to {ends[1]:g} by the map, but the EDS allows {low:g} to {high:g}"
