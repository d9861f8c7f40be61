"""can-isotp without a thread and without a bus, for both ends of a line."""

import logging
from collections import deque
from collections.abc import Callable

import isotp

from station.domain.core.types import EXTENDED

# can-isotp warns of every broken frame in its log; what such a frame leads to is one sentence of the client's.
logging.getLogger("isotp").addHandler(logging.NullHandler())


def isotp_layer(
    sends_as: int, hears: int, inbox: deque[bytes], send: Callable[[bytes], None]
) -> isotp.TransportLayerLogic:
    """can-isotp without a thread: takes frames from `inbox`, hands payloads of frames to `send`."""
    is_long = bool((sends_as | hears) & EXTENDED)
    mode = isotp.AddressingMode.Normal_29bits if is_long else isotp.AddressingMode.Normal_11bits
    address = isotp.Address(mode, txid=sends_as & ~EXTENDED, rxid=hears & ~EXTENDED)

    def take(_timeout_s: float) -> isotp.CanMessage | None:
        if not inbox:
            return None
        return isotp.CanMessage(arbitration_id=hears & ~EXTENDED, data=inbox.popleft(), extended_id=is_long)

    def hand_over(message: isotp.CanMessage) -> None:
        send(bytes(message.data))

    # What goes wrong ends in silence, and silence in a sentence of the client's.
    return isotp.TransportLayerLogic(take, hand_over, address, error_handler=lambda _error: None, params={"stmin": 0})
