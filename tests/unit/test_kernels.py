"""What no cause describes is followed by a kernel that says on what it depends."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.diagnosis.candidates.kernels import kernel_candidates
from station.diagnosis.candidates.rival_laws import rival_laws
from station.diagnosis.data.reduce import mean_and_contrasts, reduce_samples
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.domain.core import rotation
from station.domain.core.types import Floats
from station.model.forward import resting_stimulus
from station.model.model_file import Model
from tests.blind.bench import WHITE, hide
from tests.blind.recipes import recipe

Law = Callable[[ResidualView, np.random.Generator], Floats]


@pytest.fixture(scope="module")
def view() -> ResidualView:
    table, _ = hide(recipe(), None, 5, units=2, floor=WHITE)
    problem: Any = initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))
    found: ResidualView = problem.view
    return found


def _nest_that_creeps(view: ResidualView, rng: np.random.Generator) -> Floats:
    seats, t = view.scene.visits.seat_R, view.scene.time_s
    above = np.einsum("vij,vj->vi", seats, resting_stimulus(view.scene))
    turned = np.cross(rng.standard_normal(3), above)
    return np.asarray(np.einsum("vji,vj->vi", seats, turned) * (t - (t.min() + t.max()) / 2)[:, None])


def _nest_that_warms(view: ResidualView, rng: np.random.Generator) -> Floats:
    seats, T = view.scene.visits.seat_R, view.scene.temperature_degC
    assert T is not None
    turned = np.cross(rng.standard_normal(3), np.einsum("vij,vj->vi", seats, resting_stimulus(view.scene)))
    return np.asarray(np.einsum("vji,vj->vi", seats, turned) * (T - T.mean())[:, None])


def _positions_that_warm(view: ResidualView, rng: np.random.Generator) -> Floats:
    seats, T, at = view.scene.visits.seat_R, view.scene.temperature_degC, view.scene.visits.position.code
    assert T is not None
    moved = rng.standard_normal((at.max() + 1, 3))[at]
    return np.asarray(np.einsum("vji,vj->vi", seats, moved) * (T - (T.min() + T.max()) / 2)[:, None])


def _length_of_the_move(view: ResidualView, rng: np.random.Generator) -> Floats:
    a, previous = resting_stimulus(view.scene), view.scene.visits.previous
    length = np.where(previous >= 0, np.linalg.norm(a[previous] - a, axis=1), 0.0)
    return np.asarray(length[:, None] * rng.standard_normal(3))


def _product_of_the_others(view: ResidualView, rng: np.random.Generator) -> Floats:
    a = resting_stimulus(view.scene)
    return np.asarray(
        np.stack([a[:, 1] * a[:, 2], a[:, 2] * a[:, 0], a[:, 0] * a[:, 1]], axis=1) * rng.standard_normal(3)
    )


def _fast_wave(view: ResidualView, rng: np.random.Generator) -> Floats:
    t, run = view.scene.time_s, view.scene.group("run")[0]
    phase = rng.uniform(0, 2 * np.pi, run.max() + 1)[run]
    return np.asarray(np.sin(2 * np.pi * 3.7 * t / np.ptp(t) + phase)[:, None] * rng.standard_normal(3))


def _nest_frame(view: ResidualView, turned: Floats) -> Floats:
    """What small turns (v, 3) in the nests' frame do to what the devices feel."""
    seats = view.scene.visits.seat_R
    above = np.einsum("vij,vj->vi", seats, resting_stimulus(view.scene))
    return np.asarray(np.einsum("vji,vj->vi", seats, np.cross(turned, above)))


def _by_the_way_of_the_move(view: ResidualView, rng: np.random.Generator) -> Floats:
    R, previous = view.scene.visits.nest_R, view.scene.visits.previous
    apart = np.einsum("vij,vkj->vik", R, R[previous])
    # About x the rig went the way in which y goes to z; half a turn may be either.
    way = np.sign(np.round(apart[:, 2, 1] - apart[:, 1, 2], 9)) * (previous >= 0)
    return np.asarray(way[:, None] * rng.standard_normal(3))


def _what_was_felt_before(view: ResidualView, rng: np.random.Generator) -> Floats:
    a, left = resting_stimulus(view.scene), np.zeros((len(view.scene.visits), 3))
    for i, before in enumerate(view.scene.visits.previous):
        left[i] = 0.8 * left[before] + a[before] if before >= 0 else 0.0
    return np.asarray(left * rng.standard_normal(3))


