"""The objects that a device map itself names: those of a simulated device for which nobody has an EDS."""

from collections.abc import Iterator

from station.domain.product import map_check, number_format, writeback
from station.domain.product.device_map import (
    DeviceMap,
    DeviceObject,
    DeviceSetting,
    NumberObject,
    OutputSwitch,
    SerialObject,
    StoreCommand,
    TextObject,
    UnlockObject,
    ValidFlag,
)
from station.domain.product.object_dictionary import TYPES, ObjectDictionary, ObjectEntry, Value
from station.domain.product.product import Product

_TYPE_OF_CODE = {code: kind for kind, (_, code) in TYPES.items() if code} | {"<B": 0x05}
_TYPE_OF_NAME = {name: kind for kind, (name, _) in TYPES.items()}


def mapped_objects(product: Product, node: int) -> ObjectDictionary:
    """Identity, coefficients that correct nothing, and whatever else the map names, each of the map's own type."""
    found = {entry.address: entry for entry in (*_identity(product), *_of_map(product.map))}
    return ObjectDictionary(node, found)


def _identity(product: Product) -> Iterator[ObjectEntry]:
    for (index, sub), value in product.identity.objects.items():
        kind = _TYPE_OF_NAME["STRING" if isinstance(value, str) else "UINT32"]
        yield ObjectEntry(index, sub, "identity", kind, "ro", value)


def _of_map(device_map: DeviceMap) -> Iterator[ObjectEntry]:
    neutral = writeback.neutral(device_map)
    for name, part, is_written in map_check.parts(device_map):
        kind = _type(part)
        access = "wo" if isinstance(part, StoreCommand | UnlockObject) else "rw" if is_written else "ro"
        entry = ObjectEntry(part.index, part.sub, name, kind, access, _default(part, kind))
        raw = neutral.get(part.address)
        yield entry if raw is None else ObjectEntry(part.index, part.sub, name, kind, access, entry.unpack(raw))


def _type(part: DeviceObject) -> int:
    if isinstance(part, NumberObject):
        return _TYPE_OF_CODE[number_format.parse(part.type).code]
    text = isinstance(part, TextObject) or (isinstance(part, SerialObject) and part.kind == "text")
    return _TYPE_OF_NAME["STRING" if text else "UINT32"]


def _default(part: DeviceObject, kind: int) -> Value:
    if isinstance(part, OutputSwitch):
        return part.raw
    if isinstance(part, ValidFlag):
        return part.valid
    if isinstance(part, DeviceSetting) and part.calibrating is not None:
        return part.sign * round(part.calibrating / part.scale)
    return "" if kind == _TYPE_OF_NAME["STRING"] else 0
