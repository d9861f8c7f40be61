"""One axis of a simulated drive: the state machine of CiA 402, profile position, homing, limits, and its faults.

It lives in calls: `write` (an object was written), `run` (time has passed). Nothing here knows frames.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from station.adapters.simulated_device.drive.drive_fault import DriveFault
from station.adapters.simulated_device.drive.motor import Motor
from station.adapters.simulated_device.sdo import Agenda
from station.domain.rig import drive_profile as profile
from station.domain.rig.drive_profile import DriveState

#: Statusword bits of each state (table 30 of the profile).
_BITS = {
    DriveState.DISABLED: 0x40,
    DriveState.READY: 0x21,
    DriveState.SWITCHED_ON: 0x23,
    DriveState.ENABLED: 0x27,
    DriveState.QUICK_STOPPED: 0x07,
    DriveState.FAULT_REACTION: 0x0F,
    DriveState.FAULT: 0x08,
}
#: What the motor's own friction or brake slows it down with, counts/s², when its power stage goes off.
_COAST_FACTOR = 4.0
_STEP_S = 0.002
#: Error codes (CiA 402, table 20): over-current, following error, limit switch, heartbeat, supply of the power stage.
OVER_CURRENT, FOLLOWING_ERROR, SUPPLY = 0x2310, 0x8611, 0x3220


@dataclass(frozen=True, slots=True)
class Mechanics:
    """What the axis turns, in counts of its encoder. counts_per_deg may be negative; home: where its home switch is;
    ends: limit switches; absolute: the encoder knows its place at power-on."""

    counts_per_deg: float
    home: float
    ends: tuple[float, float]
    absolute: bool = True


class DriveAxis:
    """values: its objects by index in the profile (0x6040 …) and sub-index; errors: codes to be reported as EMCY."""

    def __init__(self, number: int, mechanics: Mechanics, faults: Sequence[DriveFault], place: float = 0.0) -> None:
        self.number, self.mechanics = number, mechanics
        self.motor = Motor(place)
        self.errors: list[int] = []
        self.reset_wanted = self.power_cut = False
        self.torque_off = False
        self.moves = 0
        self.move_began_s = math.inf
        self._faults = [f for f in faults if f.axis == number]
        self._encoder_at = 0.0
        self.power_on(0.0)
        self.torque_off = self.has("safe-torque-off-before")
        if self.has("enabled-before"):
            self.state = DriveState.ENABLED
        if self.has("fault-before"):
            self._fail(0.0, OVER_CURRENT)
            self.state = DriveState.FAULT

    def power_on(self, now_s: float) -> None:
        """Values and state as after power-on; an incremental encoder starts at zero."""
        self.state = DriveState.DISABLED
        self.motor.stop(now_s, abs(self.mechanics.counts_per_deg) * 1e6)
        self._encoder_at = 0.0 if self.mechanics.absolute else self.motor.at(now_s)[0]
        self._agenda = Agenda()
        self._control = 0
        self._now_s = now_s
        self._acknowledged = self._homed = self._homing_error = False
        self._reached = True
        self._homing, self._homings = False, 0
        self._limited = False
        self._shown_mode = 0
        self._error = 0
        self._frozen: tuple[int, int] | None = None
        ppd = abs(self.mechanics.counts_per_deg)
        self.values: dict[tuple[int, int], int] = {
            (0x6007, 0): 1, (0x605A, 0): 2, (0x605D, 0): 1, (0x605E, 0): 2, (0x6060, 0): 0,
            (0x6065, 0): 2**32 - 1, (0x6066, 0): 0, (0x6067, 0): 2**32 - 1, (0x6068, 0): 0,
            (0x607A, 0): 0, (0x607C, 0): 0, (0x607D, 1): -(2**31), (0x607D, 2): 2**31 - 1,
            (0x6081, 0): round(10 * ppd), (0x6083, 0): round(50 * ppd), (0x6084, 0): round(50 * ppd),
            (0x6085, 0): round(500 * ppd), (0x6098, 0): 0, (0x6099, 1): round(5 * ppd), (0x6099, 2): round(ppd),
            (0x609A, 0): round(50 * ppd), (0x6040, 0): 0,
        }  # fmt: skip
        if self.has("stale-target"):
            self.values[0x607A, 0] = self.encoder(now_s) + round(90 * ppd)

    def has(self, *kinds: str) -> bool:
        """Whether one of these faults is there at all."""
        return any(f.kind in kinds for f in self._faults)

    def active(self, now_s: float, *kinds: str) -> bool:
        """Whether one of these faults has begun: so long into that move, or at any time after it."""
        return any(
            f.kind in kinds
            and (self.moves > f.move or (self.moves == f.move and now_s >= self.move_began_s + f.after_s - 1e-9))
            for f in self._faults
        )

    def encoder(self, now_s: float) -> int:
        """Position actual value."""
        return round(self.motor.at(now_s)[0] - self._encoder_at)

    def statusword(self) -> int:
        """The present statusword."""
        word = _BITS.get(self.state, 0)
        word |= 0 if self.has("no-supply") or self.torque_off else profile.VOLTAGE
        word |= 0 if self.has("local") else profile.REMOTE
        word |= profile.REACHED if self._shows_reached() else 0
        word |= profile.INTERNAL_LIMIT if self._limited else 0
        if self._shown_mode == profile.HOMING:
            word |= (profile.HOMED if self._homed else 0) | (profile.FAILED if self._homing_error else 0)
        else:
            word |= profile.ACKNOWLEDGED if self._acknowledged else 0
        return word

    def reported(self, now_s: float) -> tuple[int, int]:
        """Statusword and position as process data show them; a fault may freeze them."""
        if not self.active(now_s, "status-frozen"):
            self._frozen = self.statusword(), self.encoder(now_s)
        return self._frozen or (self.statusword(), self.encoder(now_s))

    @property
    def shown_mode(self) -> int:
        """Modes of operation display."""
        return self._shown_mode

    @property
    def error(self) -> int:
        """Error code 0x603F."""
        return self._error

    def next_due_s(self) -> float:
        """When something happens by itself."""
        return min(self._agenda.next_s, self._settles_s())

    def run(self, now_s: float) -> None:
        """Does what was due until now."""
        self._now_s = now_s
        self._agenda.run(now_s)
        if now_s >= self._settles_s() - 1e-9:
            self._reached = True
            if self.has("creeps") and self.moves and self.state is DriveState.ENABLED:
                self.motor.turn(now_s + 1e-6, abs(self.mechanics.counts_per_deg) * 3.0, 1e7)

    def _settles_s(self) -> float:
        """When target reached is due: at rest, and after the window's time where the drive is enabled."""
        if self._reached or self._homing:
            return math.inf
        window_s = self.values[profile.POSITION_TIME, 0] / 1000 if self.state is DriveState.ENABLED else 0.0
        return max(self.motor.rests_from_s() + window_s, self._now_s)

    def write(self, index: int, sub: int, value: int, now_s: float) -> None:
        """An object was written."""
        self._now_s = now_s
        self.values[index, sub] = value
        if index == profile.CONTROLWORD:
            self._obey(value, now_s)
        elif index == profile.MODE and not self.has("mode-ignored"):
            lag_s = 0.3 if self.has("mode-lag") else _STEP_S / 2
            self._agenda.at(now_s + lag_s, lambda: self._show_mode(value))
        elif index == profile.TARGET and self.has("target-changed"):
            self.values[index, sub] = value + 1000

    def lose_connection(self, now_s: float) -> None:
        """The station fell silent: does what 0x6007 says."""
        option = self.values[profile.ABORT_CONNECTION_OPTION, 0]
        if self.state is not DriveState.ENABLED or option == 0:
            return
        self.errors.append(0x8130)
        self._error = 0x8130
        if option == 3:
            self._quick_stop(now_s)
        elif option == 2:
            self._coast(now_s, DriveState.DISABLED)
        else:
            self._fail(now_s, 0x8130)

    def cut_torque(self, now_s: float) -> None:
        """The safety circuit opens."""
        self.torque_off = True
        self._coast(now_s, DriveState.DISABLED)

    def _shows_reached(self) -> bool:
        early = self.has("reached-early") and self.moves > 0
        return self._reached or early

    def _show_mode(self, mode: int) -> None:
        self._shown_mode = mode
        self._homed = self._homing_error = False

    def _ramp(self, index: int) -> float:
        return float(max(1, self.values[index, 0]))

    # The state machine.

    def _obey(self, word: int, now_s: float) -> None:
        before, self._control = self._control, word
        if self.state is DriveState.FAULT:
            if word & profile.FAULT_RESET and not before & profile.FAULT_RESET:
                self._error = 0
                self.state = DriveState.DISABLED
            return
        if not word & 2:
            self._leave_power(now_s)
        elif not word & 4:
            self._quick_stop(now_s)
        elif word & 0xF in (0x6, 0xE):
            self._shut_down(now_s)
        else:
            self._switch_on(word, now_s)
        if self.state is DriveState.ENABLED:
            self._operate(word, before, now_s)

    def _leave_power(self, now_s: float) -> None:
        if self.state is not DriveState.DISABLED:
            self._coast(now_s, DriveState.DISABLED)

    def _shut_down(self, now_s: float) -> None:
        if self.state is DriveState.DISABLED and not self.torque_off:
            self.state = DriveState.READY
        elif self.state in (DriveState.SWITCHED_ON, DriveState.ENABLED):
            self._coast(now_s, DriveState.READY)

    def _switch_on(self, word: int, now_s: float) -> None:
        if self.state is DriveState.READY and not self.has("no-supply"):
            self.state = DriveState.SWITCHED_ON
        elif self.state is DriveState.ENABLED and word & 0xF == profile.SWITCH_ON:
            self._coast(now_s, DriveState.SWITCHED_ON)
        elif self.state in (DriveState.SWITCHED_ON, DriveState.QUICK_STOPPED) and word & 0xF == profile.ENABLE:
            self._enable(now_s)

    def _enable(self, now_s: float) -> None:
        if self.has("enable-refused"):
            return
        if self.has("fault-at-enable"):
            self._fail(now_s, SUPPLY)
            return
        self.state = DriveState.ENABLED
        if self.has("stale-target") and self.values[profile.TARGET, 0] != self.encoder(now_s):
            self._set_point(now_s)

    def _quick_stop(self, now_s: float) -> None:
        if self.state is DriveState.ENABLED:
            self.state = DriveState.QUICK_STOPPED
            self._acknowledged = False
            self._stop_homing()
            if not self.has("halt-ignored", "runaway"):
                self._brake(now_s, self._ramp(profile.QUICK_STOP_DECELERATION))
        elif self.state in (DriveState.READY, DriveState.SWITCHED_ON):
            self.state = DriveState.DISABLED

    def _coast(self, now_s: float, state: DriveState) -> None:
        """The power stage goes off: the brake falls in."""
        self.state = state
        self._acknowledged = False
        self._stop_homing()
        self._brake(now_s, self._ramp(profile.QUICK_STOP_DECELERATION) * _COAST_FACTOR)

    def _fail(self, now_s: float, code: int) -> None:
        self.errors.append(code)
        self._error = code
        self.state = DriveState.FAULT
        self._acknowledged = False
        self._stop_homing()
        self._brake(now_s, self._ramp(profile.QUICK_STOP_DECELERATION))

    def _brake(self, now_s: float, deceleration: float) -> None:
        self.motor.stop(now_s, deceleration)
        self._reached = False

    # Operation.

    def _operate(self, word: int, before: int, now_s: float) -> None:
        if word & profile.HALT:
            if not self.has("halt-ignored"):
                self._brake(now_s, self._ramp(profile.DECELERATION))
            return
        start = bool(word & profile.START)
        rises = start and not bool(before & profile.START)
        if self._shown_mode == profile.PROFILE_POSITION:
            if rises and not self.has("acknowledge-missing"):
                self._set_point(now_s)
            elif not start and not self.has("acknowledge-stuck"):
                self._acknowledged = False
        elif self._shown_mode == profile.HOMING and rises:
            self._home(now_s)

    def _set_point(self, now_s: float) -> None:
        self._acknowledged, self._reached = True, False
        self.moves += 1
        self.move_began_s = now_s
        goal = float(self.values[profile.TARGET, 0])
        low, high = self.values[profile.SOFTWARE_LIMITS, 1], self.values[profile.SOFTWARE_LIMITS, 2]
        self._limited = not low <= goal <= high
        goal = min(max(goal, low), high) + self._encoder_at
        speed, ramp = self._ramp(profile.SPEED), self._ramp(profile.ACCELERATION)
        place = self.motor.at(now_s)[0]
        if self.has("reached-outside"):
            goal += math.copysign(0.5 * abs(self.mechanics.counts_per_deg), place - goal)
        if self.has("jammed"):
            return
        if self.has("runaway"):
            self.motor.turn(now_s, math.copysign(speed, goal - place), ramp)
            return
        if self.has("wrong-way"):
            goal = 2 * place - goal
        slower = 50.0 if self.has("slow") else 1.0
        self.motor.go(now_s, goal, speed / slower, ramp, self._ramp(profile.DECELERATION))
        self._plan_faults(now_s)

    def _plan_faults(self, now_s: float) -> None:
        for fault in self._faults:
            if fault.move == self.moves:
                self._agenda.at(now_s + fault.after_s, lambda f=fault: self._strike(f, now_s + f.after_s))  # type: ignore[misc]
        for place in self.mechanics.ends:
            if math.isfinite(passes_s := self.motor.passes_s(place, now_s)):
                self._agenda.at(passes_s, lambda at=passes_s: self._hit_end(at))  # type: ignore[misc]

    def _strike(self, fault: DriveFault, now_s: float) -> None:
        """A fault of a move begins."""
        if fault.kind in ("emergency", "following-error"):
            self._fail(now_s, OVER_CURRENT if fault.kind == "emergency" else FOLLOWING_ERROR)
        elif fault.kind == "limit-switch":
            self._hit_end(now_s)
        elif fault.kind == "safe-torque-off":
            self.cut_torque(now_s)
        elif fault.kind in ("switches-off", "second-master"):
            self._coast(now_s, DriveState.DISABLED)
        elif fault.kind == "slips":
            self.motor.shift(now_s, 5.0 * abs(self.mechanics.counts_per_deg))
        elif fault.kind == "quick-stops":
            self._quick_stop(now_s)
        elif fault.kind == "brown-out":
            self.reset_wanted = True
        elif fault.kind == "power-lost":
            self.power_cut = True

    def _hit_end(self, now_s: float) -> None:
        if self.state is DriveState.ENABLED and now_s < self.motor.rests_from_s():
            self._limited = True
            self._brake(now_s, self._ramp(profile.QUICK_STOP_DECELERATION))

    # Homing.

    def _home(self, now_s: float) -> None:
        if self.has("homing-pretended"):
            self._homed = self._reached = True
            return
        self._homing, self._homed, self._homing_error, self._reached = True, False, False, False
        if self.has("homing-fails"):
            self._agenda.at(now_s + 0.2, self._fail_homing)
            return
        place = self.motor.at(now_s)[0]
        home = math.inf if self.has("homing-endless") else self.mechanics.home
        fast, slow = float(self.values[profile.HOMING_SPEEDS, 1]), float(self.values[profile.HOMING_SPEEDS, 2])
        ramp = self._ramp(profile.HOMING_ACCELERATION)
        if math.isinf(home):
            self.motor.turn(now_s, -fast, ramp)
            return
        beyond = home + math.copysign(fast * fast / ramp / 2 + 1, home - place)
        self.motor.go(now_s, beyond, fast, ramp, ramp)
        there_s = self.motor.rests_from_s()
        self._homings += 1
        number = self._homings
        self._agenda.at(there_s, lambda: self._return_home(number, there_s, home, slow, ramp))

    def _return_home(self, number: int, now_s: float, home: float, slow: float, ramp: float) -> None:
        if not self._homing or number != self._homings:
            return
        self.motor.go(now_s, home, slow, ramp, ramp)
        there_s = self.motor.rests_from_s()
        self._agenda.at(there_s, lambda: self._found_home(number, there_s))

    def _found_home(self, number: int, now_s: float) -> None:
        if self._homing and number == self._homings:
            self._homing = False
            wrong = 5000 if self.has("homing-elsewhere") else 0
            self._encoder_at = self.motor.at(now_s)[0] - self.values[profile.HOME_OFFSET, 0] - wrong
            self._homed = self._reached = True

    def _fail_homing(self) -> None:
        if self._homing:
            self._homing, self._homing_error = False, True

    def _stop_homing(self) -> None:
        self._homing = False
