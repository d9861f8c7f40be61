"""The live rig: at every stop what a simulated campaign gives, and in between what a turning part feels."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.domain.core import rotation
from station.domain.core.types import Frames
from station.domain.recipe import plan
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError
from station.model.effect import Effect
from station.model.model_file import Model
from station.model.rig import Rig
from station.model.simulate import SimulationJob, parse_effect, simulate
from station.model.simulated_line import SimulatedLine
from station.model.timeline import RunTimeline, run_timeline
from tests.unit.tilt_recipe import THREE_RUNS, tilt

QUIET = Model.model_validate({"noise": {"density": 0.0, "flicker": 0.0}})
MOVE_S, STAY_S = 1.5, 1.0


class Plate:
    """A positioner in numbers: turns evenly from where it is to the next stop."""

    def __init__(self) -> None:
        self.origin, self.turn, self.departs_s = np.eye(3), np.zeros(3), 0.0

    def go(self, goal: Any, now_s: float) -> None:
        self.origin = self(np.array([now_s]))[0]
        self.turn = rotation.to_vector(goal @ self.origin.T)
        self.departs_s = now_s

    def __call__(self, time_s: Any) -> Any:
        share = np.clip((time_s - self.departs_s) / MOVE_S, 0.0, 1.0)
        return rotation.from_vector(share[:, None] * self.turn) @ self.origin


def rig_of(recipe: Recipe, *effects: str | Effect, seed: int = 2) -> tuple[Rig, Plate]:
    plate = Plate()
    requested = tuple(parse_effect(e, recipe) if isinstance(e, str) else e for e in effects)
    return Rig(SimulationJob(recipe, (), seed, requested, QUIET), plate), plate


def tumble(rig: Rig, plate: Plate, recipe: Recipe, nests: list[str], run: int = 0, now_s: float = 0.0) -> Any:
    """Readings (nest, stop, sample, 3) of one run, 20 samples at each stop."""
    out = []
    for stop in plan.planned_visits(recipe, run):
        rig.go(stop, now_s, now_s + MOVE_S)
        plate.go(stop.nest, now_s)
        now_s += MOVE_S
        out.append([rig.sense(nest, now_s + 0.01 * np.arange(20, dtype=float)) for nest in nests])
        now_s += STAY_S
    return np.swapaxes(np.array(out), 0, 1)


STILL = ("quadratic", "cross-axis", "nest-tilt", "package-rotation", "base-tilt", "index-error", "repeatability",
         "disturbed-visit", "hysteresis", "bias-walk", "local-gravity", "group-offset", "settling", "filter-lag",
         "lever-arm", "axis-permutation", "wrong-scale", "clipping", "quantization")  # fmt: skip


@pytest.mark.parametrize("name", STILL)
def test_a_stop_reads_as_in_a_simulated_campaign(name: str) -> None:
    """Equal seed, serial, nest and causes: equal readings, to rounding; A sits in N1 as in the campaign's first run."""
    recipe = tilt(device={"rate_hz": 100, "clock_tolerance_ppm": 0})
    rig, plate = rig_of(recipe, name)
    rig.load({"N1": "A"}, 0.0)
    live = tumble(rig, plate, recipe, ["N1"])[0].reshape(-1, 3)
    campaign = simulate(SimulationJob(recipe, ("A",), 2, (parse_effect(name, recipe),), QUIET)).table.reading
    np.testing.assert_allclose(live, campaign, atol=1e-9)


def test_a_run_is_laid_out_once_however_often_its_sensors_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """At each look it was three fifths of the processor's time of a run by hand."""
    laid_out = []

    def counted(recipe: Recipe, run: int, line: SimulatedLine) -> RunTimeline:
        laid_out.append(run)
        return run_timeline(recipe, run, line)

    monkeypatch.setattr("station.model.rig.run_timeline", counted)
    rig, plate = rig_of(tilt(runs=THREE_RUNS))
    rig.load({"N1": "A"}, 0.0)
    for run in range(2):
        tumble(rig, plate, tilt(runs=THREE_RUNS), ["N1"], run, 1000.0 * run)
        rig.temperature_degC("N1", np.array([1000.0 * run + 990.0]))
    assert laid_out == [0, 1]


