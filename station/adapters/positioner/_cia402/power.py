"""Power on and off, homing: whatever brings a drive from one state to another while nothing is to move unasked."""

from station.adapters.positioner._cia402.drive import Drive
from station.adapters.positioner._cia402.link import DriveLink
from station.adapters.positioner._cia402.setup import wait_state
from station.adapters.positioner._cia402.watch import MotionWatch
from station.domain.rig import drive_profile as profile
from station.domain.rig.drive_profile import DriveState, drive_state, next_command
from station.domain.rig.rig_map import Homing
from station.errors import PositionerFault

#: How long a drive may take for a step of its state machine or for another mode.
STEP_S = 1.0
#: How long the station is silent to see whether a drive stops.
SILENT_S = 0.45


def enable(link: DriveLink, drive: Drive, mode: int = profile.PROFILE_POSITION) -> None:
    """Operation enabled, with the target where the axis stands: an old one would be turned to at once.

    The mode is seen to be shown before anything may start: bit 4 means another thing in each mode. Errors:
    PositionerFault, with the power stage off.
    """
    state = drive_state(drive.fresh_word())
    if state is DriveState.ENABLED and drive.read(profile.MODE_DISPLAY) == mode:
        return
    if state is not DriveState.DISABLED:
        switch_off(link, drive)
    drive.write(profile.MODE, mode)
    _wait_mode(link, drive, mode)
    here = drive.counts()
    drive.settle(profile.TARGET, here)
    try:
        state = DriveState.DISABLED
        while (step := next_command(state)) is not None:
            word, state = step
            drive.write(profile.CONTROLWORD, word)
            wait_state(link, drive, state, STEP_S)
    except PositionerFault:
        drive.write(profile.CONTROLWORD, profile.DISABLE_VOLTAGE)
        raise
    if drive.axis.hold == "brake":
        link.wait(lambda: False, drive.axis.brake_s)
    slipped = abs(drive.counts() - here)
    if slipped > drive.axis.rate(drive.axis.following_deg):
        drive.write(profile.CONTROLWORD, profile.DISABLE_VOLTAGE)
        raise PositionerFault(
            "drive-moved-at-enable", axis=drive.name, angle_deg=slipped / abs(drive.axis.counts_per_deg)
        )


def switch_off(link: DriveLink, drive: Drive) -> None:
    """The power stage off; a brake holds the axis then."""
    drive.write(profile.CONTROLWORD, profile.DISABLE_VOLTAGE)
    wait_state(link, drive, DriveState.DISABLED, STEP_S)


def home(link: DriveLink, drive: Drive, watch: MotionWatch) -> None:
    """The drive's own homing, with its four waits: idle, begun, attained, standing. It is switched off afterwards, for
    the target it had means another place now. Errors: PositionerFault."""
    homing = drive.axis.homing
    if not isinstance(homing, Homing):
        return
    enable(link, drive, profile.HOMING)
    if (word := drive.fresh_word()) & profile.FAILED:
        raise PositionerFault("homing-failed", axis=drive.name, word=word)
    watch.begin((drive,))
    link.arm()
    link.command({drive.name: profile.ENABLE | profile.START})
    begun = watch.wait(lambda: not drive.word & (profile.HOMED | profile.REACHED) or _failed(drive), STEP_S)
    if not begun:
        raise PositionerFault("homing-not-begun", axis=drive.name, word=drive.word)
    start_deg, span_deg = drive.angle_deg, drive.axis.limits_deg[1] - drive.axis.limits_deg[0]

    def ended() -> bool:
        """Attained, failed, or turned further than the axis can."""
        homed = bool(drive.word & profile.HOMED)
        return homed or _failed(drive) or abs(drive.angle_deg - start_deg) > 1.1 * span_deg

    attained = watch.wait(ended, homing.timeout_s) and bool(drive.word & profile.HOMED)
    if _failed(drive):
        raise PositionerFault("homing-failed", axis=drive.name, word=drive.word)
    if not attained or not watch.wait(lambda: bool(drive.word & profile.REACHED), STEP_S):
        raise PositionerFault("homing-endless", axis=drive.name, span_deg=span_deg, timeout_s=homing.timeout_s)
    link.command({drive.name: profile.ENABLE})
    link.disarm()
    off_deg = abs(drive.counts() - drive.axis.counts(homing.home_deg)) / abs(drive.axis.counts_per_deg)
    switch_off(link, drive)
    if off_deg > drive.axis.window_deg + 1.0:
        raise PositionerFault("homing-elsewhere", axis=drive.name, off_deg=off_deg, home_deg=homing.home_deg)


def prove_watch(link: DriveLink, drive: Drive, goal_deg: float) -> None:
    """Begins a move and falls silent: the drive must stop short of its goal. Errors: PositionerFault."""
    enable(link, drive)
    drive.settle(profile.TARGET, drive.axis.counts(goal_deg))
    link.arm()
    link.command({drive.name: profile.ENABLE | profile.START})
    link.fall_silent(SILENT_S)
    word, here = drive.fresh_word(), drive.counts()
    link.wait(lambda: False, 0.05)
    stands = abs(drive.counts() - here) <= 1
    off_deg = abs(drive.axis.angle_deg(here) - goal_deg)
    link.disarm()
    if drive_state(word) is DriveState.ENABLED or not stands or off_deg < drive.axis.window_deg:
        raise PositionerFault("drive-does-not-watch", axis=drive.name, word=word)
    if drive_state(word) is DriveState.FAULT:
        drive.write(profile.CONTROLWORD, profile.DISABLE_VOLTAGE)
        drive.write(profile.CONTROLWORD, profile.FAULT_RESET)


def _failed(drive: Drive) -> bool:
    return bool(drive.word & profile.FAILED)


def _wait_mode(link: DriveLink, drive: Drive, mode: int) -> None:
    deadline_s = link.clock.monotonic_s() + STEP_S
    while (shown := drive.read(profile.MODE_DISPLAY)) != mode:
        if link.clock.monotonic_s() > deadline_s:
            raise PositionerFault("drive-mode-refused", axis=drive.name, wanted=mode, shown=shown)
        link.wait(lambda: False, 0.005)
