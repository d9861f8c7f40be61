"""What a CAN interface reports when it fails, as messages with a remedy: the kernel's own, and the simulated bus's."""

import errno
import os
from typing import Final

from station.messages import Message

#: How long the transmit queue may stay full before that is a fault, s.
SEND_DEADLINE_S: Final = 1.0


def socket_error(name: str, number: int) -> Message:
    """An error number of a socket on the interface `name` as a message."""
    if number == errno.ENETDOWN:
        return Message("interface-down", bus=name)
    if number in (errno.ENODEV, errno.ENXIO):
        return Message("interface-gone", bus=name)
    if number in (errno.ENOBUFS, errno.EAGAIN):
        return Message("interface-queue-full", bus=name, timeout_s=SEND_DEADLINE_S)
    return Message("interface-failed", bus=name, why=os.strerror(number))
