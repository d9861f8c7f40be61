"""A campaign as CAN frames: decoded again they are its readings, moves included, and the marks cut out its dwells."""

from dataclasses import replace

import numpy as np
import pytest

from station.domain.can.decode import decode_samples
from station.domain.can.sensor_layout import EndToEnd, FrameMap, SampleRoles, SensorLayout, TemperatureRole
from station.domain.can.signals import FrameLayout, SignalLayout
from station.domain.capture import annotations
from station.domain.capture.annotations import captured_visits
from station.domain.capture.assemble import sample_table
from station.domain.capture.visit import decode_visit
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError
from station.model.forward import forward
from station.model.frame_recording import FrameRecording, node_of, simulate_frames
from station.model.model_file import Model
from station.model.simulate import SimulationJob, parse_effect
from station.model.simulated_line import SimulatedLine
from tests.unit.tilt_recipe import THREE_RUNS, tilt

STEP = 6.25e-5
QUIET = Model.model_validate({"noise": {"density": 0.0, "flicker": 0.0}})


def layout() -> SensorLayout:
    axes = tuple(SignalLayout(name, 16 + 16 * i, 16, signed=True, scale=STEP) for i, name in enumerate("XYZ"))
    sample = FrameLayout("A", 0x181, 8, (SignalLayout("CRC", 0, 8), SignalLayout("COUNT", 8, 4), *axes))
    slow = FrameLayout("T", 0x281, 2, (SignalLayout("T", 0, 16, signed=True, scale=0.01),))
    roles = FrameMap(
        dbc="a.dbc",
        sample=SampleRoles(message="A", x="X", y="Y", z="Z", counter="COUNT", crc="CRC"),
        temperature=TemperatureRole(message="T", signal="T"),
        e2e=EndToEnd(profile="P01", data_id=0x1A00, data_id_plus_node=True),
    )
    return SensorLayout(roles, sample, slow)


def recorded(recipe: Recipe, *names: str, units: tuple[str, ...] = ("A", "B", "C"), nests: int = 2) -> FrameRecording:
    effects = tuple(parse_effect(name, recipe) for name in names)
    return simulate_frames(SimulationJob(recipe, units, 5, effects, QUIET, SimulatedLine(nests=nests)), layout())


def test_dwells_decode_to_the_calibrated_truth() -> None:
    """Marks cut the dwells out of the log; each reading is matrix · true + offset, within half a step."""
    recipe = tilt(dwell={"time_s": 0.5}, settle={"time_s": 0.2}, runs=THREE_RUNS[:2])
    made = recorded(recipe)
    zero = np.zeros(1)
    for i, (unit, own) in enumerate(made.marks.units().items()):
        node = node_of(i, 2)
        assert {m.node for m in own} == {node}
        table = sample_table(
            unit,
            [decode_visit(v, layout(), node) for v in captured_visits(own, made.frames)],
            layout().counter_values,
        )
        assert len(table) == pytest.approx(2 * 24 * 50, abs=48)
        visits = made.made.scene.visits
        mine = np.flatnonzero(visits.unit.code == i)
        rest = forward(replace(made.made.scene, visit=mine, time_s=zero, since_arrival_s=zero), made.made.base)
        np.testing.assert_allclose(table.reading, rest[table.run * 24 + table.visit], atol=STEP / 2 + 1e-9)


def test_frames_are_whole_and_counted_through_moves() -> None:
    made = recorded(tilt(), units=("A",))
    shown = decode_samples(made.frames, layout(), 1)
    assert shown.crc_ok.all() and shown.frame_errors.clean
    assert shown.counter is not None
    assert set(np.diff(shown.counter.astype(int)) % 15) == {1}
    gaps_s = np.diff(shown.time_ns) / 1e9
    np.testing.assert_allclose(gaps_s, 0.01, atol=1e-5)


def test_moves_are_turns_of_the_true_vector() -> None:
    """On the way the vector keeps its length and passes between the stops; parked, z is up."""
    made = recorded(tilt(), units=("A",))
    base = made.made.base
    true = np.linalg.solve(base.matrix[0], (decode_samples(made.frames, layout(), 1).xyz - base.offset[0]).T).T
    np.testing.assert_allclose(np.linalg.norm(true, axis=1), 1.0, atol=3 * STEP)
    np.testing.assert_allclose(true[0], [0, 0, 1], atol=2 * STEP)
    assert np.linalg.norm(np.diff(true, axis=0), axis=1).max() < 0.05


def test_thermometers_speak_once_a_second() -> None:
    shown = decode_samples(recorded(tilt(dwell={"time_s": 1.0}), units=("A",)).frames, layout(), 1)
    np.testing.assert_allclose(np.diff(shown.temperature_time_ns) / 1e9, 1.0, atol=0.011)
    assert 20 < shown.temperature_degC.mean() < 30


def test_units_of_a_load_share_the_bus_and_loads_follow_each_other() -> None:
    made = recorded(tilt(), units=("A", "B", "C"))
    first, second, third = (made.marks.units()[u] for u in "ABC")
    assert [m.start_s for m in first] == [m.start_s for m in second]
    assert third[0].start_s > first[-1].end_s
    ids = set(made.frames.can_id.tolist())
    assert ids == {0x181, 0x182, 0x281, 0x282}
    assert np.diff(made.frames.time_ns).min() >= 0


@pytest.mark.parametrize(
    ("name", "trouble"), [("lost-frames", "lost"), ("duplicated-frames", "repeats"), ("reordered-frames", "late")]
)
def test_faults_of_the_bus_are_in_the_log(name: str, trouble: str) -> None:
    """One frame in a hundred: within five standard deviations of a Poisson number."""
    made = recorded(tilt(), name, units=("A",))
    shown = decode_samples(made.frames, layout(), 1).frame_errors
    expected = 0.01 * len(made.made.scene)
    assert getattr(shown.counter, trouble) == pytest.approx(expected, abs=5 * np.sqrt(expected))
    assert shown.crc_errors == 0


def test_too_many_nests_for_a_bus_is_a_sentence() -> None:
    with pytest.raises(UsageError, match="not enough for 200 nests"):
        recorded(tilt(), nests=200)


def test_attempts_of_one_unit_stay_apart() -> None:
    """Two attempts make the same runs and visits again: put together they would be a noisier unit."""
    one = annotations.Annotation(unit="A", node=5, run=0, visit=0, position="p", start_s=0, end_s=1, attempt="first")
    other = one.model_copy(update={"attempt": "second", "start_s": 9.0, "end_s": 10.0})
    found = annotations.Annotations.model_validate({"schema": "station.marks/1", "marks": (one, other)}).units()
    assert [[m.attempt for m in own] for own in found.values()] == [["first"], ["second"]]