def _motor_before(view: ResidualView, rng: np.random.Generator) -> Floats:
    motor, previous = view.scene.motor, view.scene.visits.previous
    assert motor is not None
    return np.asarray(np.where(previous >= 0, motor[previous] - motor.mean(), 0.0)[:, None] * rng.standard_normal(3))


def _each_nest_sags(view: ResidualView, rng: np.random.Generator) -> Floats:
    nest, position = view.scene.group("nest")[0], view.scene.visits.position.code
    return _nest_frame(view, rng.standard_normal((2, 24, 3))[nest, position])


def _seated_anew(view: ResidualView, rng: np.random.Generator) -> Floats:
    run, names = view.scene.group("run")
    return _nest_frame(view, rng.standard_normal((len(names), 3))[run])


def _ripple(view: ResidualView, rng: np.random.Generator) -> Floats:
    t, run = view.scene.time_s, view.scene.group("run")[0]
    phase = rng.uniform(0, 2 * np.pi, run.max() + 1)[run]
    return np.asarray(np.sin(2 * np.pi * 7.7 * t / np.ptp(t) + phase)[:, None] * rng.standard_normal(3))


def _day_and_night(view: ResidualView, rng: np.random.Generator) -> Floats:
    started = view.scene.started_s
    assert started is not None
    clock = started + view.scene.time_s
    return np.asarray(np.sin(2 * np.pi * 1.4 * clock / np.ptp(clock) + 1.0)[:, None] * rng.standard_normal(3))


def _stairs_of_a_compensation(view: ResidualView, rng: np.random.Generator) -> Floats:
    T = view.scene.temperature_degC
    assert T is not None
    return np.asarray((3.3 * (T - T.min()) / np.ptp(T) % 1.0)[:, None] * rng.standard_normal(3))


def _steps(view: ResidualView) -> Floats:
    a, previous = resting_stimulus(view.scene), view.scene.visits.previous
    return np.asarray(np.where(previous[:, None] >= 0, a[previous] - a, 0.0))


def _came_from_above(view: ResidualView, rng: np.random.Generator) -> Floats:
    step = _steps(view)[:, 2]
    return np.asarray(((step > 1e-9) * 1.0 - (step < -1e-9))[:, None] * rng.standard_normal(3))


def _angles(view: ResidualView) -> Floats:
    R, previous = view.scene.visits.nest_R, view.scene.visits.previous
    cosine = (np.einsum("vij,vij->v", R, R[previous]) - 1) / 2
    return np.asarray(np.where(previous >= 0, np.arccos(np.clip(cosine, -1, 1)), 0.0))


def _square_of_the_angle(view: ResidualView, rng: np.random.Generator) -> Floats:
    return np.asarray(_angles(view)[:, None] ** 2 * rng.standard_normal(3))


def _one_nest_drags(view: ResidualView, rng: np.random.Generator) -> Floats:
    return np.asarray(_angles(view)[:, None] * rng.standard_normal((2, 3))[view.scene.group("nest")[0]])


def _every_third_pallet(view: ResidualView, rng: np.random.Generator) -> Floats:
    return np.asarray((view.scene.visits.visit % 3 == 1)[:, None] * rng.standard_normal(3))


def _turned_by_a_torque(view: ResidualView, rng: np.random.Generator) -> Floats:
    a = resting_stimulus(view.scene)
    return np.asarray(np.cross(a + _steps(view), a) * rng.standard_normal(3))


def _gain_by_the_others(view: ResidualView, rng: np.random.Generator) -> Floats:
    a = resting_stimulus(view.scene)
    return np.asarray(a * np.roll(a, 2, axis=1) ** 2 * rng.standard_normal(3))


def _product_of_two_squares(view: ResidualView, rng: np.random.Generator) -> Floats:
    a = resting_stimulus(view.scene) ** 2
    return np.asarray(a * np.roll(a, 1, axis=1) * rng.standard_normal(3))


def _switch_of_the_temperature(view: ResidualView, rng: np.random.Generator) -> Floats:
    T = view.scene.temperature_degC
    assert T is not None
    return np.asarray((np.quantile(T, 0.62) < T)[:, None] * rng.standard_normal(3))


