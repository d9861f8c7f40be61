"""SDO abort codes (CiA 301, table 22) as messages, and an object's address as people write it."""

from collections.abc import Mapping
from types import MappingProxyType

from station.messages import Message

#: "Because of the present device state": in another one it may be possible.
DEVICE_STATE = 0x08000022
#: Abort code → message.
ABORT: Mapping[int, str] = MappingProxyType(
    {
        0x05030000: "abort-toggle-bit",
        0x05040000: "abort-timed-out",
        0x05040001: "abort-unknown-command",
        0x05040002: "abort-block-size",
        0x05040003: "abort-sequence-number",
        0x05040004: "abort-crc",
        0x05040005: "abort-out-of-memory",
        0x06010000: "abort-no-access",
        0x06010001: "abort-write-only",
        0x06010002: "abort-read-only",
        0x06020000: "abort-no-object",
        0x06040041: "abort-not-mappable",
        0x06040042: "abort-mapping-too-long",
        0x06040043: "abort-parameters-incompatible",
        0x06040047: "abort-device-incompatible",
        0x06060000: "abort-hardware",
        0x06070010: "abort-wrong-length",
        0x06070012: "abort-too-long",
        0x06070013: "abort-too-short",
        0x06090011: "abort-no-sub-index",
        0x06090030: "abort-out-of-range",
        0x06090031: "abort-too-high",
        0x06090032: "abort-too-low",
        0x06090036: "abort-limits-swapped",
        0x060A0023: "abort-no-resource",
        0x08000000: "abort-general",
        0x08000020: "abort-not-stored",
        0x08000021: "abort-local-control",
        DEVICE_STATE: "abort-device-state",
        0x08000023: "abort-no-dictionary",
        0x08000024: "abort-no-data",
    }
)


def address(index: int, sub: int) -> str:
    """An object's address as people write it: 0x2101:03."""
    return f"0x{index:04X}:{sub:02X}"


def meaning(code: int) -> Message:
    """What an abort code means; one that CiA 301 does not define is specific to the manufacturer."""
    return Message(ABORT.get(code, "abort-manufacturer-specific"))
