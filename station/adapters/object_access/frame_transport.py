"""One frame a payload."""

from collections import deque

from station.adapters.canopen.network import ServiceNetwork


class FrameTransport:
    """Payloads of up to eight bytes."""

    def __init__(self, network: ServiceNetwork, request_id: int, response_id: int) -> None:
        self._network, self._request_id = network, request_id
        self._inbox: deque[bytes] = deque(maxlen=4096)
        network.subscribe(response_id, lambda _id, data, _time: self._inbox.append(bytes(data)))

    def send(self, payload: bytes) -> None:
        """Sends the frame."""
        self._network.send(self._request_id, payload)

    def receive(self, deadline_s: float) -> bytes | None:
        """The next frame's payload."""
        arrived = self._network.wait(lambda: bool(self._inbox), deadline_s)
        return self._inbox.popleft() if arrived else None