def _air_that_rises(view: ResidualView, rng: np.random.Generator) -> Floats:
    since, a = view.scene.since_power_s, resting_stimulus(view.scene)
    assert since is not None
    return np.asarray((np.exp(-since / 60.0) * a[:, 2])[:, None] * rng.standard_normal(3))


def _cable_that_bends(view: ResidualView, rng: np.random.Generator) -> Floats:
    R, previous = view.scene.visits.nest_R, view.scene.visits.previous
    wound = np.zeros(len(R))
    for i, before in enumerate(previous):
        if before >= 0:
            wound[i] = wound[before] + rotation.to_vector(R[i] @ R[before].T)[0]
    return np.asarray(np.sin(0.4 * wound)[:, None] * rng.standard_normal(3))


def _crosstalk_by_its_own_size(view: ResidualView, rng: np.random.Generator) -> Floats:
    a = resting_stimulus(view.scene)
    return np.asarray(np.roll(a, 1, axis=1) * a**2 * rng.standard_normal(3))


def _at_one_end(view: ResidualView, rng: np.random.Generator) -> Floats:
    return np.asarray((resting_stimulus(view.scene)[:, [1]] < -0.9) * rng.standard_normal(3))


def _position_before_the_last(view: ResidualView, rng: np.random.Generator) -> Floats:
    position, previous = view.scene.visits.position.code, view.scene.visits.previous
    left = rng.standard_normal((position.max() + 1, 3))[position[previous[previous]]]
    return np.asarray(np.where((previous >= 0) & (previous[previous] >= 0), left.T, 0.0).T)


def _heat_of_a_hand(view: ResidualView, rng: np.random.Generator) -> Floats:
    t, (run, names) = view.scene.time_s, view.scene.group("run")
    return np.asarray(np.exp(-t / (0.15 * np.ptp(t)))[:, None] * rng.standard_normal((len(names), 3))[run])


def _comes_to_rest_by_where_it_came_from(view: ResidualView, rng: np.random.Generator) -> Floats:
    position, previous = view.scene.visits.position.code, view.scene.visits.previous
    turned = rng.standard_normal((position.max() + 1, 3))[position[previous]] * (previous >= 0)[:, None]
    return _nest_frame(view, turned)


def _flank_of_each_position(view: ResidualView, rng: np.random.Generator) -> Floats:
    R, previous, position = view.scene.visits.nest_R, view.scene.visits.previous, view.scene.visits.position.code
    apart = np.einsum("vij,vkj->vik", R, R[previous])
    way = np.sign(np.round(apart[:, 2, 1] - apart[:, 1, 2], 9)) * (previous >= 0)
    return _nest_frame(view, way[:, None] * rng.standard_normal((position.max() + 1, 3))[position])


def _part_that_beds_itself(view: ResidualView, rng: np.random.Generator) -> Floats:
    t, (run, names) = view.scene.time_s, view.scene.group("run")
    return _nest_frame(view, np.exp(-t / (0.15 * np.ptp(t)))[:, None] * rng.standard_normal((len(names), 3))[run])


