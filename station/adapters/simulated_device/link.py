"""How requests reach a simulated device, and its answers the station: identifiers, and payloads as frames."""

from collections import deque
from collections.abc import Callable
from typing import Protocol

from station.domain.product.device_map import DeviceMap

SDO_REQUEST, SDO_ANSWER = 0x600, 0x580
#: Identifier that no frame has: of a device that only sends.
NO_REQUESTS = -1
Send = Callable[[int, bytes], None]


class RequestLink(Protocol):
    """One way to one device. request_id: of the frames that it hears."""

    request_id: int

    def hear(self, data: bytes) -> tuple[bytes, ...]:
        """Requests that a frame completes."""

    def answer(self, payload: bytes, off: int) -> None:
        """Sends an answer; off: by how much the node id in its identifier is wrong."""


class FrameLink:
    """A request is a frame of `length` bytes (0: of any), an answer another."""

    def __init__(self, request_id: int, response_id: int, send: Send, length: int = 0) -> None:
        self.request_id, self._response_id = request_id, response_id
        self._send, self._length = send, length

    def hear(self, data: bytes) -> tuple[bytes, ...]:
        """The frame itself."""
        return (data,) if self._length in (0, len(data)) else ()

    def answer(self, payload: bytes, off: int) -> None:
        """One frame."""
        self._send(self._response_id + off, payload)


class IsoTpLink:
    """Requests and answers of any length (ISO 15765-2)."""

    def __init__(self, request_id: int, response_id: int, send: Send) -> None:
        from station.adapters.object_access.isotp_layer import isotp_layer

        self.request_id, self._response_id = request_id, response_id
        self._send, self._off = send, 0
        self._inbox: deque[bytes] = deque()
        self._layer = isotp_layer(response_id, request_id, self._inbox, self._frame)

    def hear(self, data: bytes) -> tuple[bytes, ...]:
        """Payloads that the frame completes; flow control goes out at once."""
        self._inbox.append(data)
        self._layer.process()
        found = []
        while self._layer.available():
            found.append(bytes(self._layer.recv() or b""))
        return tuple(found)

    def answer(self, payload: bytes, off: int) -> None:
        """The beginning of it now, the rest as the station's flow control wants it."""
        self._off = off
        self._layer.send(payload)
        self._layer.process()

    def _frame(self, data: bytes) -> None:
        self._send(self._response_id + self._off, data)


def request_id_of(device_map: DeviceMap, node: int, node_of_dbc: int) -> int:
    """Identifier of the requests to a node."""
    return _identifiers(device_map, node, node_of_dbc)[0]


def link_of(device_map: DeviceMap, node: int, node_of_dbc: int, send: Send) -> RequestLink:
    """The link of a product's protocol."""
    request_id, response_id = _identifiers(device_map, node, node_of_dbc)
    if device_map.protocol == "uds":
        return IsoTpLink(request_id, response_id, send)
    return FrameLink(request_id, response_id, send, 8 if device_map.protocol == "canopen" else 0)


def _identifiers(device_map: DeviceMap, node: int, node_of_dbc: int) -> tuple[int, int]:
    if device_map.protocol == "none":
        return NO_REQUESTS, NO_REQUESTS
    access = device_map.uds or device_map.template
    return (SDO_REQUEST + node, SDO_ANSWER + node) if access is None else access.of_node(node, node_of_dbc)
