"""Offsets that nobody writes: the device, at rest, is given the reading that it should show, and works its offset out.

Source: CiA 410, slope preset value: offset = preset − slope measured at the moment of the access − differential offset.
Pure; `station.service.preset_offset` sends the commands, the simulated device obeys them by the same formula.
"""

from dataclasses import dataclass

from station.domain.product import number_format
from station.domain.product.device_map import DeviceMap, NumberObject
from station.domain.product.writeback import Address


@dataclass(frozen=True, slots=True)
class PresetAxis:
    """One axis: where its offset stands, where it is read, where the command goes. direction: what one more of the
    offset does to the reading, −1 where the device takes it off, 1 where it adds it."""

    name: str
    offset: NumberObject
    reading: NumberObject
    command: NumberObject
    direction: int

    def preset_for(self, reading: bytes, held: bytes, wanted: bytes) -> bytes:
        """The command after which a device that reads `reading` with the offset `held` holds the offset `wanted`.

        Errors: InvalidValue where the command's type cannot hold it.
        """
        change = _value(self.offset, wanted) - _value(self.offset, held)
        return _bytes(self.command, _value(self.reading, reading) + self.direction * change)

    def offset_after(self, reading: bytes, held: bytes, command: bytes) -> bytes:
        """The offset that the device works out. Errors: InvalidValue where the offset's type cannot hold it."""
        change = _value(self.command, command) - _value(self.reading, reading)
        return _bytes(self.offset, _value(self.offset, held) + self.direction * change)


def preset_axes(device_map: DeviceMap) -> dict[Address, PresetAxis]:
    """Address of each offset → how it is reached; nothing where offsets are written."""
    preset, offset = device_map.preset, device_map.offset
    if preset is None or offset is None:
        return {}
    direction = 1 if device_map.stores == "inverse-add" else -1
    places = zip(offset.cells(), preset.reading.cells(), preset.command.cells(), strict=True)
    return {
        o.address: PresetAxis(axis, o, reading, command, direction) for (axis, o), (_, reading), (_, command) in places
    }


def _value(number: NumberObject, raw: bytes) -> float:
    return number.sign * number_format.parse(number.type).decode(raw) * number.scale


def _bytes(number: NumberObject, value: float) -> bytes:
    return number_format.parse(number.type).encode(number.sign * value / number.scale)
