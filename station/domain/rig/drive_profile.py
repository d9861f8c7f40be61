"""The drive profile CiA 402 (IEC 61800-7-201) as far as a positioner needs it: states, commands, bits, objects."""

from enum import StrEnum

from station.messages import Message

#: Objects of the first axis; those of axis n lie n · 0x800 higher (CiA 402-2).
CONTROLWORD, STATUSWORD = 0x6040, 0x6041
ABORT_CONNECTION_OPTION, ERROR_CODE = 0x6007, 0x603F
QUICK_STOP_OPTION, HALT_OPTION, FAULT_OPTION = 0x605A, 0x605D, 0x605E
MODE, MODE_DISPLAY = 0x6060, 0x6061
POSITION, FOLLOWING_WINDOW, FOLLOWING_TIME = 0x6064, 0x6065, 0x6066
POSITION_WINDOW, POSITION_TIME = 0x6067, 0x6068
TARGET, HOME_OFFSET, SOFTWARE_LIMITS = 0x607A, 0x607C, 0x607D
SPEED, ACCELERATION, DECELERATION, QUICK_STOP_DECELERATION = 0x6081, 0x6083, 0x6084, 0x6085
HOMING_METHOD, HOMING_SPEEDS, HOMING_ACCELERATION = 0x6098, 0x6099, 0x609A
AXIS_OFFSET = 0x800
#: Length in bytes of each object; negative: signed (the public dictionary of ros2_canopen agrees, see the tests).
SIZES = {
    CONTROLWORD: 2, STATUSWORD: 2, ABORT_CONNECTION_OPTION: -2, ERROR_CODE: 2, QUICK_STOP_OPTION: -2, HALT_OPTION: -2,
    FAULT_OPTION: -2, MODE: -1, MODE_DISPLAY: -1, POSITION: -4, FOLLOWING_WINDOW: 4, FOLLOWING_TIME: 2,
    POSITION_WINDOW: 4, POSITION_TIME: 2, TARGET: -4, HOME_OFFSET: -4, SOFTWARE_LIMITS: -4, SPEED: 4,
    ACCELERATION: 4, DECELERATION: 4, QUICK_STOP_DECELERATION: 4, HOMING_METHOD: -1, HOMING_SPEEDS: 4,
    HOMING_ACCELERATION: 4,
}  # fmt: skip
#: Values of the option codes: slow down on the quick-stop ramp and stay there; on the profile's ramp; and 0x6007.
STAY_IN_QUICK_STOP, SLOW_DOWN, QUICK_STOP_ON_FAULT, QUICK_STOP_WHEN_ALONE = 6, 1, 2, 3

PROFILE_POSITION, HOMING = 1, 6

#: Bits of the statusword.
VOLTAGE, WARNING, REMOTE, REACHED, INTERNAL_LIMIT = 1 << 4, 1 << 7, 1 << 9, 1 << 10, 1 << 11
ACKNOWLEDGED = HOMED = 1 << 12
FAILED = 1 << 13

#: Controlwords. START: new set-point, or homing starts, on its rising edge.
DISABLE_VOLTAGE, QUICK_STOP, SHUTDOWN, SWITCH_ON, ENABLE = 0x00, 0x02, 0x06, 0x07, 0x0F
START, FAULT_RESET, HALT = 1 << 4, 1 << 7, 1 << 8


class DriveState(StrEnum):
    """The states of the profile; unknown: a statusword that is none of them."""

    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOPPED = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


#: (mask, value) of the statusword → state; table 30 of the profile.
_STATES = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.DISABLED),
    (0x6F, 0x21, DriveState.READY),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOPPED),
    (0x4F, 0x0F, DriveState.FAULT_REACTION),
    (0x4F, 0x08, DriveState.FAULT),
)
#: States in which the power stage may turn the motor.
ENERGISED = frozenset({DriveState.SWITCHED_ON, DriveState.ENABLED, DriveState.QUICK_STOPPED, DriveState.FAULT_REACTION})


def drive_state(statusword: int) -> DriveState:
    """The state that a statusword shows."""
    return next((state for mask, value, state in _STATES if statusword & mask == value), DriveState.UNKNOWN)


def next_command(state: DriveState) -> tuple[int, DriveState] | None:
    """The controlword of the next step towards operation enabled, and the state that it leads to; None where no step
    may be taken: a fault wants to be looked at, and out of a quick stop only by way of a power stage that is off."""
    return {
        DriveState.DISABLED: (SHUTDOWN, DriveState.READY),
        DriveState.READY: (SWITCH_ON, DriveState.SWITCHED_ON),
        DriveState.SWITCHED_ON: (ENABLE, DriveState.ENABLED),
    }.get(state)


def object_of(index: int, axis: int) -> int:
    """Index of a profile object of the axis 0, 1, … of a node; communication objects are the node's own."""
    return index + AXIS_OFFSET * axis if 0x6000 <= index < 0x6800 else index


#: Error codes of drives (CiA 402, table 20, and CiA 301, table 26) that a person can do something about.
_ERRORS = {
    0x2310: "drive-error-current",
    0x2320: "drive-error-short",
    0x3210: "drive-error-over-voltage",
    0x3220: "drive-error-under-voltage",
    0x4210: "drive-error-hot",
    0x4310: "drive-error-hot",
    0x5441: "drive-error-contactor",
    0x7121: "drive-error-blocked",
    0x7300: "drive-error-sensor",
    0x7305: "drive-error-sensor",
    0x7306: "drive-error-sensor",
    0x7320: "drive-error-position",
    0x8130: "drive-error-missed-station",
    0x8611: "drive-error-following",
    0x8612: "drive-error-limit",
}


def error_meaning(code: int) -> Message | None:
    """What an error code 0x603F of a drive means; None where only its maker knows."""
    id_ = _ERRORS.get(code)
    return None if id_ is None else Message(id_)
