"""The preflight: what it understands, what it leaves out, what it refuses; in tables made without the station."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.diagnosis.data import family, preflight
from station.diagnosis.data.reduce import reduce_samples
from station.domain.capture.sample_rate import rate_of
from station.domain.core.types import Floats, Labels, SampleTable
from station.domain.recipe.recipe import Recipe
from station.domain.recognition.distinct_values import distinct
from station.errors import SamplesError
from tests.fakes import tumble

SPHERE = np.array([[np.cos(a) * np.sqrt(1 - z**2), np.sin(a) * np.sqrt(1 - z**2), z] for a, z in zip(
    np.arange(24) * 2.399963, np.linspace(-0.96, 0.96, 24), strict=True)])  # fmt: skip


def by_hand(**device: float) -> Recipe:
    more: dict[str, Any] = {"device": device} if device else {}
    reference = {"source": "gravity", "magnitude": 1.0, "pose": "unknown"}
    return tumble.recipe("norm", reference=reference, positions=[], **more)


def silent(recipe: Recipe) -> Recipe:
    """The recipe without a data sheet."""
    return Recipe.model_validate({k: v for k, v in recipe.model_dump(by_alias=True).items() if k != "device"})


def table(reading: Floats, visits: int, rate_hz: float = 100.0, unit: str = "A") -> SampleTable:
    """Visits of equal length from readings (n, 3) in a row."""
    n = len(reading)
    visit = np.repeat(np.arange(visits, dtype=np.int32), n // visits)
    return SampleTable(
        unit=Labels((unit,), np.zeros(n, np.int32)),
        run=np.zeros(n, np.int32),
        visit=visit,
        position=Labels(tuple(f"p{i}" for i in range(visits)), visit),
        time_s=np.arange(n) / rate_hz + visit,
        reading=reading,
    )


def still(rng: np.random.Generator, noise: float = 0.001, samples: int = 100) -> Floats:
    y = np.repeat(SPHERE, samples, axis=0) * [1.01, 0.99, 1.02] + [0.02, -0.01, 0.03]
    return np.asarray(y + noise * rng.standard_normal(y.shape))


def test_noise_step_rate_and_poses_are_inferred(rng: np.random.Generator) -> None:
    y = np.round(still(rng, 0.002) / 0.00025) * 0.00025
    found, stored = preflight.inspect(silent(by_hand()), table(y, 24, rate_hz=51.2))
    # 2,400 differences know the noise to 2 %; five of those deviations.
    assert found.sheet.noise == pytest.approx([0.002] * 3, rel=0.1)
    assert found.sheet.lsb == pytest.approx([0.00025] * 3, rel=1e-6)
    assert found.sheet.rate_hz == pytest.approx(51.2)
    assert (found.visits, found.poses, len(stored), found.left_out) == (24, 24, 2400, ())
    assert set(found.inferred) == {"rate_hz", "lsb", "noise_density"}
    recipe = preflight.with_sheet(silent(by_hand()), found)
    assert recipe.device.rate_hz == pytest.approx(51.2)
    assert recipe.device.lsb == pytest.approx(0.00025)
    assert not {"rate_hz", "lsb"} & recipe.device.model_fields_set


@pytest.mark.parametrize(("samples", "told"), [(1, 0), (100, 1)])
def test_one_coarse_stamp_of_two_single_readings_is_no_restart(
    rng: np.random.Generator, samples: int, told: int
) -> None:
    whole = table(still(rng, samples=samples), 24)
    time_s = whole.time_s.copy()
    time_s[whole.visit == 7] -= time_s[whole.visit == 7][0] - time_s[whole.visit == 6][0]
    found, _ = preflight.inspect(silent(by_hand()), replace(whole, time_s=time_s))
    assert [note.id for note in found.remarks].count("clock-restarts") == told


def test_a_stated_sheet_is_left_alone(rng: np.random.Generator) -> None:
    recipe = by_hand(rate_hz=100.0, lsb=1e-5, noise_density=1e-4)
    found, _ = preflight.inspect(recipe, table(still(rng), 24))
    assert found.inferred == ()
    assert preflight.with_sheet(recipe, found) == recipe


def test_a_step_of_zero_states_none(rng: np.random.Generator) -> None:
    recipe = by_hand(rate_hz=100.0, lsb=0.0, noise_density=1e-4)
    found, _ = preflight.inspect(recipe, table(np.round(still(rng) / 0.004) * 0.004, 24))
    assert found.inferred == ("lsb",)
    assert preflight.with_sheet(recipe, found).device.lsb == pytest.approx(0.004)


def test_moving_and_merged_visits_are_left_out_and_no_others(rng: np.random.Generator) -> None:
    y = still(rng)
    y[300:400] += np.linspace(0, 0.3, 100)[:, None]
    y[760:800] = SPHERE[9] + 0.001 * rng.standard_normal((40, 3))
    found, stored = preflight.inspect(by_hand(), table(y, 24))
    assert [(one.visit, one.reason.id) for one in found.left_out] == [(3, "visit-moves"), (7, "visit-of-two-poses")]
    assert set(range(24)) - set(stored.visit.tolist()) == {3, 7}
    assert found.document()["left_out"][0]["of"] == "visit:A/0/3"


def test_settling_of_every_visit_is_no_motion(rng: np.random.Generator) -> None:
    y = still(rng) + 0.05 * np.tile(np.exp(-np.arange(100) / 15.0), 24)[:, None]
    found, _ = preflight.inspect(by_hand(), table(y, 24))
    assert found.left_out == ()


def test_another_rate_is_said_exactly_and_lost_frames_are_no_rate(rng: np.random.Generator) -> None:
    recipe = by_hand(rate_hz=100.0)
    found, _ = preflight.inspect(recipe, table(still(rng), 24, rate_hz=21.7))
    (remark,) = found.remarks
    assert (remark.id, remark.parameters["sheet_hz"]) == ("rate-differs", 100.0)
    assert remark.parameters["rate_hz"] == pytest.approx(21.7)
    whole = table(still(rng), 24)
    some, _ = preflight.inspect(recipe, whole[rng.uniform(size=len(whole)) > 0.15])
    assert some.remarks == ()


def test_rows_that_are_missing_change_no_inferred_rate(rng: np.random.Generator) -> None:
    """They were a clock-error of 5,058 ppm, p = 1: the rate by counts beside stamps that step by whole periods."""
    time_s = np.sort(rng.choice(3000, 2760, replace=False)) / 100
    rate_hz, jitter_s = rate_of(time_s, np.ones(len(time_s) - 1, bool))
    assert rate_hz == pytest.approx(100)
    assert jitter_s == pytest.approx(0, abs=1e-9)
    shared = np.floor(np.arange(3000) / 4) / 25
    assert rate_of(shared, np.ones(2999, bool))[0] == pytest.approx(100, rel=0.01)


@pytest.mark.parametrize("burst", [2, 5, 8, 16])
@pytest.mark.parametrize("apart_s", [0.0, 5e-5])
@pytest.mark.parametrize("ends", [99, 200])
def test_readings_that_come_in_bursts_change_no_inferred_rate(burst: int, apart_s: float, ends: int) -> None:
    """Visits of 100 readings in bursts of 8 were 107 Hz; with a stamp each the rate was that within a burst. A last
    burst that a visit of 40 readings cuts off made 47.4 Hz of 50, and a clock-error of what was inferred from it."""
    place = np.arange(100)
    last = np.minimum((place // burst + 1) * burst - 1, ends)
    visit = last / 100 + apart_s * (place % burst)
    time_s = np.concatenate([visit + 2.5 * v for v in range(30)])
    within = np.diff(np.repeat(np.arange(30), 100)) == 0
    assert rate_of(time_s, within)[0] == pytest.approx(100, rel=0.02)


def test_late_stamps_change_no_inferred_rate(rng: np.random.Generator) -> None:
    """It was 97 Hz: steps ahead counted, those back did not."""
    late = rng.exponential(0.004, 6000) * (rng.random(6000) < 0.3)
    time_s = np.repeat(np.arange(60) * 2.5, 100) + np.tile(np.arange(100) / 100, 60) + late
    within = np.diff(np.repeat(np.arange(60), 100)) == 0
    assert rate_of(time_s, within)[0] == pytest.approx(100, rel=0.005)


def test_a_rate_that_sensors_are_set_to_is_the_sheets_error_and_any_other_the_clocks(rng: np.random.Generator) -> None:
    recipe = by_hand(rate_hz=100.0)
    found, _ = preflight.inspect(recipe, table(still(rng), 24, rate_hz=102.4))
    assert [m.id for m in found.remarks] == ["rate-differs"]
    assert preflight.with_sheet(recipe, found).device.rate_hz == pytest.approx(102.4)
    # An oscillator is off by anything; one that is off by less than a hundredth is no other setting.
    for rate_hz in (102.9, 97.3, 100.4):
        assert preflight.inspect(recipe, table(still(rng), 24, rate_hz=rate_hz))[0].remarks == ()


def test_a_logger_that_polls_at_any_rate_has_another_sheet_where_its_steps_differ(rng: np.random.Generator) -> None:
    """12.43 readings a second, unevenly: no rate that sensors are set to. A step as stated leaves the sheet its own."""
    sheet = by_hand(rate_hz=100.0, lsb=6.25e-5)
    for step, remark in ((1e-3, "sheet-of-another-device"), (6.25e-5, "rate-differs")):
        made = table(np.round(still(rng, 0.003) / step) * step, 24, rate_hz=12.43)
        late = np.abs(rng.normal(0, 0.009, len(made.time_s)))
        found, _ = preflight.inspect(sheet, replace(made, time_s=made.time_s + late))
        assert [m.id for m in found.remarks] == [remark]


def test_another_rate_with_another_step_is_the_sheet_of_another_device(rng: np.random.Generator) -> None:
    recipe = by_hand(rate_hz=100.0, lsb=6.25e-5, noise_density=1e-4)
    coarse = np.round(still(rng) * 1024) / 1024
    found, _ = preflight.inspect(recipe, table(coarse, 24, rate_hz=208.0))
    assert [m.id for m in found.remarks] == ["sheet-of-another-device"]
    device = preflight.with_sheet(recipe, found).device
    assert device.rate_hz == pytest.approx(208.0)
    assert device.lsb == pytest.approx(1 / 1024)
    assert (device.noise_density or 0.0) > (recipe.device.noise_density or 0.0)
    # Coarse steps at the sheet's own rate are a fault of the unit.
    alone, _ = preflight.inspect(recipe, table(coarse, 24, rate_hz=100.0))
    assert alone.remarks == () and preflight.with_sheet(recipe, alone) == recipe


def test_metres_per_second_squared_are_asked_about(rng: np.random.Generator) -> None:
    found, _ = preflight.inspect(by_hand(), table(still(rng) * 9.80665, 24))
    (remark,) = found.remarks
    assert (remark.id, remark.parameters["unit"]) == ("readings-in-other-unit", "m/s²")


def test_readings_cut_off_flat_are_seen_without_a_sheet(rng: np.random.Generator) -> None:
    found, _ = preflight.inspect(silent(by_hand()), table(np.clip(still(rng), -0.8, 0.8), 24))
    assert found.sheet.full_scale == pytest.approx(0.8)
    assert "readings-cut-off" in [m.id for m in found.remarks]
    plain, _ = preflight.inspect(silent(by_hand()), table(still(rng), 24))
    assert plain.sheet.full_scale is None


def test_shaking_and_accelerating_are_refused(rng: np.random.Generator) -> None:
    moving = still(rng) + np.cumsum(0.02 * rng.standard_normal((2400, 3)), axis=0)
    with pytest.raises(SamplesError) as shaken:
        preflight.inspect(by_hand(), table(moving, 24))
    assert shaken.value.message.id == "most-visits-move"
    pushed = still(rng) * np.repeat(rng.uniform(0.6, 1.6, 24), 100)[:, None]
    with pytest.raises(SamplesError) as driven:
        preflight.inspect(by_hand(), table(pushed, 24))
    assert driven.value.message.id == "magnitude-not-constant"


def test_noise_without_a_stimulus_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(SamplesError) as refused:
        preflight.inspect(by_hand(), table(rng.standard_normal((2400, 3)), 24))
    assert refused.value.message.id in ("noise-above-stimulus", "most-visits-move")


def test_shuffled_rows_are_put_in_order_and_late_stamps_are_not(rng: np.random.Generator) -> None:
    ordered = table(still(rng), 24)
    found, stored = preflight.inspect(by_hand(), ordered[rng.permutation(2400)])
    assert np.array_equal(stored.time_s, ordered.time_s)
    assert np.array_equal(stored.reading, ordered.reading)
    assert found.remarks == ()
    late = ordered.time_s.copy()
    late[50] += 0.05
    _, stored = preflight.inspect(by_hand(), replace(ordered, time_s=late))
    assert np.array_equal(stored.time_s, late)


@pytest.mark.parametrize("poses", [4, 6, 7])
def test_unknown_orientations_must_leave_something_beside_offset_and_gain(poses: int, rng: np.random.Generator) -> None:
    """Four faces that are met six times each fit any offset and gain, whatever else is wrong."""
    visits = np.repeat(np.resize(np.arange(24)[:: 24 // poses][:poses], 24), 100)
    y = SPHERE[visits] + 0.001 * rng.standard_normal((2400, 3))
    found, _ = preflight.inspect(by_hand(), table(y, 24))
    if poses == 7:
        preflight.check_orientations(by_hand(), found)
        return
    with pytest.raises(SamplesError, match=f"in {poses} orientations only"):
        preflight.check_orientations(by_hand(), found)
    preflight.check_orientations(by_hand(), replace(found, temperature_degC=(20.0, 40.0)))


def test_one_unknown_pose_tells_nothing_though_it_is_heated(rng: np.random.Generator) -> None:
    """Free gains followed what the temperature did: the verdict was `none`, or an axis was said to respond apart."""
    heat = np.sin(np.linspace(0, 2 * np.pi, 2400))
    y = [0.02, -0.01, 1.0] + 0.01 * heat[:, None] * [0.5, 0.0, 1.0] + 0.001 * rng.standard_normal((2400, 3))
    warm = replace(table(y, 24), values={"temperature_degC": 20 + 45 * heat})
    with pytest.raises(SamplesError, match="recipe such as one-point"):
        preflight.inspect(by_hand(), warm)


def test_an_axis_that_no_pose_turns_is_named(rng: np.random.Generator) -> None:
    flat = SPHERE * [1, 1, 0]
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    y = np.repeat(flat, 100, axis=0) + 0.001 * rng.standard_normal((2400, 3))
    found, _ = preflight.inspect(by_hand(), table(y, 24))
    assert ("axis-not-stimulated", "z") in [(m.id, m.parameters.get("axis")) for m in found.remarks]


def test_one_unit_far_from_its_family_is_named(rng: np.random.Generator) -> None:
    values = np.tile([0.0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1], (32, 1)) + 0.01 * rng.standard_normal((32, 12))
    serials, names = [f"SN{i}" for i in range(32)], [f"c{i}" for i in range(12)]
    std = np.full((32, 12), 1e-4)
    # One family of a thousand has a unit that far by chance (family.FAR).
    assert list(family.outlying(serials, values, std, names)) == []
    values[7, 11] += 0.34
    (one,) = family.outlying(serials, values, std, names)
    assert (one.parameters["serial"], one.parameters["coefficient"]) == ("SN7", "c11")
    middle = np.median(values[:, 11])
    robust = 1.4826 * np.median(np.abs(values[:, 11] - middle))
    assert one.parameters["sigmas"] == pytest.approx((values[7, 11] - middle) / robust)


def test_portions_are_one_preflight(rng: np.random.Generator) -> None:
    one, _ = preflight.inspect(by_hand(), table(still(rng), 24, unit="A"))
    two, _ = preflight.inspect(by_hand(), table(still(rng), 24, unit="B"))
    both = preflight.merge([one, replace(two, magnitude=(0.5, 1.0, 1.5))])
    assert (both.units, both.visits, both.magnitude[0], both.magnitude[2]) == (2, 48, 0.5, 1.5)


@given(
    st.lists(st.integers(-60, 60), min_size=1, max_size=60),
    st.sampled_from([1.0, 0.1, 2.0**-14]),
    st.lists(st.sampled_from([0.0, 1e-15, 3e-3, 0.5]), min_size=60, max_size=60),
    st.booleans(),
)
def test_each_value_is_found_once_on_a_grid_or_beside_it(
    codes: list[int], step: float, beside: list[float], on_grid: bool
) -> None:
    values = step * (np.array(codes) + (0.0 if on_grid else np.array(beside[: len(codes)]))) + 0.3
    np.testing.assert_array_equal(distinct(values), np.unique(values))


def test_blocks_of_few_slow_readings_begin_no_sooner_than_the_unit_arrived(rng: np.random.Generator) -> None:
    """Readings a quarter of a minute apart: what fades in 30 ms was larger by e²⁰⁰ before the first of them."""
    reduced = reduce_samples(by_hand(rate_hz=1 / 15), table(still(rng, samples=60), 24, rate_hz=1 / 15))
    since = reduced.fine.since_arrival_s
    assert since is not None
    assert since.min() >= 0
