"""What a CAN interface says when it fails, as sentences with a remedy: the kernel's own, and the simulated bus's."""

import errno
import os
from typing import Final

#: How long the transmit queue may stay full before that is a fault, s.
SEND_DEADLINE_S: Final = 1.0


def socket_error_sentence(name: str, number: int) -> str:
    """An error number of a socket on the interface `name` as a sentence."""
    if number == errno.ENETDOWN:
        return f"{name} went down; bring it up with `ip link set {name} up`"
    if number in (errno.ENODEV, errno.ENXIO):
        return f"{name} is gone; plug the adapter in again and start anew"
    if number in (errno.ENOBUFS, errno.EAGAIN):
        return (
            f"{name} could not send for {SEND_DEADLINE_S:g} s, its queue is full: check that a node acknowledges "
            f"(wiring, termination, bit rate), or enlarge it with `ip link set {name} txqueuelen 1000`"
        )
    return f"{name} failed: {os.strerror(number)}"
