"""UDS in numbers: data identifiers of objects, and negative response codes as messages (ISO 14229-1, annex A.1)."""

from collections.abc import Mapping
from types import MappingProxyType

from station.messages import Message

#: CANopen's identity texts as data identifiers (ISO 14229-1, table C.1): system name, hardware, software version.
IDENTITY: Mapping[tuple[int, int], int] = MappingProxyType(
    {(0x1008, 0): 0xF197, (0x1009, 0): 0xF193, (0x100A, 0): 0xF195}
)
#: Objects of CANopen's communication profile, which a UDS device does not have.
_COMMUNICATION = range(0x1000, 0x2000)

#: Negative response code → message.
NEGATIVE: Mapping[int, str] = MappingProxyType(
    {
        0x10: "uds-general-reject",
        0x11: "uds-service-unknown",
        0x12: "uds-sub-function-unknown",
        0x13: "uds-wrong-length",
        0x14: "uds-answer-too-long",
        0x21: "uds-busy",
        0x22: "uds-conditions",
        0x24: "uds-wrong-sequence",
        0x25: "uds-subnet-silent",
        0x26: "uds-failure-prevents",
        0x31: "uds-out-of-range",
        0x33: "uds-locked",
        0x35: "uds-wrong-key",
        0x36: "uds-too-many-keys",
        0x37: "uds-key-delay",
        0x70: "uds-transfer-not-accepted",
        0x71: "uds-transfer-suspended",
        0x72: "uds-programming-failed",
        0x73: "uds-wrong-block",
        0x7E: "uds-sub-function-not-in-session",
        0x7F: "uds-not-in-session",
        0x81: "uds-engine-too-fast",
        0x82: "uds-engine-too-slow",
        0x83: "uds-engine-running",
        0x84: "uds-engine-off",
        0x85: "uds-engine-too-short",
        0x86: "uds-too-hot",
        0x87: "uds-too-cold",
        0x88: "uds-moving",
        0x89: "uds-standing",
        0x8A: "uds-pedal-high",
        0x8B: "uds-pedal-low",
        0x8C: "uds-not-neutral",
        0x8D: "uds-not-in-gear",
        0x8F: "uds-brake-open",
        0x90: "uds-not-in-park",
        0x91: "uds-clutch-locked",
        0x92: "uds-voltage-high",
        0x93: "uds-voltage-low",
    }
)


def negative_response(code: int) -> Message:
    """What a negative response code means; one that ISO 14229-1 does not define is specific to the manufacturer."""
    return Message(NEGATIVE.get(code, "uds-manufacturer-specific"))


def data_identifier(index: int, sub: int) -> int | None:
    """The data identifier of an object; None where UDS has none."""
    if (index, sub) in IDENTITY:
        return IDENTITY[index, sub]
    return None if index in _COMMUNICATION else (index + sub) & 0xFFFF