@pytest.mark.parametrize(
    ("law", "words", "numbers", "left"),
    [
        (_comes_to_rest_by_where_it_came_from, "order", 75, 1e-3),
        # Half a turn may be either way.
        (_flank_of_each_position, "order*position", 72, 0.3),
        (_part_that_beds_itself, "time*input", 18, 0.05),
        (_nest_that_creeps, "time*input", 6, 1e-3),
        (_positions_that_warm, "temperature*position", 72, 1e-3),
        (_length_of_the_move, "order", 6, 1e-9),
        (_product_of_the_others, "input", 6, 1e-9),
        # Half a step between two waves loses less than a half.
        (_fast_wave, "time", 36, 0.5),
        (_ripple, "time/ripple", 36, 0.5),
        (_day_and_night, "time", 18, 0.05),
        (_stairs_of_a_compensation, "temperature/ripple", 6, 0.5),
        (_by_the_way_of_the_move, "order", 9, 0.3),
        (_what_was_felt_before, "order", 6, 1e-9),
        (_motor_before, "motor", 6, 1e-9),
        (_each_nest_sags, "position", 144, 1e-3),
        (_seated_anew, "unit", 18, 1e-3),
        (_came_from_above, "order", 9, 1e-9),
        (_square_of_the_angle, "order", 3, 1e-6),
        (_one_nest_drags, "order", 6, 1e-6),
        (_every_third_pallet, "order", 6, 1e-9),
        (_turned_by_a_torque, "order*input", 3, 1e-9),
        (_gain_by_the_others, "input", 6, 1e-9),
        (_product_of_two_squares, "input", 9, 1e-9),
        (_switch_of_the_temperature, "temperature/place", 3, 0.2),
        (_air_that_rises, "time*input", 9, 0.05),
        (_crosstalk_by_its_own_size, "input", 6, 1e-9),
        (_at_one_end, "input", 3, 1e-9),
        (_position_before_the_last, "order", 75, 1e-9),
        (_heat_of_a_hand, "time", 18, 0.05),
        (_cable_that_bends, "order", 9, 0.25),
    ],
)
def test_a_law_is_followed_in_few_numbers_under_its_own_words(
    law: Law, words: str, numbers: int, left: float, view: ResidualView, rng: np.random.Generator
) -> None:
    readings = law(view, rng)
    shares = [
        _left(readings, columns, view)
        for columns in (_columns(c) for c in kernel_candidates(view) if c.name == words)
        if columns.shape[2] <= numbers
    ]
    assert min(shares) < left


@pytest.mark.parametrize("by", ["temperature_degC", "motor"])
def test_what_fades_in_the_dwells_and_follows_a_course_is_one_number_an_axis(
    by: str, view: ResidualView, rng: np.random.Generator
) -> None:
    count, course = view.reduced.count, getattr(view.scene, by)
    middle = (np.cumsum(count, axis=1) - count / 2) / count.sum(1, keepdims=True)
    size = (course - (course.min() + course.max()) / 2 if by == "temperature_degC" else course)[:, None]
    felt = _steps(view) if by == "temperature_degC" else np.ones((len(size), 3))
    rows = np.exp(-middle / 0.3)[:, :, None] * (size * felt * rng.standard_normal(3))[:, None]
    readings = mean_and_contrasts(rows, count)[1].reshape(len(size), -1)
    kernels = [c for c in kernel_candidates(view) if c.name == "dwell-phase/fading" and c.of == "common"]
    shares = []
    for dwell in (c.dwell for c in kernels if c.dwell is not None and c.visit.shape[2] == 3):
        columns = dwell.reshape(readings.size, 3)
        rest = readings.ravel() - columns @ np.linalg.lstsq(columns, readings.ravel(), rcond=None)[0]
        shares.append(float(rest @ rest) / float(np.sum(readings**2)))
    assert min(shares) < 0.1


def test_heat_that_rises_through_the_part_is_followed(view: ResidualView, rng: np.random.Generator) -> None:
    phase = 4 * np.pi * view.scene.time_s / np.ptp(view.scene.time_s)
    room = replace(view.scene, temperature_degC=20 + np.sin(phase), temperature_rate=np.cos(phase))
    swaying = replace(view, reduced=replace(view.reduced, scene=room))
    flow = np.sign(np.cos(phase)) * resting_stimulus(room)[:, 2]
    readings = flow[:, None] * rng.standard_normal(3)
    found = [_columns(c) for c in kernel_candidates(swaying) if c.name == "temperature*input" and c.of == "common"]
    assert min(_left(readings, columns, swaying) for columns in found if columns.shape[2] <= 9) < 1e-9


def _square_of_the_rate(view: ResidualView, rng: np.random.Generator) -> Floats:
    rate = view.scene.temperature_rate
    assert rate is not None
    return np.asarray(rate[:, None] ** 2 * rng.standard_normal(3))


def _sizes_of_the_others(view: ResidualView, rng: np.random.Generator) -> Floats:
    a = np.abs(resting_stimulus(view.scene))
    return np.asarray((np.roll(a, 1, axis=1) - 0.4 * np.roll(a, 2, axis=1)) * rng.standard_normal(3))


def _gain_by_the_side_of_another(view: ResidualView, rng: np.random.Generator) -> Floats:
    a = resting_stimulus(view.scene)
    return np.asarray(a * np.sign(np.round(np.roll(a, 1, axis=1), 6)) * rng.standard_normal(3))


