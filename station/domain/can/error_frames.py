"""Error frames of the Linux CAN drivers in words. Source: <linux/can/error.h>."""

from collections.abc import Iterator

import numpy as np

from station.domain.core.types import ERROR, Array, Frames

BUS_OFF, RESTARTED = 0x40, 0x100
#: Error class bit → what it says. Classes with details in the payload stand below.
_CLASSES = {
    0x001: "a frame could not be sent in time",
    0x002: "arbitration was lost",
    0x020: "nobody acknowledged a frame: check that another node is on the bus, the wiring and the bit rate",
    BUS_OFF: "the controller is bus-off: check wiring, termination and bit rate",
    0x080: "bus error",
    RESTARTED: "the controller was restarted after bus-off",
}
#: (class, byte of the payload) → bit of that byte → what it says.
_DETAILS = {
    (0x004, 1): {
        0x01: "the adapter's receive buffer overflowed: frames are lost",
        0x02: "the adapter's transmit buffer overflowed",
        0x04: "error warning level reached while receiving",
        0x08: "error warning level reached while sending",
        0x10: "error passive while receiving",
        0x20: "error passive while sending",
        0x40: "back to error active",
    },
    (0x008, 2): {
        0x01: "single bit error",
        0x02: "frame format error",
        0x04: "bit stuffing error",
        0x08: "a dominant bit could not be sent",
        0x10: "a recessive bit could not be sent",
        0x20: "bus overload",
        0x40: "active error announcement",
        0x80: "the error occurred while sending",
    },
    (0x010, 4): {
        0x04: "transceiver: CAN_H or CAN_L is broken or shorted",
        0x40: "transceiver: CAN_L is broken or shorted",
        0x80: "transceiver: CAN_L is shorted to CAN_H",
    },
}
_UNSPECIFIED = {0x004: "controller problem", 0x008: "protocol violation", 0x010: "transceiver problem"}


def error_frames(frames: Frames) -> tuple[str, ...]:
    """What the error frames among `frames` say, one sentence each, with how often; most frequent first."""
    errors = frames[(frames.can_id & np.uint32(ERROR)) != 0]
    told: dict[str, int] = {}
    for can_id, data in zip(errors.can_id.tolist(), errors.data, strict=True):
        for text in _descriptions(can_id, data):
            told[text] = told.get(text, 0) + 1
    ordered = sorted(told.items(), key=lambda item: -item[1])
    return tuple(text if times == 1 else f"{text} ({times} times)" for text, times in ordered)


def has_bus_off(frames: Frames) -> bool:
    """Whether the controller went bus-off, and did not restart after that."""
    errors = frames.can_id[(frames.can_id & np.uint32(ERROR)) != 0]
    off = np.flatnonzero(errors & np.uint32(BUS_OFF))
    on = np.flatnonzero(errors & np.uint32(RESTARTED))
    return bool(len(off)) and (not len(on) or bool(off[-1] > on[-1]))


def _descriptions(can_id: int, data: Array) -> Iterator[str]:
    yield from (text for bit, text in _CLASSES.items() if can_id & bit)
    for (kind, byte), details in _DETAILS.items():
        if can_id & kind:
            said = [text for bit, text in details.items() if int(data[byte]) & bit]
            yield from said or [_UNSPECIFIED[kind]]
