"""Before anything is energised: is it the right drive, does nobody else command it, are its limits those of the map."""

from station.adapters.positioner._cia402.drive import LIFE_GUARD, Drive
from station.adapters.positioner._cia402.link import DriveLink, command_id, status_id
from station.domain.rig import drive_profile as profile
from station.domain.rig.drive_profile import ENERGISED, DriveState, drive_state, object_of
from station.domain.rig.rig_map import Axis, Homing, RigMap
from station.errors import PositionerFault

_OFF = 0x8000_0000
_SYNCHRONOUS, _BY_EVENT = 1, 255
#: Process data of an axis: at most every 5 ms, and every 40 ms where nothing changes; heartbeat every 100 ms.
INHIBIT_100US, EVENT_MS, HEARTBEAT_MS = 50, 40, 100


def check_type(drive: Drive, rig: RigMap) -> None:
    """Errors: PositionerFault where it is a drive of another type."""
    wanted = rig.drive
    kind = int.from_bytes(drive.upload(0x1000, 0), "little") & 0xFFFF
    vendor, product, revision = (int.from_bytes(drive.upload(0x1018, sub), "little") for sub in (1, 2, 3))
    if kind != wanted.device_profile:
        raise PositionerFault("drive-other-profile", axis=drive.name, node=drive.axis.node, profile=kind)
    if (vendor, product) != (wanted.vendor, wanted.product) or wanted.revision not in (0, revision):
        raise PositionerFault(
            "drive-other-type",
            axis=drive.name,
            node=drive.axis.node,
            vendor=vendor,
            product=product,
            wanted_vendor=wanted.vendor,
            wanted_product=wanted.product,
        )


def check_free(link: DriveLink, drive: Drive) -> None:
    """Nobody else has energised it. What this station left behind when it was killed is switched off.

    Errors: PositionerFault for a drive that somebody else has enabled, is in fault, under local control, or has its
    torque off.
    """
    word = drive.fresh_word()
    state = drive_state(word)
    own = link.watched(drive) >> 16 & 0x7F == link.watch_word(0) >> 16
    if state in ENERGISED and not own:
        raise PositionerFault("drive-enabled-elsewhere", axis=drive.name, node=drive.axis.node, state=str(state))
    if state in ENERGISED:
        drive.write(profile.CONTROLWORD, profile.DISABLE_VOLTAGE)
        wait_state(link, drive, DriveState.DISABLED)
    elif state is DriveState.FAULT:
        code = drive.read(profile.ERROR_CODE)
        if not (own and code == LIFE_GUARD):
            raise PositionerFault("drive-in-fault", axis=drive.name, reason=drive.reason())
        drive.write(profile.CONTROLWORD, profile.DISABLE_VOLTAGE)
        drive.write(profile.CONTROLWORD, profile.FAULT_RESET)
        drive.write(profile.CONTROLWORD, profile.DISABLE_VOLTAGE)
        wait_state(link, drive, DriveState.DISABLED)
    if not word & profile.REMOTE:
        raise PositionerFault("drive-local", axis=drive.name)
    if drive.torque_is_off():
        raise PositionerFault("drive-torque-off", axis=drive.name)


def configure(link: DriveLink, drive: Drive, rig: RigMap) -> None:
    """Limits, ramps, windows and reactions as the map says, each read back; what it reports, and what it watches."""
    axis = drive.axis
    for index, sub, value in settings_of(axis):
        if index not in axis.without:
            drive.settle(index, value, sub)
    armed, idle = link.watch_word(round(rig.watchdog_s * 1000)), link.watch_word(0)
    for word in (armed, idle):  # proves that it can watch, and leaves the station's name
        drive.download(0x1016, 1, word.to_bytes(4, "little"))
        if (read_back := link.watched(drive)) != word:
            raise PositionerFault("drive-keeps-other", axis=drive.name, index=0x1016, sub=1, value=word, kept=read_back)
    drive.download(0x1017, 0, HEARTBEAT_MS.to_bytes(2, "little"))
    _map_process_data(drive)


