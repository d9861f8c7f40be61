"""Emergency error codes (CiA 301, table 26) as messages: the classes that the standard defines."""

from station.messages import Message

#: First byte of the error code, or its first digit alone, → message.
_CLASSES = {
    0x10: "emergency-generic",
    0x20: "emergency-current",
    0x21: "emergency-current-input",
    0x22: "emergency-current-inside",
    0x23: "emergency-current-output",
    0x30: "emergency-voltage",
    0x31: "emergency-voltage-mains",
    0x32: "emergency-voltage-inside",
    0x33: "emergency-voltage-output",
    0x40: "emergency-temperature",
    0x41: "emergency-temperature-ambient",
    0x42: "emergency-temperature-device",
    0x50: "emergency-hardware",
    0x60: "emergency-software",
    0x61: "emergency-software-internal",
    0x62: "emergency-software-user",
    0x63: "emergency-data-set",
    0x70: "emergency-additional-modules",
    0x80: "emergency-monitoring",
    0x81: "emergency-communication",
    0x82: "emergency-protocol",
    0x90: "emergency-external",
    0xF0: "emergency-additional-functions",
    0xFF: "emergency-device-specific",
}


def emergency(code: int, register: int) -> Message:
    """An emergency with the meaning of its class. code: 16 bits; register: the error register 0x1001."""
    first = code >> 8
    id_ = _CLASSES.get(first) or _CLASSES.get(first & 0xF0) or "emergency-unknown"
    return Message("emergency", code=code, register=register, meaning=Message(id_))


#: Bits of the error register (CiA 301, 7.5.2.2) that an error on the bus sets: generic and communication.
_OF_BUS = 0x01 | 0x10
#: Classes of codes about the traffic: what others send or fail to send, and what the bus does to frames.
_TRAFFIC = range(0x80, 0x83)


def concerns_unit(code: int, register: int) -> bool:
    """Whether an emergency says something of the unit's readings: one about the traffic, with no other bit in the error
    register than those of traffic, says something of the bus."""
    return code >> 8 not in _TRAFFIC or bool(register & ~_OF_BUS)
