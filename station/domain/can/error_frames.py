"""Error frames of the Linux CAN drivers as messages. Source: <linux/can/error.h>."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from station.domain.core.types import ERROR, Array, Frames
from station.messages import Message

BUS_OFF, RESTARTED = 0x40, 0x100
#: Error class bit → message. Classes with details in the payload stand below.
_CLASSES = {
    0x001: "can-send-timeout",
    0x002: "can-arbitration-lost",
    0x020: "can-no-acknowledge",
    BUS_OFF: "can-bus-off",
    0x080: "can-bus-error",
    RESTARTED: "can-restarted",
}
#: (class, byte of the payload) → bit of that byte → message.
_DETAILS = {
    (0x004, 1): {
        0x01: "can-receive-overflow",
        0x02: "can-send-overflow",
        0x04: "can-warning-receiving",
        0x08: "can-warning-sending",
        0x10: "can-passive-receiving",
        0x20: "can-passive-sending",
        0x40: "can-active-again",
    },
    (0x008, 2): {
        0x01: "can-single-bit-error",
        0x02: "can-frame-format-error",
        0x04: "can-stuffing-error",
        0x08: "can-dominant-bit-error",
        0x10: "can-recessive-bit-error",
        0x20: "can-overload",
        0x40: "can-active-error-flag",
        0x80: "can-error-while-sending",
    },
    (0x010, 4): {
        0x04: "can-transceiver-high",
        0x40: "can-transceiver-low",
        0x80: "can-transceiver-short",
    },
}
_UNSPECIFIED = {0x004: "can-controller-problem", 0x008: "can-protocol-violation", 0x010: "can-transceiver-problem"}


def error_frames(frames: Frames) -> tuple[Message, ...]:
    """What the error frames among `frames` report, one message each, with how often; most frequent first."""
    errors = frames[(frames.can_id & np.uint32(ERROR)) != 0]
    times = Counter(
        id_ for can_id, data in zip(errors.can_id.tolist(), errors.data, strict=True) for id_ in _ids(can_id, data)
    )
    return tuple(
        Message(id_) if count == 1 else Message("repeated-times", message=Message(id_), count=count)
        for id_, count in times.most_common()
    )


def has_bus_off(frames: Frames) -> bool:
    """Whether the controller went bus-off, and did not restart after that."""
    errors = frames.can_id[(frames.can_id & np.uint32(ERROR)) != 0]
    off = np.flatnonzero(errors & np.uint32(BUS_OFF))
    on = np.flatnonzero(errors & np.uint32(RESTARTED))
    return bool(len(off)) and (not len(on) or bool(off[-1] > on[-1]))


def _ids(can_id: int, data: Array) -> Iterator[str]:
    yield from (id_ for bit, id_ in _CLASSES.items() if can_id & bit)
    for (kind, byte), details in _DETAILS.items():
        if can_id & kind:
            known = [id_ for bit, id_ in details.items() if int(data[byte]) & bit]
            yield from known or [_UNSPECIFIED[kind]]
