"""A device on the bus: SDO, NMT, EMCY, heartbeat and boot-up of one node. Implements station.ports.device.Device."""

import math
from collections import deque
from collections.abc import Collection, Mapping

from canopen.nmt import NMT_COMMANDS, NMT_STATES

from station.adapters.canopen.network import ServiceNetwork
from station.adapters.canopen.sdo_client import SdoClient
from station.errors import DeviceSilent, UsageError
from station.ports.device import Emergency, Identity, read_identity

_COMMANDS = {
    "start": NMT_COMMANDS["OPERATIONAL"],
    "stop": NMT_COMMANDS["STOPPED"],
    "pre-operational": NMT_COMMANDS["PRE-OPERATIONAL"],
    "reset-node": NMT_COMMANDS["RESET"],
    "reset-communication": NMT_COMMANDS["RESET COMMUNICATION"],
}
_BOOT_UP = 0x00
#: The latest ones are kept when nobody takes them.
_MOST_EMERGENCIES = 1000


class CanopenDevice:
    """One node of a ServiceNetwork. answer_s: usual SDO time-out; timeouts_s: objects that need another one; sizes:
    bytes of objects, for a device that does not say them."""

    def __init__(
        self,
        network: ServiceNetwork,
        node: int,
        *,
        answer_s: float = 1.0,
        timeouts_s: Mapping[tuple[int, int], float] | None = None,
        sizes: Mapping[tuple[int, int], int] | None = None,
    ) -> None:
        self.sdo = SdoClient(network, node, answer_s, timeouts_s, sizes)
        self._network = network
        self._node = node
        self._state = "unknown"
        self._heard_s, self._heartbeats = -math.inf, 0
        self._boot_ups = 0
        self._boot_ups_before_reset = 0
        self._emergencies: deque[Emergency] = deque(maxlen=_MOST_EMERGENCIES)
        network.subscribe(0x700 + node, self._on_heartbeat)
        network.subscribe(0x080 + node, self._on_emergency)

    @property
    def node(self) -> int:
        """Node id."""
        return self._node

    def identify(self, required: Collection[tuple[int, int]] = ((0x1000, 0),)) -> Identity:
        """Reads the identity objects; one that is not among the `asked` and is refused reads as 0 or ''."""
        return read_identity(self.upload, required)

    def upload(self, index: int, sub: int, timeout_s: float | None = None) -> bytes:
        """Raw value of an object. Errors: DeviceSilent, DeviceRefused, BusFault."""
        return self.sdo.upload(index, sub, timeout_s)

    def download(self, index: int, sub: int, data: bytes, timeout_s: float | None = None) -> None:
        """Writes an object, once. Errors: DeviceSilent, DeviceRefused, BusFault."""
        self.sdo.download(index, sub, data, timeout_s)

    def nmt(self, command: str) -> None:
        """Sends start, stop, pre-operational, reset-node or reset-communication to this node."""
        if command not in _COMMANDS:
            raise UsageError("nmt-command-unknown", command=command, known=tuple(_COMMANDS))
        if command.startswith("reset"):
            self._boot_ups_before_reset = self.boot_ups()
            self._state = "unknown"
        self._network.send(0x000, bytes([_COMMANDS[command], self._node]))

    def wait_boot_up(self, timeout_s: float) -> None:
        """Waits for the boot-up message after the last reset. Errors: DeviceSilent."""
        deadline_s = self._network.clock.monotonic_s() + timeout_s
        if not self._network.wait(lambda: self._boot_ups > self._boot_ups_before_reset, deadline_s):
            raise DeviceSilent("no-boot-up", node=self._node, timeout_s=timeout_s)

    def state(self) -> str:
        """NMT state last heard: operational, pre-operational, stopped, booting or unknown."""
        self._network.catch_up()
        return self._state

    def heartbeat_age_s(self) -> float:
        """Seconds since the last heartbeat or boot-up was taken from the bus; infinity when there was none."""
        self._network.catch_up()
        return self._network.clock.monotonic_s() - self._heard_s

    def heartbeats(self) -> int:
        """Heartbeats and boot-up messages seen so far."""
        self._network.catch_up()
        return self._heartbeats

    def emergencies(self) -> tuple[Emergency, ...]:
        """EMCY messages since the last call, oldest first."""
        self._network.catch_up()
        received = tuple(self._emergencies)
        self._emergencies.clear()
        return received

    def boot_ups(self) -> int:
        """Boot-up messages seen so far."""
        self._network.catch_up()
        return self._boot_ups

    def _on_heartbeat(self, _can_id: int, data: bytearray, _time_s: float) -> None:
        if not data:
            return
        code = data[0] & 0x7F
        self._heard_s = self._network.clock.monotonic_s()
        self._heartbeats += 1
        self._boot_ups += code == _BOOT_UP
        self._state = "booting" if code == _BOOT_UP else str(NMT_STATES.get(code, "unknown")).lower()

    def _on_emergency(self, _can_id: int, data: bytearray, time_s: float) -> None:
        code = int.from_bytes(data[:2], "little")
        register = data[2] if len(data) > 2 else 0
        self._emergencies.append(Emergency(round(time_s * 1e9), code, register, bytes(data[3:])))
