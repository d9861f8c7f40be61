"""A motor in closed form: pieces of constant acceleration, so that its place is known at any instant, past ones too."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats

#: Pieces that are remembered: some minutes of moving.
_REMEMBERED = 4000


@dataclass(frozen=True, slots=True)
class _Piece:
    """From start_s for lasts_s: place p, speed v at its start, constant acceleration a."""

    start_s: float
    lasts_s: float
    place: float
    speed: float
    acceleration: float

    def at(self, time_s: float) -> tuple[float, float]:
        """Place and speed."""
        if not self.speed and not self.acceleration:
            return self.place, 0.0
        t = min(max(time_s - self.start_s, 0.0), self.lasts_s)
        return self.place + (self.speed + self.acceleration * t / 2) * t, self.speed + self.acceleration * t


class Motor:
    """Place in counts of the mechanics, where nothing is ever set to zero."""

    def __init__(self, place: float = 0.0) -> None:
        self._pieces: deque[_Piece] = deque([_Piece(-math.inf, math.inf, place, 0.0, 0.0)], maxlen=_REMEMBERED)

    def at(self, time_s: float) -> tuple[float, float]:
        """Place and speed at an instant, counts and counts/s."""
        return self._piece(time_s).at(time_s)

    def places(self, times_s: Floats) -> Floats:
        """Places (n) at instants (n)."""
        return np.array([self.at(t)[0] for t in times_s.tolist()])

    def rests_from_s(self) -> float:
        """When the last plan comes to rest; infinity while it turns without end."""
        last = self._pieces[-1]
        return last.start_s if last.speed == 0 and last.acceleration == 0 else math.inf

    def go(self, now_s: float, goal: float, speed: float, acceleration: float, deceleration: float) -> None:
        """Turns to a place by a trapezium; what moves stops first."""
        self.stop(now_s, deceleration)
        start_s = self.rests_from_s()
        place = self._pieces[-1].place
        way = abs(goal - place)
        if way == 0:
            return
        sign = math.copysign(1.0, goal - place)
        peak = min(speed, math.sqrt(2 * way * acceleration * deceleration / (acceleration + deceleration)))
        ramps = peak * peak / 2 * (1 / acceleration + 1 / deceleration)
        self._append(start_s, place, 0.0, sign * acceleration, peak / acceleration)
        self._continue(0.0, (way - ramps) / peak)
        self._continue(-sign * deceleration, peak / deceleration)
        self._rest(goal)

    def turn(self, now_s: float, speed: float, acceleration: float) -> None:
        """Turns on at a speed (signed) without end."""
        place, now = self.at(now_s)
        self._cut(now_s)
        change = speed - now
        self._append(now_s, place, now, math.copysign(acceleration, change), abs(change) / acceleration)
        self._continue(0.0, math.inf)

    def stop(self, now_s: float, deceleration: float) -> None:
        """Slows down to rest."""
        place, speed = self.at(now_s)
        self._cut(now_s)
        if speed:
            self._append(now_s, place, speed, -math.copysign(deceleration, speed), abs(speed) / deceleration)
            self._rest(None)
        else:
            self._pieces.append(_Piece(now_s, math.inf, place, 0.0, 0.0))

    def shift(self, now_s: float, by: float) -> None:
        """Jumps, as a shaft does whose coupling slips or whose encoder loses counts."""
        place, _ = self.at(now_s)
        self._cut(now_s)
        self._pieces.append(_Piece(now_s, math.inf, place + by, 0.0, 0.0))

    def passes_s(self, place: float, from_s: float) -> float:
        """First instant from then on at which it passes a place; infinity where it never does."""
        for piece in self._pieces:
            end_s = piece.start_s + piece.lasts_s
            if end_s <= from_s or not (piece.speed or piece.acceleration):
                continue
            roots = _roots(piece.acceleration / 2, piece.speed, piece.place - place)
            times = sorted(piece.start_s + t for t in roots if 0 <= t <= piece.lasts_s)
            for time_s in times:
                if time_s >= from_s:
                    return time_s
        return math.inf

    def _piece(self, time_s: float) -> _Piece:
        for piece in reversed(self._pieces):
            if piece.start_s <= time_s:
                return piece
        return self._pieces[0]

    def _cut(self, now_s: float) -> None:
        """Forgets what was planned after now."""
        while len(self._pieces) > 1 and self._pieces[-1].start_s >= now_s:
            self._pieces.pop()
        last = self._pieces[-1]
        if not math.isinf(last.start_s):
            self._pieces[-1] = _Piece(
                last.start_s, min(last.lasts_s, now_s - last.start_s), last.place, last.speed, last.acceleration
            )

    def _append(self, start_s: float, place: float, speed: float, acceleration: float, lasts_s: float) -> None:
        if lasts_s > 0:
            self._pieces.append(_Piece(start_s, lasts_s, place, speed, acceleration))

    def _continue(self, acceleration: float, lasts_s: float) -> None:
        last = self._pieces[-1]
        end_s = last.start_s + last.lasts_s
        place, speed = last.at(end_s)
        self._append(end_s, place, speed, acceleration, lasts_s)

    def _rest(self, place: float | None) -> None:
        last = self._pieces[-1]
        end_s = last.start_s + last.lasts_s
        self._pieces.append(_Piece(end_s, math.inf, last.at(end_s)[0] if place is None else place, 0.0, 0.0))


def _roots(a: float, b: float, c: float) -> tuple[float, ...]:
    """Real roots of a t² + b t + c."""
    if a == 0:
        return (-c / b,) if b else ()
    square = b * b - 4 * a * c
    if square < 0:
        return ()
    root = math.sqrt(square)
    return ((-b - root) / (2 * a), (-b + root) / (2 * a))
