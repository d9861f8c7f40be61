"""A device without CANopen's network management: implements station.ports.device.Device over an ObjectClient."""

from collections.abc import Collection

from station.adapters.canopen.network import ServiceNetwork
from station.adapters.object_access.client import ObjectClient
from station.adapters.object_access.without_states import WithoutStates
from station.errors import DeviceSilent
from station.ports.device import Identity, read_identity

#: How often a device that starts is asked whether it is there, and how long each time.
_POLL_S = 0.05


class ObjectDevice(WithoutStates):
    """It always sends its readings, tells no state and no emergencies; a restart of its own shows in nothing but its
    frames' counter. NMT commands but `reset-node` are nothing to it."""

    def __init__(self, network: ServiceNetwork, client: ObjectClient) -> None:
        self._network, self._client = network, client
        self._boot_ups = 0
        self.node = client.node

    def identify(self, required: Collection[tuple[int, int]] = ((0x1000, 0),)) -> Identity:
        """Reads the identity objects; one that is not among the `asked` and is refused reads as 0 or ''."""
        return read_identity(self.upload, required)

    def upload(self, index: int, sub: int, timeout_s: float | None = None) -> bytes:
        """Raw value of an object. Errors: DeviceSilent, DeviceRefused, BusFault."""
        return self._client.upload(index, sub, timeout_s)

    def download(self, index: int, sub: int, data: bytes, timeout_s: float | None = None) -> None:
        """Writes an object, once. Errors: DeviceSilent, DeviceRefused, BusFault."""
        self._client.download(index, sub, data, timeout_s)

    def nmt(self, command: str) -> None:
        """Only a reset of the node is something that the device can be told. Errors: DeviceSilent, DeviceRefused."""
        if command == "reset-node":
            self._client.reset()

    def wait_boot_up(self, timeout_s: float) -> None:
        """Waits until the device answers again. Errors: DeviceSilent."""
        clock = self._network.clock
        deadline_s = clock.monotonic_s() + timeout_s
        while not self._client.alive(_POLL_S):
            if clock.monotonic_s() >= deadline_s:
                raise DeviceSilent("no-answer-after-reset", node=self.node, timeout_s=timeout_s)
        self._boot_ups += 1

    def boot_ups(self) -> int:
        """Restarts that the station asked for."""
        return self._boot_ups
