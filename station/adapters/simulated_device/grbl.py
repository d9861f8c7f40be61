"""A GRBL 1.1 controller in numbers: real-time commands, `ok` when a line is accepted (not when it has arrived), alarms.

Answers are worded as those of GRBL 1.1h (its wiki, "Grbl v1.1 Interface").
"""

import re
from collections.abc import Sequence

import numpy as np

from station.adapters.simulated_device.drive.motor import Motor
from station.domain.core.types import Floats

#: What can be wrong with it: alarm from the start; a limit hit, a door opened, a reset or a jam in the first move;
#: lines refused; nothing said; half a degree reported aside.
FAULTS = ("alarm-before", "limit", "door", "reset", "jammed", "refuses", "silent", "stands-aside")
_WORD = re.compile(r"([A-Z])(-?[0-9.]+)")
_BEGIN_S = 0.2
_LOCKED = "[MSG:'$H'|'$X' to unlock]"


class GrblStub:
    """One controller. `feed` takes what was written to it, `answers` gives what it has said since."""

    def __init__(self, acceleration: float, fault: str = "") -> None:
        self._acceleration, self.fault = acceleration, fault
        self._motors = (Motor(), Motor())
        self._replies: list[str] = ["", "Grbl 1.1h ['$' for help]"]
        self._rest = ""
        self._state = "Idle"
        self._rests_s = 0.0
        self._strikes_s = float("inf")
        if fault == "alarm-before":
            self._state = "Alarm"
            self._replies.append(_LOCKED)

    def feed(self, data: bytes, now_s: float) -> None:
        """Bytes that came; real-time commands act at once, lines when they end."""
        self._run(now_s)
        for character in data.decode("latin-1"):
            if character == "?":
                self._replies.append(self._status(now_s))
            elif character == "!":
                self._hold(now_s)
            elif character == "\x18":
                self._reset(now_s)
            elif character in "\r\n":
                line, self._rest = self._rest.strip(), ""
                if line:
                    self._replies.append(self._take(line, now_s))
            else:
                self._rest += character

    def answers(self, now_s: float) -> bytes:
        """What it has said."""
        self._run(now_s)
        replies, self._replies = self._replies, []
        if self.fault == "silent":
            return b""
        return "".join(line + "\r\n" for line in replies).encode()

    def place(self, now_s: float) -> tuple[float, float]:
        """Where its axes stand."""
        x, y = (motor.at(now_s)[0] for motor in self._motors)
        return x, y

    def places(self, times_s: Floats) -> Floats:
        """Where its axes stood (n, 2) at instants (n)."""
        return np.stack([motor.places(times_s) for motor in self._motors], axis=-1)

    def moving(self, now_s: float) -> bool:
        """Whether any axis turns."""
        return any(abs(motor.at(now_s)[1]) > 1e-9 for motor in self._motors)

    def _status(self, now_s: float) -> str:
        x, y = self.place(now_s)
        aside = 0.5 if self.fault == "stands-aside" and abs(x) + abs(y) > 1 else 0.0
        state = self._state
        if state == "Hold":
            state = f"Hold:{int(self.moving(now_s))}"
        elif state == "Door":
            state = "Door:1"
        return f"<{state}|MPos:{x + aside:.3f},{y:.3f},0.000|FS:0,0>"

    def _take(self, line: str, now_s: float) -> str:
        if self._state == "Alarm":
            return "error:9"
        if self.fault == "refuses" and "X" in line:
            return "error:15"
        words = {letter: float(number) for letter, number in _WORD.findall(line)}
        if ("X" in words or "Y" in words) and self.fault != "jammed":
            self._go([words.get("X", 0.0), words.get("Y", 0.0)], words.get("F", 600.0) / 60, now_s)
        elif "X" in words or "Y" in words:
            self._state, self._rests_s = "Run", float("inf")
        return "ok"

    def _go(self, goal: Sequence[float], speed: float, now_s: float) -> None:
        """A straight line: both axes keep their share of speed and acceleration."""
        ways = [g - p for g, p in zip(goal, self.place(now_s), strict=True)]
        length = sum(w * w for w in ways) ** 0.5
        if length == 0:
            return
        for motor, end, way in zip(self._motors, goal, ways, strict=True):
            if way:
                share = abs(way) / length
                motor.go(now_s, end, speed * share, self._acceleration * share, self._acceleration * share)
        self._state, self._rests_s = "Run", max(m.rests_from_s() for m in self._motors)
        if self.fault in ("limit", "door", "reset"):
            self._strikes_s = now_s + _BEGIN_S

    def _run(self, now_s: float) -> None:
        if now_s >= self._strikes_s:
            self._strikes_s = float("inf")
            self._stop(now_s)
            if self.fault == "door":
                self._state = "Door"
            else:
                self._state = "Alarm"
                self._replies += [f"ALARM:{1 if self.fault == 'limit' else 3}", _LOCKED]
        if self._state == "Run" and now_s >= self._rests_s:
            self._state = "Idle"

    def _hold(self, now_s: float) -> None:
        if self._state == "Run":
            self._stop(now_s)
            self._state = "Hold"

    def _reset(self, now_s: float) -> None:
        moving = self.moving(now_s)
        self._stop(now_s)
        self._replies += ["", "Grbl 1.1h ['$' for help]"]
        if moving or self._state == "Alarm":
            self._replies += ["ALARM:3"] * moving + [_LOCKED]
            self._state = "Alarm"
        else:
            self._state = "Idle"

    def _stop(self, now_s: float) -> None:
        for motor in self._motors:
            motor.stop(now_s, self._acceleration)
