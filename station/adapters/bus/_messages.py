"""python-can messages to Frames and back."""

from collections.abc import Sequence

import numpy as np

from station.adapters.bus._python_can import can
from station.domain.core.types import ERROR, EXTENDED, REMOTE, Frames


def packed_id(message: can.Message) -> int:
    """Identifier with the kernel's flag bits. python-can keeps an error frame's class in arbitration_id."""
    flags = EXTENDED * message.is_extended_id | REMOTE * message.is_remote_frame
    return message.arbitration_id | (ERROR if message.is_error_frame else flags)


def to_frames(messages: Sequence[can.Message], time_ns: Sequence[int]) -> Frames:
    """Messages, one after the other, at the given times."""
    width = 8 if all(len(m.data) <= 8 for m in messages) else 64
    payload = b"".join(bytes(m.data).ljust(width, b"\0") for m in messages)
    return Frames(
        np.array(time_ns, np.int64),
        np.array([packed_id(m) for m in messages], np.uint32),
        np.array([min(m.dlc, width) if m.is_remote_frame else len(m.data) for m in messages], np.uint8),
        np.frombuffer(payload, np.uint8).reshape(len(messages), width),
    )


def to_message(can_id: int, data: bytes, timestamp_s: float, dlc: int | None = None) -> can.Message:
    """One frame as python-can wants it."""
    error, remote = bool(can_id & ERROR), bool(can_id & REMOTE)
    return can.Message(
        timestamp=timestamp_s,
        arbitration_id=can_id & 0x1FFF_FFFF,
        is_extended_id=bool(can_id & EXTENDED),
        is_remote_frame=remote,
        is_error_frame=error,
        is_fd=len(data) > 8,
        data=None if remote else data,
        dlc=dlc if remote else len(data),
    )
