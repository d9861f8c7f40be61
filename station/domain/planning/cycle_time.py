"""How long a load takes: planned moves and dwells, at the pace of loads that the station has already made."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.domain.recipe import plan
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.recipe import Recipe

#: Turns below this angle are none, degrees.
LEAST_TURN_DEG = 1.0


@dataclass(frozen=True, slots=True)
class TimedVisit:
    """When a stored visit began and ended, s from the start of its attempt. verifying: through the corrected output."""

    run: int
    position: str
    arrived_s: float
    left_s: float
    verifying: bool


@dataclass(frozen=True, slots=True)
class TimedAttempt:
    """A stored attempt that passed, with the recipe it was made by. dwell_s: planned, of each visit of the recipe;
    units: how many were on the fixture with it, itself included."""

    recipe: Recipe
    dwell_s: Floats
    duration_s: float
    visits: tuple[TimedVisit, ...]
    units: int = 1


@dataclass(frozen=True, slots=True)
class Pace:
    """What a station takes beside planned settling and dwell, s. begin: identification of a unit; extra: of each visit;
    turn: of a move, as turn_s + angle · turn_s_per_deg; change: computing, writing, saving, restarting a unit after the
    last visit before the verification; reload: between runs, beside warming up; end: closing the record. Units are
    identified and written one after the other."""

    begin_s: float = 0.05
    extra_s: float = 0.03
    turn_s: float = 0.5
    turn_s_per_deg: float = 1 / 90
    change_s: float = 0.6
    reload_s: float = 0.0
    end_s: float = 0.03

    def move_s(self, angle_deg: float) -> float:
        """A move by that angle."""
        return 0.0 if angle_deg < LEAST_TURN_DEG else self.turn_s + angle_deg * self.turn_s_per_deg


@dataclass(frozen=True, slots=True)
class _Leg:
    """The way to one planned visit. kind: start, turn, reload or change; angle in degrees; stay_s: settling, dwell."""

    kind: str
    angle_deg: float
    stay_s: float
    prewarm_s: float = 0.0


def predict_s(recipe: Recipe, dwell_s: Floats, pace: Pace, units: int = 1) -> float:
    """Time from the start of an attempt to its end, s. dwell_s: planned, of each visit; units: of a load."""
    begin_s, change_s = units * pace.begin_s, units * pace.change_s
    extra = {"start": begin_s, "turn": 0.0, "reload": pace.reload_s, "change": change_s}
    legs = list(_legs(recipe, dwell_s))
    end_s = pace.end_s if recipe.verify.positions else change_s + pace.end_s
    return end_s + sum(
        extra[leg.kind] + pace.move_s(leg.angle_deg) + leg.stay_s + pace.extra_s + leg.prewarm_s for leg in legs
    )


def learn(attempts: Sequence[TimedAttempt]) -> Pace:
    """The pace of attempts: medians of each part, a line through the moves. What none of them shows is as usual."""
    usual = Pace()
    parts: dict[str, list[float]] = {}
    moves: list[tuple[float, float]] = []
    paired = [(a, legs) for a in attempts if len(legs := list(_legs(a.recipe, a.dwell_s))) == len(a.visits)]
    for attempt, legs in paired:
        before_s = 0.0
        for visit, leg in zip(attempt.visits, legs, strict=True):
            gap_s = visit.arrived_s - before_s - leg.prewarm_s
            if leg.kind == "turn" and leg.angle_deg >= LEAST_TURN_DEG:
                moves.append((leg.angle_deg, gap_s))
            parts.setdefault("extra", []).append(visit.left_s - visit.arrived_s - leg.stay_s)
            before_s = visit.left_s
        if attempt.recipe.verify.positions:
            parts.setdefault("end", []).append(attempt.duration_s - before_s)
        else:
            parts.setdefault("change", []).append((attempt.duration_s - before_s - usual.end_s) / attempt.units)
    turn_s, per_deg = _line(moves, usual)
    moved = Pace(turn_s=turn_s, turn_s_per_deg=per_deg)
    for attempt, legs in paired:
        before_s = 0.0
        for visit, leg in zip(attempt.visits, legs, strict=True):
            if leg.kind != "turn":
                gap_s = visit.arrived_s - before_s - leg.prewarm_s - moved.move_s(leg.angle_deg)
                share = 1 if leg.kind == "reload" else attempt.units
                parts.setdefault(leg.kind, []).append(gap_s / share)
            before_s = visit.left_s
    median = {name: float(np.median(values)) for name, values in parts.items()}
    return Pace(
        begin_s=median.get("start", usual.begin_s),
        extra_s=median.get("extra", usual.extra_s),
        turn_s=turn_s,
        turn_s_per_deg=per_deg,
        change_s=median.get("change", usual.change_s),
        reload_s=median.get("reload", usual.reload_s),
        end_s=median.get("end", usual.end_s),
    )


def _line(moves: Sequence[tuple[float, float]], usual: Pace) -> tuple[float, float]:
    """Seconds of a move, and seconds a degree; of moves by one angle only, the usual slope."""
    if not moves:
        return usual.turn_s, usual.turn_s_per_deg
    angle, lasted = np.array(moves).T
    if np.ptp(angle) < LEAST_TURN_DEG:
        return float(np.median(lasted - angle * usual.turn_s_per_deg)), usual.turn_s_per_deg
    slope, start = np.polyfit(angle, lasted, 1)
    return float(start), float(slope)


def _legs(recipe: Recipe, dwell_s: Floats) -> Iterator[_Leg]:
    """The way to each visit of the recipe, in order, those of the verification last."""
    at, place = np.eye(3), 0
    for number, run in enumerate(recipe.runs):
        for i, visit in enumerate(plan.planned_visits(recipe, number)):
            kind = "turn" if i else "reload" if number else "start"
            stay_s = recipe.settle.time_s + float(dwell_s[place])
            yield _Leg(kind, _angle_deg(at, visit), stay_s, 0.0 if i else run.prewarm_s)
            at, place = visit.nest, place + 1
    usual_s = recipe.settle.time_s + float(np.median(dwell_s))
    for i, visit in enumerate(plan.verification_visits(recipe, len(recipe.runs) - 1, place)):
        yield _Leg("turn" if i else "change", _angle_deg(at, visit), usual_s)
        at = visit.nest


def _angle_deg(nest: Floats, visit: PlannedVisit) -> float:
    return float(np.rad2deg(np.linalg.norm(rotation.to_vector(nest.T @ visit.nest))))