def settings_of(axis: Axis) -> list[tuple[int, int, int]]:
    """(index, sub-index, value) of the profile objects of an axis."""
    low, high = sorted(axis.counts(angle) for angle in axis.limits_deg)
    found = [
        (profile.ABORT_CONNECTION_OPTION, 0, profile.QUICK_STOP_WHEN_ALONE),
        (profile.QUICK_STOP_OPTION, 0, profile.STAY_IN_QUICK_STOP),
        (profile.HALT_OPTION, 0, profile.SLOW_DOWN),
        (profile.FAULT_OPTION, 0, profile.QUICK_STOP_ON_FAULT),
        (profile.SOFTWARE_LIMITS, 1, low),
        (profile.SOFTWARE_LIMITS, 2, high),
        (profile.SPEED, 0, axis.rate(axis.speed_deg_s)),
        (profile.ACCELERATION, 0, axis.rate(axis.acceleration_deg_s2)),
        (profile.DECELERATION, 0, axis.rate(axis.acceleration_deg_s2)),
        (profile.QUICK_STOP_DECELERATION, 0, axis.rate(axis.stop_deg_s2)),
        (profile.FOLLOWING_WINDOW, 0, axis.rate(axis.following_deg)),
        (profile.FOLLOWING_TIME, 0, round(axis.following_s * 1000)),
        (profile.POSITION_WINDOW, 0, axis.rate(axis.window_deg)),
        (profile.POSITION_TIME, 0, round(axis.window_s * 1000)),
    ]
    if isinstance(homing := axis.homing, Homing):
        found += [
            (profile.HOMING_METHOD, 0, homing.method),
            (profile.HOMING_SPEEDS, 1, axis.rate(homing.fast_deg_s)),
            (profile.HOMING_SPEEDS, 2, axis.rate(homing.slow_deg_s)),
            (profile.HOMING_ACCELERATION, 0, axis.rate(homing.acceleration_deg_s2)),
            (profile.HOME_OFFSET, 0, axis.counts(homing.home_deg)),
        ]
    return found


def wait_state(link: DriveLink, drive: Drive, wanted: DriveState, timeout_s: float = 1.0) -> None:
    """Reads the statusword until it shows the state. Errors: PositionerFault with what the drive says instead."""
    deadline_s, pause_s = link.clock.monotonic_s() + timeout_s, 0.001
    while (state := drive_state(drive.fresh_word())) is not wanted:
        if state in (DriveState.FAULT, DriveState.FAULT_REACTION) or link.clock.monotonic_s() > deadline_s:
            raise PositionerFault("drive-stays", axis=drive.name, wanted=str(wanted), reason=drive.reason())
        link.wait(lambda: False, pause_s)
        pause_s = min(2 * pause_s, 0.05)


def _map_process_data(drive: Drive) -> None:
    """Out: statusword, position and mode, by event. In: the controlword, taken at SYNC."""
    number, node = drive.axis.axis, drive.axis.node
    word, place, mode, control = (
        object_of(index, number) << 16 | abs(profile.SIZES[index]) * 8
        for index in (profile.STATUSWORD, profile.POSITION, profile.MODE_DISPLAY, profile.CONTROLWORD)
    )
    report = 0x1800 + number
    _pdo(drive, report, status_id(number, node), _BY_EVENT, (word, place, mode), timers=True)
    _pdo(drive, 0x1400 + number, command_id(number, node), _SYNCHRONOUS, (control,), timers=False)


def _pdo(drive: Drive, index: int, can_id: int, kind: int, mapped: tuple[int, ...], *, timers: bool) -> None:
    mapping = index + 0x200
    drive.download(index, 1, (_OFF | can_id).to_bytes(4, "little"))
    drive.download(index, 2, bytes([kind]))
    drive.download(mapping, 0, b"\0")
    for sub, entry in enumerate(mapped, 1):
        drive.download(mapping, sub, entry.to_bytes(4, "little"))
    drive.download(mapping, 0, bytes([len(mapped)]))
    if timers:
        drive.download(index, 3, INHIBIT_100US.to_bytes(2, "little"))
        drive.download(index, 5, EVENT_MS.to_bytes(2, "little"))
    drive.download(index, 1, can_id.to_bytes(4, "little"))