def _root_of_the_step(view: ResidualView, rng: np.random.Generator) -> Floats:
    a, previous = resting_stimulus(view.scene), view.scene.visits.previous
    step = np.where(previous[:, None] >= 0, a[previous] - a, 0.0)
    step[np.abs(step) < 1e-9] = 0.0
    return np.asarray(np.sign(step) * np.sqrt(np.abs(step)) * rng.standard_normal(3))


def _angle_of_a_head(view: ResidualView, rng: np.random.Generator) -> Floats:
    x, y, _ = resting_stimulus(view.scene).T
    return np.asarray((np.hypot(x, y) * np.cos(3 * np.arctan2(y, x)))[:, None] * rng.standard_normal(3))


def _gain_at_one_temperature(view: ResidualView, rng: np.random.Generator) -> Floats:
    T = view.scene.temperature_degC
    assert T is not None
    bump = np.exp(-0.5 * ((T - np.quantile(T, 0.45)) / (0.15 * np.ptp(T))) ** 2)
    return np.asarray(bump[:, None] * resting_stimulus(view.scene) * rng.standard_normal(3))


def _nest_that_sticks_and_slips(view: ResidualView, rng: np.random.Generator) -> Floats:
    gone, previous = np.zeros(len(view.scene.visits)), view.scene.visits.previous
    for i, angle in enumerate(_angles(view)):
        gone[i] = (gone[previous[i]] if previous[i] >= 0 else 0.0) + angle
    return _nest_frame(view, (gone % 4.2)[:, None] * rng.standard_normal(3))


def _coefficient_while_it_warms_fast(view: ResidualView, rng: np.random.Generator) -> Floats:
    T, rate = view.scene.temperature_degC, view.scene.temperature_rate
    assert T is not None
    assert rate is not None
    return np.asarray(((T - T.mean()) * (rate > np.median(rate)))[:, None] * rng.standard_normal(3))


@pytest.mark.parametrize(
    ("law", "words", "numbers", "left"),
    [
        (_coefficient_while_it_warms_fast, "temperature", 3, 1e-3),
        (_nest_that_sticks_and_slips, "order*input", 3, 1e-3),
        (_nest_that_warms, "temperature*input", 3, 1e-3),
        (_square_of_the_rate, "temperature", 3, 1e-3),
        (_root_of_the_step, "order", 3, 1e-3),
        (_sizes_of_the_others, "input", 6, 1e-3),
        (_angle_of_a_head, "input", 6, 1e-9),
        (_gain_by_the_side_of_another, "input", 6, 1e-9),
        # Between two places, phases or periods that are tried less is lost than any cause loses.
        (_stairs_of_a_compensation, "temperature", 3, 0.4),
        (_gain_at_one_temperature, "temperature*input", 3, 0.1),
    ],
)
def test_a_law_that_a_cause_resembles_is_tried_in_its_place(
    law: Law, words: str, numbers: int, left: float, view: ResidualView, rng: np.random.Generator
) -> None:
    readings = law(view, rng)
    named = (c for c in rival_laws(view) if c.name.startswith(f"law:{words}/"))
    assert min(_left(readings, _columns(c), view) for c in named if c.visit.shape[2] <= numbers) < left


def _columns(candidate: Any) -> Floats:
    """All columns (v, 3, numbers) of a candidate, its groups each with their own."""
    visit, code = candidate.visit, candidate.code
    return np.asarray(np.concatenate([visit * (code == g)[:, None, None] for g in range(code.max() + 1)], axis=2))


def _left(readings: Floats, columns: Floats, view: ResidualView) -> float:
    """The share of the squares that columns leave beside each unit's offsets and gains."""
    unit, a = view.scene.visits.unit.code, resting_stimulus(view.scene)
    base = [np.eye(3) * x[:, None, :] for u in range(unit.max() + 1) for x in ((unit == u)[:, None] * a,)]
    base += [np.eye(3) * ((unit == u)[:, None, None]) for u in range(unit.max() + 1)]
    known = np.concatenate(base, axis=2).reshape(readings.size, -1)
    rest, free = (
        x - known @ np.linalg.lstsq(known, x, rcond=None)[0]
        for x in (readings.ravel(), columns.reshape(readings.size, -1))
    )
    found = rest - free @ np.linalg.lstsq(free, rest, rcond=1e-9)[0]
    return float(found @ found / (rest @ rest))
