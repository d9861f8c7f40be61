"""A product's messages against the PDO mapping of its EDS: a DBC of another firmware would be read wrong in silence."""

from collections.abc import Iterator
from dataclasses import dataclass

from station.domain.can.sensor_layout import SensorLayout
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.core.types import EXTENDED
from station.domain.product.device_map import DeviceMap
from station.domain.product.object_dictionary import ObjectDictionary
from station.domain.product.sdo_codes import address
from station.domain.product.sending_pdo import COB_ID, COMMUNICATION, MAPPING, SendingPdo
from station.messages import Message, Value

#: TPDOs that are looked through.
MOST_PDOS = 512
_SIGNED = ("INT8", "INT16", "INT32", "INT64")
_UNSIGNED = ("UINT8", "UINT16", "UINT32", "UINT64", "BOOLEAN")


@dataclass(frozen=True, slots=True)
class MappedObject:
    """An object in a PDO: address, first bit, length, and name of its type; '' where the EDS does not know it."""

    at: tuple[int, int]
    first_bit: int
    length: int
    type_name: str

    @property
    def end_bit(self) -> int:
        """First bit behind it."""
        return self.first_bit + self.length


@dataclass(frozen=True, slots=True)
class MappedPdo:
    """A TPDO of an EDS, sent or switched off. number: from 0; can_id: with the kernel's flag."""

    number: int
    can_id: int
    objects: tuple[MappedObject, ...]


def mapped_pdos(dictionary: ObjectDictionary) -> Iterator[MappedPdo]:
    """Every TPDO, in the order of their numbers."""
    for number in range(MOST_PDOS):
        entry = dictionary.entries.get((COMMUNICATION + number, COB_ID))
        if entry is not None and isinstance(entry.default, int):
            objects = tuple(_placed(_entries(dictionary, number), dictionary))
            yield MappedPdo(number, SendingPdo(number, entry.default, 0, None, ()).can_id, objects)


def pdo_mismatches(layout: SensorLayout, device_map: DeviceMap, dictionary: ObjectDictionary) -> tuple[Message, ...]:
    """Every contradiction between the messages that a product reads and the PDOs that carry them.

    A PDO is found by its identifier; the map's `pdo` block counts before the EDS. A message that no PDO of the EDS has
    is not judged, nor is one whose mapping the EDS leaves open.
    """
    temperature = () if layout.temperature is None else (layout.temperature,)
    return tuple(
        mismatch
        for message in (*layout.messages, *temperature)
        for mismatch in _of_message(message, _mapped(message, device_map, dictionary), _used(layout, message))
    )


def _used(layout: SensorLayout, message: FrameLayout) -> tuple[SignalLayout, ...]:
    """Signals of the message that play a role."""
    roles = layout.map.sample
    places = [roles.place(name) for names in roles.axes for name in names]
    names = {signal for of, signal in places if of == message.name}
    if message.name == layout.sample.name:
        names |= set(roles.controls)
    if layout.map.temperature is not None and layout.map.temperature.message == message.name:
        names.add(layout.map.temperature.signal)
    return tuple(signal for signal in message.signals if signal.name in names)


def _mapped(message: FrameLayout, device_map: DeviceMap, dictionary: ObjectDictionary) -> tuple[MappedObject, ...]:
    """The objects of the PDO with the message's identifier, in their order; nothing where there is none to compare."""
    for number in range(MOST_PDOS):
        if (COMMUNICATION + number, COB_ID) not in dictionary:
            return ()
        entry = dictionary[COMMUNICATION + number, COB_ID].default
        setup = next((s for s in device_map.pdo if s.number == number + 1), None)
        can_id = int(entry) if isinstance(entry, int) else 0
        own = SendingPdo(number, can_id, 0, None, ()).can_id
        if setup is not None and setup.can_id is not None:
            own = setup.can_id | (EXTENDED if setup.can_id > 0x7FF else 0)
        if own == message.can_id:
            entries = _entries(dictionary, number) if setup is None or setup.mapping is None else setup.mapping
            return tuple(_placed(entries, dictionary))
    return ()


def _entries(dictionary: ObjectDictionary, number: int) -> tuple[int, ...]:
    def value(sub: int) -> int:
        entry = dictionary.entries.get((MAPPING + number, sub))
        return int(entry.default) if entry is not None and isinstance(entry.default, int) else 0

    return tuple(found for sub in range(1, min(value(0), 64) + 1) if (found := value(sub)))


def _placed(entries: tuple[int, ...], dictionary: ObjectDictionary) -> Iterator[MappedObject]:
    at = 0
    for entry in entries:
        place, length = (entry >> 16, entry >> 8 & 0xFF), entry & 0xFF
        known = dictionary.entries.get(place)
        yield MappedObject(place, at, length, "" if known is None else known.type_name)
        at += length


def _of_message(
    message: FrameLayout, mapped: tuple[MappedObject, ...], used: tuple[SignalLayout, ...]
) -> Iterator[Message]:
    if not mapped:
        return
    bits = mapped[-1].end_bit
    if -(-bits // 8) != message.length:
        yield Message("pdo-length-differs", message=message.name, dbc=message.length, eds=-(-bits // 8))
    for signal in used:
        yield from _of_signal(message.name, signal, mapped)


def _of_signal(message: str, signal: SignalLayout, mapped: tuple[MappedObject, ...]) -> Iterator[Message]:
    """A signal is an object, or some bits of one; CANopen sends the least significant byte first (CiA 301, 7.1.4)."""
    where = {"message": message, "signal": signal.name}
    if signal.big_endian:
        if signal.length > 8:
            yield Message("pdo-signal-big-endian", **where)
        return
    first, end = signal.first_bit, signal.first_bit + signal.length
    holder = next((o for o in mapped if o.first_bit <= first < o.end_bit), None)
    if holder is None:
        yield Message("pdo-signal-not-mapped", first=first, **where)
    elif end > holder.end_bit:
        own: dict[str, Value] = {
            "object": address(*holder.at),
            "object_first": holder.first_bit,
            "object_last": holder.end_bit - 1,
        }
        yield Message("pdo-signal-across", first=first, last=end - 1, **own, **where)
    elif (first, end) == (holder.first_bit, holder.end_bit) and holder.type_name in (
        _UNSIGNED if signal.signed else _SIGNED
    ):
        yield Message("pdo-signal-sign", object=address(*holder.at), type=holder.type_name, **where)
