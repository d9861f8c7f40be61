"""Payloads of any length as frames: ISO-TP (ISO 15765-2), by can-isotp."""

from collections import deque

from station.adapters.canopen.network import ServiceNetwork
from station.adapters.object_access.isotp_layer import isotp_layer

#: A device that has taken a first frame says within this time how it wants the rest (N_Bs of ISO 15765-2).
FLOW_CONTROL_S = 1.0


class IsoTpTransport:
    """Payloads of any length in single, first and consecutive frames, by can-isotp, pumped by whoever waits."""

    def __init__(self, network: ServiceNetwork, request_id: int, response_id: int) -> None:
        self._network, self._request_id = network, request_id
        self._inbox: deque[bytes] = deque(maxlen=4096)
        self._layer = isotp_layer(request_id, response_id, self._inbox, lambda data: network.send(request_id, data))
        network.subscribe(response_id, lambda _id, data, _time: self._inbox.append(bytes(data)))

    def send(self, payload: bytes) -> None:
        """Sends it whole, as the device's flow control wants it; a device that sends none gets the beginning only."""
        self._layer.stop_sending()
        self._layer.send(payload)
        self._layer.process()
        deadline_s = self._network.clock.monotonic_s() + FLOW_CONTROL_S
        while self._layer.transmitting() and self._network.wait(lambda: bool(self._inbox), deadline_s):
            self._layer.process()

    def receive(self, deadline_s: float) -> bytes | None:
        """The next payload, put together."""
        while True:
            self._layer.process()
            if self._layer.available():
                return bytes(self._layer.recv() or b"")
            if not self._network.wait(lambda: bool(self._inbox), deadline_s):
                return None
