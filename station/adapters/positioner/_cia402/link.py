"""All drives of a rig on their bus: process data in, commands latched by SYNC out, and the station's heartbeat."""

from collections.abc import Callable, Mapping, Sequence

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.network import ServiceNetwork, service_ids
from station.adapters.positioner._cia402.drive import Drive
from station.domain.rig.rig_map import RigMap
from station.ports.bus import Bus
from station.ports.clock import Clock

_SYNC, _HEARTBEAT = 0x080, 0x700
_OPERATIONAL = b"\x05"
#: Heartbeats within the time after which the drives stop: three may be lost.
_BEATS = 4
#: How long a drive may take to answer, s: less than any person notices, more than any drive needs.
ANSWER_S = 0.25


def status_id(drive: int, node: int) -> int:
    """Identifier of the process data of an axis: the predefined one of its number in the node (CiA 301, 7.3.5)."""
    return 0x180 + 0x100 * drive + node


def command_id(drive: int, node: int) -> int:
    """Identifier of the command of an axis."""
    return 0x200 + 0x100 * drive + node


class DriveLink:
    """The drives of a map, in its order. Nothing runs behind it: heartbeats leave while somebody waits here."""

    def __init__(self, bus: Bus, clock: Clock, rig: RigMap) -> None:
        self.clock, self._rig = clock, rig
        nodes = tuple(dict.fromkeys(axis.node for axis in rig.axes))
        reports = tuple(status_id(axis.axis, axis.node) for axis in rig.axes)
        self._channel = bus.service((*service_ids(nodes), *reports))
        self.network = ServiceNetwork(self._channel, clock)
        self.devices = {node: CanopenDevice(self.network, node, answer_s=ANSWER_S) for node in nodes}
        self.drives: Sequence[Drive] = [Drive(axis, self.devices[axis.node]) for axis in rig.axes]
        for drive, can_id in zip(self.drives, reports, strict=True):
            self.network.subscribe(can_id, self._listener(drive))
        self._armed = False
        self._beat_s = 0.0

    def close(self) -> None:
        """Leaves the bus."""
        self._channel.close()

    def command(self, words: Mapping[str, int]) -> None:
        """Controlwords by the name of the axis: all drives take theirs at one SYNC."""
        for drive in self.drives:
            if drive.name in words:
                can_id = command_id(drive.axis.axis, drive.axis.node)
                self.network.send(can_id, words[drive.name].to_bytes(2, "little"))
        self.network.send(_SYNC, b"")

    def beat(self) -> None:
        """The station's heartbeat, now."""
        self._beat_s = self.clock.monotonic_s()
        self.network.send(_HEARTBEAT + self._rig.station_node, _OPERATIONAL)

    def arm(self) -> None:
        """From now on the drives stop when the station falls silent."""
        self._armed = True
        self.beat()
        for device in self.devices.values():
            self._drive_of(device).download(0x1016, 1, self._watch(round(self._rig.watchdog_s * 1000)))
        self.beat()

    def disarm(self) -> None:
        """The axes stand: they may go on standing without the station."""
        for device in self.devices.values():
            self._drive_of(device).download(0x1016, 1, self._watch(0))
        self._armed = False

    def wait(self, arrived: Callable[[], bool], timeout_s: float) -> bool:
        """Until `arrived()`, at most so long; the drives hear the station meanwhile."""
        deadline_s = self.clock.monotonic_s() + timeout_s
        pause_s = self._rig.watchdog_s / _BEATS
        while True:
            now_s = self.clock.monotonic_s()
            if self._armed and now_s >= self._beat_s + pause_s - 1e-9:
                self.beat()
            until_s = min(deadline_s, self._beat_s + pause_s if self._armed else deadline_s)
            if self.network.wait(arrived, until_s):
                return True
            if self.clock.monotonic_s() >= deadline_s:
                return False

    def fall_silent(self, duration_s: float) -> None:
        """Sends no heartbeat so long."""
        self.network.wait(lambda: False, self.clock.monotonic_s() + duration_s)

    def watched(self, drive: Drive) -> int:
        """What the node of a drive watches (0x1016:01); it names the station that set it up last."""
        return int.from_bytes(drive.upload(0x1016, 1), "little")

    def watch_word(self, period_ms: int) -> int:
        """0x1016:01 for the station's node: with 0 ms nothing is watched, and the node is still named."""
        return self._rig.station_node << 16 | period_ms

    def _watch(self, period_ms: int) -> bytes:
        return self.watch_word(period_ms).to_bytes(4, "little")

    def _drive_of(self, device: CanopenDevice) -> Drive:
        return next(drive for drive in self.drives if drive.device is device)

    def _listener(self, drive: Drive) -> Callable[[int, bytearray, float], None]:
        return lambda _id, data, _time: drive.take_process_data(bytes(data), self.clock.monotonic_s())
