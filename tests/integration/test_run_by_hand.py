"""The fixture turned by a person: the station sees the right face, says the wrong one, and fails no unit for it."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from station.adapters.positioner.manual import ManualPositioner
from station.adapters.positioner.simulated import SimulatedPositioner
from station.domain.core.types import Outcome
from station.domain.recipe import plan
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.recipe import Recipe
from station.domain.run.progress import Notice, VisitStarted
from station.errors import PositionerFault
from station.messages import render
from station.wiring.bench import Bench
from tests.fakes import fixture_run


class Person:
    """An actor of simulated time who turns the simulated fixture some seconds after being asked; stop by stop,
    perhaps to other positions first. Behind it is the simulated positioner, which the simulated devices stand on."""

    by_hand = True
    turns_nothing = False

    def __init__(
        self, rig: SimulatedPositioner, clock: object, recipe: Recipe, wrong: dict[str, str], delay_s: float
    ) -> None:
        self._rig, self._clock, self._wrong, self._delay_s = rig, clock, wrong, delay_s
        every = [*plan.planned_visits(recipe, 0), *plan.verification_visits(recipe, 0, len(recipe.positions))]
        self._stops = {s.position: s for s in every}
        self._todo: list[tuple[float, PlannedVisit]] = []
        self._estimate = ManualPositioner(ManualPositioner.Settings(), None)  # type: ignore[arg-type]
        clock.attach(self)  # type: ignore[attr-defined]

    def move(self, stop: PlannedVisit, timeout_s: float) -> None:
        now = self._clock.monotonic_s()  # type: ignore[attr-defined]
        first = self._wrong.get(stop.position)
        if first is not None:
            self._todo.append((now + self._delay_s, self._stops[first]))
            now += 3 * self._delay_s
        self._todo.append((now + self._delay_s, stop))

    def where(self) -> None:
        return None

    def estimate_s(self, origin: PlannedVisit | None, stop: PlannedVisit) -> float:
        return self._estimate.estimate_s(origin, stop)

    def park(self, timeout_s: float) -> None:
        self._todo.clear()

    def next_due_s(self) -> float:
        return self._todo[0][0] if self._todo else np.inf

    def act(self, now_s: float) -> None:
        while self._todo and self._todo[0][0] <= now_s:
            self._rig.begin(self._todo.pop(0)[1])


def by_hand(wrong: dict[str, str] | None = None, delay_s: float = 2.0):  # type: ignore[no-untyped-def]
    def wrap(bench: Bench) -> Bench:
        station = bench.station
        assert isinstance(station.positioner, SimulatedPositioner)
        person = Person(station.positioner, station.clock, bench.job.recipe, wrong or {}, delay_s)
        return replace(bench, station=replace(station, positioner=person))

    return wrap


def sentences(events: Iterable[Notice]) -> list[str]:
    return [render(e.message) for e in events]


def test_each_face_is_asked_for_and_recognised(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, units=2, wrap=by_hand())
    assert {r.outcome for r in ran.results.values()} == {Outcome.PASS}
    requested = [render(e.instruction) for e in ran.of(VisitStarted) if e.instruction]
    assert requested[2] == "Bring position 'x-up' up (+x of the unit) and let go."
    assert requested[7] == "Bring position 'verify-tilt' up (45° from +y towards +z of the unit) and let go."
    assert len(requested) == 8
    assert not ran.of(Notice)


@pytest.mark.parametrize(
    "recipe", ["magnetometer-three-point", "magnetometer-six-point", "inclinometer-n-point", "inclinometer-zero"]
)
def test_readings_whose_direction_says_nothing_show_a_turn_too(tmp_path: Path, recipe: str) -> None:
    """Hard iron as large as the field, and angles: nothing is measured before the fixture was turned."""
    ran = fixture_run.run(tmp_path, units=2, recipe=recipe, wrap=by_hand())
    assert {r.outcome for r in ran.results.values()} == {Outcome.PASS}
    assert not ran.of(Notice)


def test_another_position_than_the_wanted_one_is_told_from_a_magnetometer_too(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, recipe="magnetometer-six-point", wrap=by_hand({"x-up": "y-down"}))
    assert {r.outcome for r in ran.results.values()} == {Outcome.PASS}
    (shown,) = sentences(ran.of(Notice))
    assert shown == "Nest A shows another position. Bring position 'x-up' up (+x of the unit) and let go."


def test_a_wrong_face_gets_a_sentence_and_not_a_failed_unit(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, units=2, wrap=by_hand({"x-up": "y-down", "z-down": "x-down"}))
    assert {r.outcome for r in ran.results.values()} == {Outcome.PASS}
    shown = sentences(ran.of(Notice))
    assert shown == [
        "Nest A shows -x up. Bring position 'z-down' up (-z of the unit) and let go.",
        "Nest B shows -x up. Bring position 'z-down' up (-z of the unit) and let go.",
        "Nest A shows -y up. Bring position 'x-up' up (+x of the unit) and let go.",
        "Nest B shows -y up. Bring position 'x-up' up (+x of the unit) and let go.",
    ]
    kinds = [v["kind"] for v in ran.life("SN0001")["visits"]]
    assert kinds == ["tumble"] * 6 + ["verify"] * 2, "no visit was measured on the wrong face"


def test_when_nobody_turns_it_the_station_says_so(tmp_path: Path) -> None:
    timeouts = {"timeouts": {"face_s": 20}}
    ran = fixture_run.run(tmp_path, config=fixture_run.config(tmp_path, **timeouts), wrap=by_hand(delay_s=60.0))
    assert ran.results["SN0001"].outcome is Outcome.ERROR
    assert isinstance(ran.fault, PositionerFault)
    assert "within 20 s: Nest A shows +z up. Start again with" in ran.fault.sentence


@pytest.mark.parametrize("units", [1, 2])
def test_a_wrong_face_of_a_device_that_maps_other_objects_is_not_the_persons(tmp_path: Path, units: int) -> None:
    """Two axes that change places look like another face; nobody waits until the time for turning is over."""
    ran = fixture_run.run(tmp_path, units=units, faults=("SN0001/remap:after_s=6",), wrap=by_hand({"x-up": "y-down"}))
    first, *others = ran.results.values()
    assert first.outcome is Outcome.ERROR
    assert "its PDO 1 maps other objects than at the start of the run" in first.reasons[-1].sentence
    assert len(ran.life("SN0001")["visits"]) == 2, "it ends where it shows another face, before x-up"
    assert {r.outcome for r in others} <= {Outcome.PASS}
    assert ran.fault is None


@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize(
    ("fault", "reason"),
    [("crc-errors:fraction=1", "frames with a wrong CRC"), ("counter-stuck", "the frame counter is stuck")],
)
def test_frames_that_hold_no_reading_are_the_units_and_nobody_turns_for_them(
    tmp_path: Path, fault: str, reason: str, *, alone: bool
) -> None:
    recipe = fixture_run.recipe(tmp_path, visit_repeats=0)
    ran = fixture_run.run(tmp_path, units=1 if alone else 2, recipe=recipe, faults=(f"SN0001/{fault}",), wrap=by_hand())
    unit, *others = ran.results.values()
    assert unit.outcome is Outcome.FAIL
    assert reason in unit.reasons[0].sentence
    assert ran.fault is None
    assert all(other.outcome is Outcome.PASS for other in others)


@pytest.mark.parametrize("repeats", [0, 1])
def test_a_nest_that_shows_another_side_than_the_others_is_outvoted(tmp_path: Path, repeats: int) -> None:
    recipe = fixture_run.recipe(tmp_path, visit_repeats=repeats)
    ran = fixture_run.run(tmp_path, units=2, recipe=recipe, faults=("SN0001/stuck-axis:value=2",), wrap=by_hand())
    assert (ran.results["SN0001"].outcome, ran.results["SN0002"].outcome) == (Outcome.FAIL, Outcome.PASS)
    assert "Axis z reads exactly" in ran.results["SN0001"].reasons[0].sentence
    assert ran.fault is None


def test_a_silent_unit_makes_nobody_measure_before_the_fixture_is_turned(tmp_path: Path) -> None:
    recipe = fixture_run.recipe(tmp_path, visit_repeats=0)
    turned_late = by_hand(delay_s=8.0)
    ran = fixture_run.run(tmp_path, units=2, recipe=recipe, faults=("SN0001/stream-stops:after_s=3",), wrap=turned_late)
    assert [r.outcome for r in ran.results.values()] == [Outcome.ERROR, Outcome.PASS]
    assert "No readings at" in ran.results["SN0001"].reasons[0].sentence


def test_a_device_that_sends_ten_readings_a_second_is_recognised(tmp_path: Path) -> None:
    slow = {"rate_hz": 10, "lsb": 6.25e-5, "full_scale": 2.0, "noise_density": 0.0001, "counter_bits": 4}
    recipe = fixture_run.recipe(tmp_path, device=slow, dwell={"time_s": 5.0}, verify=None, limits={})
    ran = fixture_run.run(tmp_path, recipe=recipe, wrap=by_hand())
    assert ran.fault is None
    assert ran.results["SN0001"].outcome is Outcome.PASS
