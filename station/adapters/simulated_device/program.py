"""The bootloader of a simulated device: two banks, of which one runs while the other is written (CiA 302-3)."""

import json
import zlib
from pathlib import Path

from canopen.sdo import constants as sdo

from station.adapters.simulated_device.sdo_serving import SdoAbort
from station.domain.product.firmware import CLEAR, PROGRAM_CONTROL, PROGRAM_DATA, START, STOP
from station.files.replace import replace_text

LARGEST = 1 << 20
#: The first bytes of an image are its version, as text.
VERSION_BYTES = 16
_NO_PROGRAM = 1 << 1


class SimulatedProgram:
    """path: file of what runs; None: it lives as long as this value. A written image is lost with the power until it is
    started; then it runs, whole."""

    def __init__(self, path: Path | None, factory_version: str) -> None:
        self._path = path
        self.software_id, self.version = zlib.crc32(factory_version.encode()), factory_version
        self._written: bytes | None = None
        self._cleared = False
        if path is not None and path.exists():
            kept = json.loads(path.read_text(encoding="utf-8"))
            self.software_id, self.version = kept["software_id"], kept["version"]

    @property
    def status(self) -> int:
        """0x1F57."""
        if self._cleared:
            return 0 if self._written is not None else _NO_PROGRAM
        return 0

    def restart(self) -> None:
        """What was not started is forgotten."""
        self._written, self._cleared = None, False

    def check(self, index: int, size: int | None) -> None:
        """Whether data may come. Errors: SdoAbort."""
        if index == PROGRAM_DATA and not self._cleared:
            raise SdoAbort(sdo.ABORT_APPLICATION_DEVICE_STATE)
        if size is not None and size > LARGEST:
            raise SdoAbort(sdo.ABORT_LENGTH_TOO_HIGH)

    def write(self, index: int, data: bytes) -> None:
        """Takes an image, or a command. Errors: SdoAbort."""
        if index == PROGRAM_DATA:
            self._written = data
        elif index == PROGRAM_CONTROL:
            self._command(data[0])

    def _command(self, value: int) -> None:
        if value == CLEAR:
            self._written, self._cleared = None, True
        elif value == START:
            if self._written is None:
                raise SdoAbort(sdo.ABORT_APPLICATION_DEVICE_STATE)
            self._swap(self._written)
        elif value != STOP:
            raise SdoAbort(sdo.ABORT_INVALID_VALUE)

    def _swap(self, image: bytes) -> None:
        self.software_id = zlib.crc32(image)
        self.version = image[:VERSION_BYTES].split(b"\0")[0].decode("latin-1")
        self.restart()
        if self._path is not None:
            kept = {"software_id": self.software_id, "version": self.version}
            replace_text(self._path, json.dumps(kept), durable=True)
