"""Firmware: what an image is for (`station.firmware/1`), what a recipe wants, and what a device says of its own."""

import zlib
from collections.abc import Iterator
from fnmatch import fnmatchcase
from typing import Annotated, Literal

from pydantic import Field

from station.domain.product.product import ProductIdentity
from station.domain.recipe.blocks import FirmwareGate
from station.domain.recipe.fields import Name, StrictModel
from station.messages import Message

#: Program data, control, software identification and status (CiA 302-3); the sub-index is the program's number.
PROGRAM_DATA, PROGRAM_CONTROL, SOFTWARE_ID, PROGRAM_STATUS = 0x1F50, 0x1F51, 0x1F56, 0x1F57
#: Values of the program control.
STOP, START, CLEAR = 0x00, 0x01, 0x03
#: Bit of the status that says the device is busy, and those of its error; 0 is no error.
BUSY, ERROR_SHIFT, ERROR_MASK = 0x01, 1, 0x7F
#: Errors of the status by number (CiA 302-3, object 0x1F57).
_ERRORS = {
    1: "program-none",
    2: "program-format",
    3: "program-crc",
    4: "program-not-cleared",
    5: "program-not-written",
    6: "program-address",
    7: "program-secured",
    8: "program-memory",
}


class FirmwareImage(StrictModel):
    """A firmware file and the devices that it is for. image: file beside this one; sha256: of it; version: as 0x100A
    reads afterwards, '' where it does not say; software_id: as 0x1F56 reads, left out: the CRC-32 of the image;
    hardware: versions (0x1009) that may have it, `*` stands for anything; program: its number, from 1."""

    schema_: Annotated[Literal["station.firmware/1"], Field(alias="schema")]
    image: Name
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    version: str = ""
    software_id: Annotated[int, Field(ge=0, le=0xFFFF_FFFF)] | None = None
    identity: ProductIdentity
    hardware: tuple[str, ...] = ()
    program: Annotated[int, Field(ge=1, le=254)] = 1

    def expected_id(self, data: bytes) -> int:
        """What 0x1F56 must read when this image runs."""
        return zlib.crc32(data) if self.software_id is None else self.software_id


def hardware_refusal(image: FirmwareImage, hardware: str) -> Message | None:
    """Why a device of this hardware version must not have the image; None when it may."""
    if not image.hardware or any(fnmatchcase(hardware, allowed) for allowed in image.hardware):
        return None
    return Message("firmware-other-hardware", read=hardware, allowed=image.hardware)


def gate_refusals(gate: FirmwareGate, software: str, software_id: int | None) -> Iterator[Message]:
    """Why a recipe does not want a unit with this software; software_id: None where the device does not say."""
    if gate.versions and not any(fnmatchcase(software, wanted) for wanted in gate.versions):
        yield Message("firmware-other-version", read=software, wanted=gate.versions)
    if gate.software_id is not None and software_id != gate.software_id:
        read = "-" if software_id is None else f"0x{software_id:08X}"
        yield Message("firmware-other-id", read=read, wanted=f"0x{gate.software_id:08X}")


def status_error(status: int) -> Message | None:
    """What the program status says is wrong; None for nothing."""
    number = status >> ERROR_SHIFT & ERROR_MASK
    return None if number == 0 else Message(_ERRORS.get(number, "program-error"), number=number)
