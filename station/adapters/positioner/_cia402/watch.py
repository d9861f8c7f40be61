"""What is looked at while an axis moves: whatever is not as it should be ends the move with a quick stop of all."""

from collections.abc import Callable, Mapping, Sequence

from station.adapters.positioner._cia402.drive import Drive
from station.adapters.positioner._cia402.link import DriveLink
from station.adapters.positioner._cia402.setup import EVENT_MS, HEARTBEAT_MS
from station.domain.rig import drive_profile as profile
from station.domain.rig.drive_profile import DriveState
from station.errors import PositionerFault

#: Process data and heartbeats that may be missing in a row.
_MISSED = 3
#: How soon a frozen statusword must be noticed after the last look, s.
_POLL_S = 0.05
#: An axis must stand so long after the end of its quick-stop ramp, s; else its power is taken.
STOP_S = 0.15


class MotionWatch:
    """Over all drives of a rig while some of them move."""

    def __init__(self, link: DriveLink) -> None:
        self._link = link
        self._boot_ups: Mapping[str, int] = {}
        self._ways: dict[str, tuple[float, float]] = {}
        self._moving: Sequence[Drive] = ()
        self._began_s = 0.0

    def begin(self, moving: Sequence[Drive], ways: Mapping[str, tuple[float, float]] | None = None) -> None:
        """A motion of these axes begins. ways: by name the angles between which an axis may be."""
        self._moving, self._ways = moving, dict(ways or {})
        self._began_s = self._link.clock.monotonic_s()
        self._boot_ups = {drive.name: drive.device.boot_ups() for drive in self._link.drives}
        for drive in self._link.drives:
            drive.device.emergencies()

    def wait(self, arrived: Callable[[], bool], timeout_s: float) -> bool:
        """Until `arrived()`; whether it did in time. Errors: PositionerFault as soon as something is wrong."""
        deadline_s = self._link.clock.monotonic_s() + timeout_s
        while True:
            left_s = deadline_s - self._link.clock.monotonic_s()
            done = self._link.wait(lambda: arrived() or self._strays(), min(_POLL_S, max(left_s, 0.0)))
            self._check()
            if done and arrived():
                return True
            if left_s <= 0:
                return False

    def _strays(self) -> bool:
        return any(d.state is not DriveState.ENABLED for d in self._moving) or any(map(self._off_way, self._moving))

    def _off_way(self, drive: Drive) -> bool:
        low, high = self._ways.get(drive.name, (-1e9, 1e9))
        return not low <= drive.angle_deg <= high

    def _check(self) -> None:
        for drive in self._link.drives:
            self.check_not_restarted(drive)
            if reported := [e for e in drive.device.emergencies() if e.code]:
                reason = drive.error(reported[0].code, reported[0].register)
                raise PositionerFault("drive-stopped", axis=drive.name, reason=reason)
        now_s = self._link.clock.monotonic_s()
        for drive in self._moving:
            self._check_alive(drive, now_s)
            if drive.state is not DriveState.ENABLED:
                raise PositionerFault("drive-stopped", axis=drive.name, reason=drive.reason())
            if drive.word & profile.INTERNAL_LIMIT and self._ways:
                raise PositionerFault("drive-at-limit", axis=drive.name, angle_deg=drive.angle_deg)
            if self._off_way(drive):
                low, high = self._ways[drive.name]
                raise PositionerFault("drive-off-way", axis=drive.name, angle_deg=drive.angle_deg, low=low, high=high)

    def check_not_restarted(self, drive: Drive) -> None:
        """Errors: PositionerFault where its node has started anew since the motion began."""
        if self._boot_ups and drive.device.boot_ups() != self._boot_ups[drive.name]:
            raise PositionerFault("drive-restarted", axis=drive.name)

    def _check_alive(self, drive: Drive, now_s: float) -> None:
        silent_s = now_s - max(drive.heard_s, self._began_s)
        if silent_s > _MISSED * EVENT_MS / 1000:
            raise PositionerFault("drive-status-silent", axis=drive.name, silent_s=silent_s)
        silent_s = min(now_s - self._began_s, drive.device.heartbeat_age_s())
        if silent_s > _MISSED * HEARTBEAT_MS / 1000:
            raise PositionerFault("drive-heartbeat-silent", axis=drive.name, silent_s=silent_s)


def stop_all(link: DriveLink) -> list[str]:
    """Quick stop of every axis at one SYNC, frames first; names of axes that do not stand soon afterwards, or do not
    answer: their power stage was taken, as far as they listen. Errors: BusFault."""
    link.command({drive.name: profile.QUICK_STOP for drive in link.drives})
    return [drive.name for drive in link.drives if not _stands(link, drive)]


def _stands(link: DriveLink, drive: Drive) -> bool:
    """Looks where it is until it stays there; takes its power where it still moves when it should stand."""
    axis = drive.axis
    deadline_s = link.clock.monotonic_s() + axis.speed_deg_s / axis.stop_deg_s2 + STOP_S
    try:
        before = drive.counts()
        while True:
            link.wait(lambda: False, _POLL_S / 2)
            now = drive.counts()
            if abs(now - before) <= 1:
                return True
            if link.clock.monotonic_s() > deadline_s:
                break
            before = now
    except PositionerFault:
        pass  # it does not answer: what is sent now may still reach it
    link.command({drive.name: profile.DISABLE_VOLTAGE})
    return False
