"""A device whose offsets come about by preset commands, as one whose offsets are written.

So write-back, put-back and recovery know nothing of presets. The reading of the moment carries noise, and the offset
with it: the command is repeated until the device holds the wanted number to the count, or it is no success.
"""

from collections.abc import Collection

from station.domain.product.device_map import DeviceMap
from station.domain.product.preset import PresetAxis, preset_axes
from station.domain.product.sdo_codes import address
from station.domain.product.writeback import Address
from station.errors import InvalidValue, UnitFault
from station.ports.device import Device, Emergency, Identity


def with_presets(device: Device, device_map: DeviceMap) -> Device:
    """The device itself where its offsets are written."""
    return device if device_map.preset is None else PresetDevice(device, device_map, device_map.preset.tries)


class PresetDevice:
    """Implements Device. The writes of `device_map`'s offsets become preset commands, `tries` of each at most."""

    def __init__(self, device: Device, device_map: DeviceMap, tries: int) -> None:
        self._device, self._tries = device, tries
        self._axes: dict[Address, PresetAxis] = preset_axes(device_map)

    @property
    def node(self) -> int:
        """As of the device."""
        return self._device.node

    def download(self, index: int, sub: int, data: bytes, timeout_s: float | None = None) -> None:
        """Writes an object; an offset by commands. Errors: UnitFault where it is not reached, or out of range."""
        axis = self._axes.get((index, sub))
        if axis is None:
            self._device.download(index, sub, data, timeout_s)
            return
        for _ in range(self._tries):
            held = self._device.upload(index, sub)
            if held == data:
                return
            self._device.download(*axis.command.address, self._preset(axis, held, data), timeout_s)
        if self._device.upload(index, sub) != data:
            where = {"axis": axis.name, "object": address(*axis.command.address), "offset": address(index, sub)}
            raise UnitFault("preset-missed", node=self.node, tries=self._tries, **where)

    def _preset(self, axis: PresetAxis, held: bytes, wanted: bytes) -> bytes:
        try:
            return axis.preset_for(self._device.upload(*axis.reading.address), held, wanted)
        except InvalidValue as exc:
            where = address(*axis.command.address)
            raise UnitFault(
                "preset-out-of-range", node=self.node, axis=axis.name, object=where, why=exc.message
            ) from None

    def identify(self, asked: Collection[Address] = ((0x1000, 0),)) -> Identity:
        """As of the device."""
        return self._device.identify(asked)

    def upload(self, index: int, sub: int, timeout_s: float | None = None) -> bytes:
        """As of the device."""
        return self._device.upload(index, sub, timeout_s)

    def nmt(self, command: str) -> None:
        """As of the device."""
        self._device.nmt(command)

    def wait_boot_up(self, timeout_s: float) -> None:
        """As of the device."""
        self._device.wait_boot_up(timeout_s)

    def state(self) -> str:
        """As of the device."""
        return self._device.state()

    def heartbeat_age_s(self) -> float:
        """As of the device."""
        return self._device.heartbeat_age_s()

    def heartbeats(self) -> int:
        """As of the device."""
        return self._device.heartbeats()

    def emergencies(self) -> tuple[Emergency, ...]:
        """As of the device."""
        return self._device.emergencies()

    def boot_ups(self) -> int:
        """As of the device."""
        return self._device.boot_ups()
