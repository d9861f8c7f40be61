"""The simulated fixture, live: what its sensors read at any instant, by the same physics as a simulated campaign.

It knows no clock, no bus and no positioner: who drives it says what happens when (`load`, `go`) and asks (`sense`).
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Frames
from station.domain.recipe import plan
from station.domain.recipe.plan import PlannedVisit
from station.errors import UsageError
from station.model.climate import Climate, Swing, climate, motor_level
from station.model.forward import (
    ActiveEffects,
    convert_output,
    gold_error,
    sensor_reading,
    sensor_signal,
    signal_during_moves,
    stimulus_in_nest,
)
from station.model.live_unit import FixtureMove, LiveUnit
from station.model.recording import THERMOMETER_STD
from station.model.scene import Scene, Signal
from station.model.simulate import SimulationJob
from station.model.timeline import run_timeline

#: Instants (n) → nest → station rotations (n, 3, 3) of the positioner's plate.
FixtureRotation = Callable[[Floats], Floats]


class Rig:
    """One fixture with any number of nests. job: recipe, seed, causes and model; its `units` do not matter.

    Instants are seconds of one clock, the same for all calls.
    """

    def __init__(self, job: SimulationJob, plate: FixtureRotation) -> None:
        self._job = job.with_drawn_form()
        self._plate = plate
        # Asked of at every look at a sensor; it hangs on the recipe alone.
        self._duration_s = cache(lambda run: run_timeline(job.recipe, run, job.line).duration_s)
        self._units: dict[str, LiveUnit] = {}
        self._loads = -1
        self._powered_s = self._clamped_s = 0.0
        self._begin(0.0)

    def load(self, units: Mapping[str, str], now_s: float, labels: Mapping[str, str] | None = None) -> None:
        """Clamps and powers a unit in each nest (nest → serial). labels: station, lot and operator, where known."""
        self._loads += 1
        self._powered_s = self._clamped_s = now_s
        self._units = {
            nest: LiveUnit(self._job, unit, {"nest": nest, **(labels or {})}) for nest, unit in units.items()
        }
        self._begin(now_s)

    def go(self, visit: PlannedVisit, departs_s: float, arrives_s: float) -> None:
        """The fixture moves to a visit. A visit of another run starts that run; another seating is clamped before the
        warming up that the run asks for, and the power stays on."""
        if self._moves_done and self._moves_done[-1].arrives_s == np.inf:
            self._moves_done.clear()
        if self._moves_done and visit.run != self._moves_done[-1].visit.run:
            if visit.seating != self._moves_done[-1].visit.seating:
                self._clamped_s = departs_s - plan.run_of_pass(self._job.recipe, visit.run).prewarm_s
            self._begin(departs_s)
        on = plan.run_of_pass(self._job.recipe, visit.run).motors == "on"
        level = motor_level(self._job.seed, self._loads, visit.run, visit.visit) if on else 0.0
        self._moves_done.append(FixtureMove(visit, departs_s, arrives_s, level))
        self._scenes.clear()

    def arrive(self, now_s: float) -> None:
        """The last move has ended now: who began it did not know when."""
        self._moves_done[-1] = replace(self._moves_done[-1], arrives_s=now_s)
        self._scenes.clear()

    def sense(self, nest: str, time_s: Floats) -> Floats:
        """Readings (n, 3) of the unit in a nest at instants (n), in order; nothing before the last move but one.

        In the recipe's unit, before the converter. UsageError when the nest is empty.
        """
        seat = self._unit(nest)
        signal, active = self._signal(nest, np.asarray(time_s, float))
        reading = sensor_reading(signal, seat.base, active) + seat.noise(signal.scene.time_s)
        return convert_output(signal.scene, reading, active)

    def gold(self, nest: str, time_s: Floats) -> Floats:
        """Readings (n, 3) of a gold reference in a nest, in the nest's frame, without noise."""
        signal, active = self._signal(nest, np.asarray(time_s, float))
        seat_R = signal.scene.visits.seat_R[signal.scene.visit]
        moving = np.einsum("nij,nj->ni", seat_R, signal.true - signal.at_visit[signal.scene.visit])
        felt = (stimulus_in_nest(signal.scene, active) + gold_error(signal.scene, active))[signal.scene.visit] + moving
        own = self._job.recipe.reference.gold
        return np.asarray(felt if own is None else felt @ np.array(own.matrix).T + own.offset)

    def temperature_degC(self, nest: str, time_s: Floats) -> Floats:
        """What the thermometer of the unit in a nest shows (n)."""
        at_s = np.asarray(time_s, float)
        bare, _ = self._bare(nest, at_s)
        noise = THERMOMETER_STD * self._unit(nest).thermometer.standard_normal(len(at_s))
        return np.asarray(self._climate(bare, at_s)["temperature_degC"] + noise)

    def rate_error(self, nest: str) -> float:
        """How much faster than its data sheet the unit in a nest samples, relative."""
        return self._unit(nest).rate_error

    def deliver(self, nest: str, frames: Frames) -> Frames:
        """The frames of a nest as they arrive: payloads in the order of arrival, times still in order."""
        return self._unit(nest).delivered(frames)

    def _begin(self, now_s: float) -> None:
        """A run starts: no visit yet."""
        self._started_s = now_s
        self._moves_done: list[FixtureMove] = []
        self._scenes: dict[str, tuple[Scene, ActiveEffects]] = {}

    def _unit(self, nest: str) -> LiveUnit:
        if nest not in self._units:
            raise UsageError("simulated-nest-empty", nest=nest, nests=tuple(self._units))
        return self._units[nest]

    def _signal(self, nest: str, time_s: Floats) -> tuple[Signal, ActiveEffects]:
        """What a unit feels at instants (n), the moves included."""
        scene, active = self._at(nest, time_s)
        signal = sensor_signal(scene, active)
        moving = time_s < self._arrivals()[scene.visit]
        if not moving.any():
            return signal, active
        return signal_during_moves(signal, moving, self._plate(time_s[moving])), active

    def _at(self, nest: str, time_s: Floats) -> tuple[Scene, ActiveEffects]:
        """The scene of instants (n) for a nest, and the causes at work in it."""
        bare, active = self._bare(nest, time_s)
        departs = np.array([w.departs_s for w in self._moves_done])
        visit = np.maximum(np.searchsorted(departs, time_s, side="right") - 1, 0)
        return self._conditions(bare, visit, time_s), active

    def _bare(self, nest: str, time_s: Floats) -> tuple[Scene, ActiveEffects]:
        """The visits of a nest so far, without an instant, and the causes at work in them."""
        seat = self._unit(nest)
        if not self._moves_done:
            # Parked: as if on the way to the first visit, not yet left.
            self._moves_done.append(FixtureMove(self._first(), self._started_s, np.inf))
        self._come_to_rest(float(time_s[-1]) if len(time_s) else self._started_s)
        if nest not in self._scenes:
            none = np.zeros(0, np.intp)
            bare = Scene(self._job.recipe, seat.visits(self._moves_done), none, np.zeros(0))
            self._scenes[nest] = bare, seat.active(bare)
        return self._scenes[nest]

    def _first(self) -> PlannedVisit:
        """The recipe's first visit."""
        if not self._job.recipe.positions:
            raise UsageError("simulated-without-positions")
        return plan.planned_visits(self._job.recipe, 0)[0]

    def _come_to_rest(self, now_s: float) -> None:
        """Looks how the plate stands once it has arrived."""
        last = self._moves_done[-1]
        if last.plate is None and now_s >= last.arrives_s:
            self._moves_done[-1] = replace(last, plate=self._plate(np.array([max(last.arrives_s, now_s)]))[0])
            self._scenes.clear()

    def _arrivals(self) -> Floats:
        return np.array([w.arrives_s for w in self._moves_done])

    def _conditions(self, bare: Scene, visit: NDArray[np.intp], time_s: Floats) -> Scene:
        """The scene at instants (n), with what thermometer, clock and motors would tell."""
        return replace(
            bare,
            visit=visit,
            time_s=np.maximum(time_s - self._started_s, 0.0),
            since_arrival_s=np.maximum(time_s - self._arrivals()[visit], 0.0),
            motor=np.array([w.motor for w in self._moves_done])[visit],
            **self._climate(bare, time_s),
        )

    def _climate(self, bare: Scene, time_s: Floats) -> Climate:
        """Temperature and clocks at instants (n)."""
        job, one, run = self._job, np.ones(len(time_s)), int(bare.visits.run[0])
        how = plan.run_of_pass(job.recipe, run)
        started = self._started_s * one
        since = np.maximum(time_s - started, 0.0)
        powered, clamped = started - self._powered_s, started - self._clamped_s
        swing = Swing(how.temperature_swing_degC * one, self._duration_s(run) * one)
        offset = how.temperature_offset_degC * one
        return climate(since, started, powered, clamped, offset, swing, line=job.line, seed=job.seed)