def test_on_the_way_the_part_feels_where_it_is() -> None:
    """From z-up a turn of 90° about y: half way, x and z both read cos 45°."""
    recipe = tilt(positions=[{"name": "z-up", "up": "+z"}, {"name": "x-up", "up": "+x"}])
    rig, plate = rig_of(recipe)
    rig.load({"N1": "A"}, 0.0)
    parked = rig.sense("N1", np.array([0.0, 0.1]))
    first, second = plan.planned_visits(recipe, 0)
    for stop, now_s in ((first, 1.0), (second, 4.0)):
        rig.go(stop, now_s, now_s + MOVE_S)
        plate.go(stop.nest, now_s)
        readings = rig.sense("N1", now_s + MOVE_S * np.array([0.5, 1.0]))
    base = SimulationJob(recipe, (), 2).base(("A",))
    true = np.linalg.solve(base.matrix[0], (readings - base.offset[0]).T).T
    np.testing.assert_allclose(true, [[np.sqrt(0.5), 0, np.sqrt(0.5)], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(np.linalg.solve(base.matrix[0], parked[1] - base.offset[0]), [0, 0, 1], atol=1e-12)


def test_an_arrival_error_of_the_positioner_is_felt() -> None:
    recipe = tilt()
    rig, plate = rig_of(recipe)
    rig.load({"N1": "A"}, 0.0)
    stop = plan.planned_visits(recipe, 0)[0]
    rig.go(stop, 0.0, MOVE_S)
    plate.go(rotation.from_vector(np.array([0.01, 0, 0])) @ stop.nest, 0.0)
    base = SimulationJob(recipe, (), 2).base(("A",))
    true = np.linalg.solve(base.matrix[0], rig.sense("N1", np.array([2.0]))[0] - base.offset[0])
    np.testing.assert_allclose(true, [0, np.sin(0.01), np.cos(0.01)], atol=1e-12)


def test_every_nest_has_its_own_unit_and_tilt() -> None:
    recipe = tilt()
    rig, plate = rig_of(recipe, "nest-tilt")
    rig.load({"left": "A", "right": "B"}, 0.0)
    left, right = tumble(rig, plate, recipe, ["left", "right"])
    assert np.abs(left - right).max() > 5e-3
    rig.load({"left": "B", "right": "A"}, 200.0)
    swapped = tumble(rig, plate, recipe, ["left", "right"], now_s=200.0)
    # The unit's own errors move with it, the tilt stays with the nest.
    moved = swapped[1].mean(axis=(0, 1)) - left.mean(axis=(0, 1))
    assert np.abs(moved).max() < 2e-3


def test_repeated_and_added_stops_keep_their_own_chance() -> None:
    """Verification stops come after the plan: they have angles of their own, and the planned ones stay the same."""
    recipe = tilt()
    extra = replace(plan.planned_visits(recipe, 0)[3], visit=30)
    results = []
    for more in (False, True):
        rig, plate = rig_of(recipe, "repeatability")
        rig.load({"N1": "A"}, 0.0)
        results.append(tumble(rig, plate, recipe, ["N1"]))
        if more:
            rig.go(extra, 100.0, 101.5)
            plate.go(extra.nest, 100.0)
            again = rig.sense("N1", np.array([102.0, 103.0]))
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(again[0], again[1])
    assert 1e-6 < np.abs(again[0] - results[0][0, 3, 0]).max() < 1e-3


def test_power_stays_on_from_run_to_run() -> None:
    recipe = tilt(runs=THREE_RUNS)
    rig, plate = rig_of(recipe, "warm-up")
    rig.load({"N1": "A"}, 0.0)
    first = tumble(rig, plate, recipe, ["N1"], 0)
    warm = tumble(rig, plate, recipe, ["N1"], 2, now_s=700.0)
    # After ten minutes nothing of e^(−t/40 s) is left: the offset that is gone shows at the first stop.
    effect = parse_effect("warm-up", recipe)
    amplitude = effect.coefficients(("unit:A",), 2)[0]
    base = SimulationJob(recipe, (), 2).base(("A",))
    plain = base.matrix[0] @ plan.planned_visits(recipe, 0)[0].true + base.offset[0]
    np.testing.assert_allclose(first[0, 0, 0] - plain, amplitude * np.exp(-MOVE_S / 40), atol=1e-9)
    stop = plan.planned_visits(recipe, 2)[0]
    np.testing.assert_allclose(warm[0, 0, 0], base.matrix[0] @ stop.true + base.offset[0], atol=1e-6)


@pytest.mark.parametrize(("run", "fresh"), [(1, True), (0, False)])
def test_another_seating_is_another_clamping(run: int, fresh: bool) -> None:
    """Turned before ten minutes of warming up, the creep of log(1 + t/t₀) starts again; left as it is, it goes on."""
    recipe = tilt(runs=[THREE_RUNS[0], {**THREE_RUNS[0], **({"seating": "turned", "prewarm_s": 600} if run else {})}])
    rig, plate = rig_of(recipe, "clamp-creep")
    rig.load({"N1": "A"}, 0.0)
    tumble(rig, plate, recipe, ["N1"], 0)
    later = tumble(rig, plate, recipe, ["N1"], 1, now_s=5000.0)[0, 0, 0]
    effect: Any = parse_effect("clamp-creep", recipe)
    base, stop = SimulationJob(recipe, (), 2).base(("A",)), plan.planned_visits(recipe, 1)[0]
    crept = (later - base.matrix[0] @ stop.true - base.offset[0]) / effect.coefficients(("unit:A",), 2)[0]
    since = MOVE_S + (600.0 if fresh else 5000.0)
    np.testing.assert_allclose(crept, np.log1p(since / effect.time_constant_s), rtol=1e-6)


def test_temperature_follows_room_and_self_heating() -> None:
    recipe = tilt()
    rig, _ = rig_of(recipe)
    rig.load({"N1": "A"}, 0.0)
    shown = rig.temperature_degC("N1", np.linspace(0, 3000, 400))
    assert 20 < shown[0] < 26 and 1.0 < shown[-50:].mean() - shown[:50].mean() < 4.0


def test_bus_faults_act_on_frames() -> None:
    n = 4000
    frames = Frames(
        np.arange(n) * 10_000_000,
        np.full(n, 0x181, np.uint32),
        np.full(n, 8, np.uint8),
        np.arange(n, dtype="<u8").view(np.uint8).reshape(n, 8),
    )

    def delivered(name: str) -> Frames:
        rig, _ = rig_of(tilt(), replace(parse_effect(name, tilt()), size=0.05))
        rig.load({"N1": "A"}, 0.0)
        return rig.deliver("N1", frames)

    four_sigma = 4 * np.sqrt(0.05 * 0.95 * n)
    lost, repeated, swapped = (delivered(f"{k}-frames") for k in ("lost", "duplicated", "reordered"))
    assert n - len(lost) == pytest.approx(0.05 * n, abs=four_sigma)
    assert len(repeated) - n == pytest.approx(0.05 * n, abs=four_sigma)
    number = swapped.data.view("<u8")[:, 0]
    np.testing.assert_array_equal(swapped.time_ns, frames.time_ns)
    np.testing.assert_array_equal(np.sort(number), np.arange(n))
    assert (np.diff(number.astype(int)) < 0).sum() == pytest.approx(0.05 * n, abs=four_sigma + 0.05**2 * n)


def test_clock_error_is_told_to_the_device() -> None:
    rig, _ = rig_of(tilt(), "clock-error")
    rig.load({"N1": "A", "N2": "B"}, 0.0)
    assert [abs(rig.rate_error(nest)) for nest in ("N1", "N2")] == pytest.approx([0.01, 0.01])
    rig, _ = rig_of(tilt())
    rig.load({"N1": "A"}, 0.0)
    assert rig.rate_error("N1") == 0.0


def test_an_empty_nest_is_a_sentence() -> None:
    rig, _ = rig_of(tilt())
    rig.load({"N1": "A"}, 0.0)
    with pytest.raises(UsageError, match="Nest 'N9' of the simulated rig holds no unit; loaded nests: N1"):
        rig.sense("N9", np.zeros(1))
