"""Program download (CiA 302-3): nothing is touched before the image is known to be for this device; then stop, clear,
download, status, start, and the software identification as proof.

Broken off anywhere, the same call goes on: it begins with the clear again, and a device that runs the image already is
left alone. What runs meanwhile is the bootloader's business: one with two banks keeps the old program until the new one
is whole.
"""

from collections.abc import Callable
from dataclasses import dataclass

from station.domain.product import firmware
from station.domain.product.firmware import FirmwareImage
from station.errors import DeviceRefused, DeviceSilent, UnitFault, WrongProduct
from station.messages import Message
from station.ports.clock import Clock
from station.ports.device import Device

#: The device may think about a clear or an image for so long, s.
ERASE_S, PROGRAM_S, POLL_S = 30.0, 30.0, 0.05


@dataclass(frozen=True, slots=True)
class Flashed:
    """What came of it: how the device ended, software identification before and after, and seconds of the download."""

    how: str
    before: int | None
    after: int | None
    download_s: float = 0.0


class ProgramDownload:
    """One image for one device. data: its bytes; tell: of each step."""

    def __init__(
        self, device: Device, clock: Clock, image: FirmwareImage, data: bytes, tell: Callable[[Message], None]
    ) -> None:
        self._device, self._clock, self._tell = device, clock, tell
        self._image, self._data = image, data

    def run(self, boot_s: float, check: Callable[[], tuple[Message, ...]]) -> Flashed:
        """check: what the identity objects say against the image. Errors: WrongProduct before anything is touched;
        UnitFault where the device refuses the program; DeviceSilent, DeviceRefused."""
        if wrong := check():
            raise WrongProduct("firmware-not-for-device", node=self._device.node, image=self._image.image, why=wrong)
        expected, before = self._image.expected_id(self._data), self._software_id()
        if before == expected:
            return Flashed("stays", before, before)
        self._tell(Message("flash-begins", node=self._device.node, image=self._image.image, count=len(self._data)))
        self._control(firmware.STOP)
        self._control(firmware.CLEAR)
        began_s = self._clock.monotonic_s()
        self._device.download(firmware.PROGRAM_DATA, self._image.program, self._data, PROGRAM_S)
        download_s = self._clock.monotonic_s() - began_s
        self._wait_status()
        self._device.download(firmware.PROGRAM_CONTROL, self._image.program, bytes([firmware.START]))
        self._device.nmt("reset-node")
        self._device.wait_boot_up(boot_s)
        after = self._software_id()
        if after != expected:
            read = "-" if after is None else f"0x{after:08X}"
            raise UnitFault("flash-other-id", node=self._device.node, read=read, wanted=f"0x{expected:08X}")
        return Flashed("flashed", before, after, download_s)

    def _control(self, value: int) -> None:
        self._device.download(firmware.PROGRAM_CONTROL, self._image.program, bytes([value]), ERASE_S)
        self._wait_status()

    def _wait_status(self) -> None:
        """Waits while the device is busy. Errors: UnitFault with what its status says."""
        deadline_s = self._clock.monotonic_s() + PROGRAM_S
        while True:
            raw = self._device.upload(firmware.PROGRAM_STATUS, self._image.program)
            status = int.from_bytes(raw, "little")
            if not status & firmware.BUSY:
                break
            if self._clock.monotonic_s() > deadline_s:
                raise DeviceSilent("flash-stays-busy", node=self._device.node, timeout_s=PROGRAM_S)
            self._clock.sleep(POLL_S)
        # Nothing in the memory is no error of a program that was just cleared.
        if (error := firmware.status_error(status)) is not None and error.id != "program-none":
            raise UnitFault("flash-refused", node=self._device.node, reason=error)

    def _software_id(self) -> int | None:
        """0x1F56; None where the device has none: no program, or no such object."""
        return read_software_id(self._device, self._image.program)


def read_software_id(device: Device, program: int = 1) -> int | None:
    """0x1F56 of a program; None where the device has no such object."""
    try:
        return int.from_bytes(device.upload(firmware.SOFTWARE_ID, program), "little")
    except DeviceRefused:
        return None
