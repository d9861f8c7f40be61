"""Gross faults: each made by hand in a small table, found with the right number, and not found where it is not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from station.diagnosis.data.faults import GrossFault, inspect
from station.diagnosis.data.faults.clipping import _limits
from station.diagnosis.data.faults.matched_spectrum import MatchedSpectrum
from station.diagnosis.data.faults.motor_tone import ONE_DWELL
from station.diagnosis.data.faults.phase_agreement import POWER_TERMS, PhaseAgreement, chance
from station.diagnosis.data.faults.white_dwells import TransientFilter, WhiteDwells
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError
from station.model.simulate import SimulationJob, simulate
from tests.blind.bench import hide
from tests.blind.hidden import KNOWN
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe, six_faces

RECIPE = recipe(1).model_copy(
    update={"device": recipe(1).device.model_copy(update={"lsb": 1e-5, "full_scale": 2.0, "counter_bits": 8})}
)


def table(seed: int = 1) -> SampleTable:
    """One run of two units on a grid of 10 µg, with a counter that runs on while moving."""
    made, _ = hide(RECIPE, None, seed, units=2)
    counter = np.floor(made.time_s * RECIPE.device.rate_hz + 0.25).astype(np.int64) % 256
    grid = np.round(made.reading / 1e-5) * 1e-5
    return replace(made, reading=grid, values={**made.values, "counter": counter.astype(float)})


def found(made: SampleTable, recipe_: Recipe = RECIPE) -> dict[str, GrossFault]:
    """Faults by effect."""
    return {f.effect: f for f in inspect(recipe_, made).faults}


def test_a_good_table_has_no_fault() -> None:
    assert not found(table())


@pytest.mark.parametrize(
    ("change", "effect"), [("lose", "lost-frames"), ("repeat", "duplicated-frames"), ("swap", "reordered-frames")]
)
def test_the_counter_tells_lost_repeated_and_reordered_frames(change: str, effect: str) -> None:
    made = table()
    rows = np.arange(len(made))
    hit = np.arange(7, len(made), 50)
    if change == "lose":
        rows = np.delete(rows, hit)
    elif change == "repeat":
        rows = np.sort(np.concatenate([rows, hit]))
    else:
        hit = hit[np.diff(made.visit, append=-1)[hit] == 0]
        rows[hit], rows[hit + 1] = hit + 1, hit
    times = made.time_s
    observed = replace(
        made[rows], time_s=np.sort(times)[np.argsort(np.argsort(times))][rows] if change != "swap" else times
    )
    faults = found(observed)
    assert list(faults) == [effect]
    shares = [float(n.value) for n in faults[effect].numbers]
    assert np.mean(shares) == pytest.approx(len(hit) / len(made), rel=0.05)


@pytest.mark.parametrize("every", [1, 3])
def test_frames_that_came_twice_count_once(every: int) -> None:
    made = table()
    rows = np.sort(np.r_[np.arange(len(made)), np.arange(0, len(made), every)])
    looked = inspect(RECIPE, made[rows])
    assert [f.effect for f in looked.faults if f.effect == "duplicated-frames"]
    assert np.array_equal(looked.table.time_s, made.time_s)


def test_a_clock_that_is_off_is_told_from_one_within_its_tolerance() -> None:
    for error, expected in ((1e-4, False), (1e-2, True), (-1e-2, True)):
        made = table()
        faults = found(replace(made, time_s=made.time_s / (1 + error)))
        assert ("clock-error" in faults) == expected
        if expected:
            n = faults["clock-error"].numbers[0]
            assert abs(float(n.value) - error) < 3 * (n.std or 0.0)


@pytest.mark.parametrize("seed", [3900700, 3900739])
def test_few_stops_of_few_samples_make_no_tone(seed: int) -> None:
    """Mean powers of a few stops have a heavy tail: by a normal one, these two held a line of 15 nats."""
    made, _ = hide(recipe(), KNOWN["filter-lag"], seed, units=1, d=16.0)
    assert "motor-tone" not in found(made, recipe())


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_of_few_dwells_a_stretch_promises_no_line(seed: int) -> None:
    """Their power scatters as much as the line's: all of it and more was taken for agreement."""
    rng, (dwells, samples, rate) = np.random.default_rng(seed), (48, 40, 2000.0)
    begin = np.sort(rng.uniform(0, 620, dwells))
    spectrum = MatchedSpectrum(rate, 75.0, in_parts=False)
    record = spectrum.record(float(begin[0]), float(begin[-1]) + samples / rate)
    live = np.ones((dwells, samples), bool)
    white = rng.standard_normal((*live.shape, 3))
    record.add(white, begin[:, None] + np.arange(samples) / rate, np.ones(dwells), live)
    spectrum.add(record, lambda frequency_hz: [np.ones(len(frequency_hz))] * 3, float(dwells))
    assert spectrum.lines() is None


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_tone_out_of_step_from_stop_to_stop_keeps_its_amplitude(seed: int) -> None:
    made = table(seed)
    stops = np.cumsum(np.diff(made.visit, prepend=-1) != 0)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, stops[-1] + 1)[stops]
    tone = made.values["motor"] * np.sin(2 * np.pi * 7.3 * made.time_s + phase)
    faults = found(replace(made, reading=made.reading + tone[:, None] * np.array([0.0, 5e-4, -1e-3])))
    numbers = {(n.name, n.axis): n for n in faults["motor-tone"].numbers}
    assert float(numbers["frequency", None].value) == pytest.approx(7.3, abs=0.1)
    for axis, size in (("y", 5e-4), ("z", 1e-3)):
        n = numbers["amplitude", axis]
        # The frequency is known to a tenth of 1/dwell, which costs the amplitude up to 2 %.
        assert abs(float(n.value) - size) < 4 * (n.std or 0.0) + 0.02 * size


def test_a_coarse_grid_is_measured() -> None:
    made = table()
    faults = found(replace(made, reading=np.round(made.reading / 4e-4) * 4e-4))
    assert list(faults) == ["quantization"]
    assert [float(n.value) for n in faults["quantization"].numbers] == pytest.approx([4e-4, 4e-4], rel=1e-3)


@pytest.mark.parametrize(("coarse", "faults"), [((0, 1), []), ((1,), ["quantization"])])
def test_a_step_that_no_sheet_states_is_judged_by_the_other_units_alone(
    coarse: tuple[int, ...], faults: list[str]
) -> None:
    """Offsets taken off pose by pose shift the grid, and what is left of two grids looks like a finer one."""
    made = table()
    rows = np.isin(made.unit.code, coarse)[:, None]
    made = replace(made, reading=np.where(rows, np.round(made.reading / 4e-4) * 4e-4, made.reading))
    device = type(RECIPE.device).model_construct(
        _fields_set=RECIPE.device.model_fields_set - {"lsb"}, **dict(RECIPE.device)
    )
    assert list(found(made, RECIPE.model_copy(update={"device": device}))) == faults


def test_what_one_unit_loses_the_others_do_not_gainsay() -> None:
    chosen = six_faces("listed").model_copy(update={"device": RECIPE.device})
    made, _ = hide(chosen, None, 3, units=4)
    counter = np.floor(made.time_s * chosen.device.rate_hz + 0.25).astype(np.int64) % 256
    gone = [
        np.flatnonzero((made.unit.code == 1) & (made.visit == visit))[5 : 5 + 2 * lost : 2]
        for visit, lost in enumerate((3, 0, 2, 0, 1, 1))
    ]
    rows = np.delete(np.arange(len(made)), np.concatenate(gone))
    fault = found(replace(made, values={**made.values, "counter": counter.astype(float)})[rows], chosen)["lost-frames"]
    assert [float(n.value) > 0 for n in fault.numbers] == [False, True, False, False]


@pytest.mark.parametrize("high", [False, True])
def test_a_bit_that_never_changes_is_named_by_its_weight(high: bool) -> None:
    made = table()
    code = np.round(made.reading / 1e-5).astype(np.int64)
    held = code | 64 if high else code & ~64
    mine = (made.unit.code == 1)[:, None]
    faults = found(replace(made, reading=np.where(mine, held, code) * 1e-5))
    assert list(faults) == ["stuck-bit"]
    (number,) = faults["stuck-bit"].numbers
    assert number.of == f"unit:{made.unit.names[1]}"
    assert float(number.value) == pytest.approx(-64e-5 if high else 64e-5)


@pytest.mark.parametrize("high", [False, True])
@pytest.mark.parametrize("bit", [9, 11])
@pytest.mark.parametrize("faces", [False, True])
def test_a_bit_far_above_the_noise_is_named_and_its_shifts_are_taken_off(faces: bool, bit: int, high: bool) -> None:
    """A dwell then shows one value or two of what stands above the bit, and lies off by all of its weight."""
    chosen = six_faces("listed") if faces else recipe(1)
    chosen = chosen.model_copy(update={"device": RECIPE.device})
    made, _ = hide(chosen, None, 3, units=2)
    code = np.round(made.reading / 1e-5).astype(np.int64)
    held = code | 1 << bit if high else code & ~(1 << bit)
    mine = (made.unit.code == 1)[:, None]
    inspected = inspect(chosen, replace(made, reading=np.where(mine, held, code) * 1e-5))
    assert [f.effect for f in inspected.faults] == ["stuck-bit"]
    assert [n.value for n in inspected.faults[0].numbers] == pytest.approx([(-1 if high else 1) * 1e-5 * 2**bit])
    stop = np.cumsum(np.any([np.diff(x, prepend=-1) != 0 for x in (made.unit.code, made.visit)], axis=0)) - 1
    count = np.bincount(stop)
    for axis in range(3):
        off = np.bincount(stop, (inspected.table.reading - code * 1e-5)[:, axis]) / count
        # A shift up here and down there is a gain.
        true = np.bincount(stop, made.reading[:, axis]) / count
        line = np.stack([np.ones(len(true)), true], axis=1)[len(true) // 2 :]
        rest = off[len(true) // 2 :]
        rest = rest - line @ np.linalg.lstsq(line, rest, rcond=None)[0]
        noise = RECIPE.device.noise_density * np.sqrt(RECIPE.device.rate_hz / 2)
        assert np.abs(rest).max() < 5 * noise / np.sqrt(count.min())
        assert not off[: len(true) // 2].any()


def test_few_levels_say_nothing_about_bits() -> None:
    made = table()
    steady = np.round(made.reading / 2**-4) * 2**-4 + 1e-5 * (np.arange(len(made)) % 2)[:, None]
    assert "stuck-bit" not in found(replace(made, reading=np.round(steady / 1e-5) * 1e-5))


def test_a_saturated_unit_is_found_and_its_stops_are_left_out() -> None:
    made = table()
    reading = made.reading.copy()
    mine = made.unit.code == 1
    reading[mine] = np.clip(reading[mine], -0.9, 0.9)
    looked = inspect(RECIPE, replace(made, reading=reading))
    assert [(f.effect, f.numbers[0].of, f.numbers[0].value) for f in looked.faults] == [
        ("clipping", "unit:SN0002", 0.9)
    ]
    assert np.abs(looked.table.reading[looked.table.unit.code == 1]).max() < 0.9
    assert len(looked.table) < len(made)


@pytest.mark.parametrize("seed", [9, 21, 27, 39])
def test_a_limit_near_the_stimulus_cuts_some_stops_whole_and_touches_others(seed: int) -> None:
    """Offset and gain take one face far beyond the limit and another to the ends of its noise: held-out stops of either
    kind speak for the limit."""
    faces = six_faces("listed")
    faces = faces.model_copy(update={"device": faces.device.model_copy(update={"lsb": 6e-5, "full_scale": 2.0})})
    made, _ = hide(faces, None, seed, units=3)
    limit = np.round(np.random.default_rng(seed).uniform(0.96, 1.01) / 6e-5) * 6e-5
    looked = found(replace(made, reading=np.clip(np.round(made.reading / 6e-5) * 6e-5, -limit, limit)), faces)
    gain = looked["clipping"].gain
    assert gain is not None
    assert gain.accepted


def test_an_offset_beside_which_nothing_changes_is_no_tumble() -> None:
    made = table()
    with pytest.raises(SamplesError, match=r"(?i)the readings of x are the same in every row"):
        diagnosis_of(RECIPE, replace(made, reading=made.reading + 1.3e11))


@pytest.mark.parametrize("step", [0.7, 1.3, 2.0, 3.0])
def test_steps_as_coarse_as_the_noise_hide_no_clipping_and_are_none(step: float) -> None:
    """step: in noises of a reading. Whole stops at one extreme are clipped, unless any stop may be at one code."""
    lsb = step * 1e-4 * np.sqrt(25.0 / 2)
    coarse = recipe(1).model_copy(update={"device": recipe(1).device.model_copy(update={"lsb": float(lsb)})})
    made, _ = hide(recipe(1), None, 900, units=4)
    cut = np.where((made.unit.code == 1)[:, None], np.clip(made.reading, -0.82, 0.82), made.reading)
    for reading, clips in ((made.reading, False), (cut, step < 2)):
        faults = found(replace(made, reading=np.round(reading / lsb) * lsb), coarse)
        assert ("clipping" in faults) == clips


def test_few_samples_at_one_step_by_chance_are_no_limit() -> None:
    """Six short stops whose steps are .4 to 1.3 noises: of the samples of some visit a third stand at the extreme now
    and then."""
    rng = np.random.default_rng(1)
    visit = np.repeat(np.arange(6), 24)
    faces = 3000.0 * np.concatenate([np.eye(3), -np.eye(3)])[visit]
    hits = [0, 0]
    for step in rng.uniform(0.4, 1.3, 400):
        reading = faces + rng.normal(0, 30, (6, 3))[visit] + rng.standard_normal(faces.shape)
        grid = np.round(reading / step) * step
        for i, made in enumerate((grid, np.minimum(grid, np.round(2900 / step) * step))):
            hits[i] += bool(np.isfinite(_limits(made, visit)).any())
    # Of a campaign's units not one in a thousand.
    assert hits[0] <= 1
    assert hits[1] >= 395


@pytest.mark.parametrize("beyond", [0.0, 0.005])
def test_a_stop_in_which_all_axes_froze_is_not_clipped(beyond: float) -> None:
    """Its readings stand still, if need be at the end of what one axis ever read, where the other axes are not."""
    made = table()
    u, reading = made.unit.code == 1, made.reading.copy()
    highest = int(np.flatnonzero(u)[np.argmax(reading[u, 2])])
    stop = u & (made.run == made.run[highest]) & (made.visit == made.visit[highest])
    reading[stop] = reading[highest] + [0, 0, beyond]
    assert "clipping" not in found(replace(made, reading=reading))
    reading[stop, :2] = made.reading[stop, :2]
    assert "clipping" in found(replace(made, reading=reading))


def test_where_every_stop_is_clipped_nothing_is_diagnosed() -> None:
    made = table()
    made = replace(made, reading=np.clip(made.reading, -0.55, 0.55))
    with pytest.raises(SamplesError, match=r"^(\d+) of \1 visits are clipped, and nothing can be told from the rest"):
        diagnosis_of(RECIPE, made)


def test_a_unit_of_which_no_stop_is_left_spoils_no_other() -> None:
    made = table()
    mine = made.unit.code == 0
    # Whatever the tilt, one axis feels more than 1/√3 g.
    reading = np.where(mine[:, None], np.clip(made.reading, -0.55, 0.55), made.reading)
    looked = diagnosis_of(RECIPE, replace(made, reading=reading))
    assert [(f.effect, f.numbers[0].of) for f in looked.faults] == [("clipping", "unit:SN0001")]
    assert looked.last.view.scene.visits.unit.names == ("SN0002",)


@pytest.mark.parametrize(("mapping", "equal"), [("-y,x,z", True), ("x,-y,z", False), ("z,y,x", False)])
def test_swapped_axes_are_named_and_put_right(mapping: str, equal: bool) -> None:
    made = table()
    order = ["xyz".index(part[-1]) for part in mapping.split(",")]
    signs = np.array([-1.0 if part.startswith("-") else 1.0 for part in mapping.split(",")])
    looked = inspect(RECIPE, replace(made, reading=made.reading[:, order] * signs))
    fault = looked.faults[0]
    assert [n.value for n in fault.numbers] == [mapping, mapping]
    # A proper rotation may as well be the mounting; a mirror image cannot.
    assert bool(fault.indistinguishable_from) == equal
    assert looked.table.reading == pytest.approx(made.reading)


@pytest.mark.parametrize("factor", [0.5, 2.0, 9.80665, 1000.0])
def test_a_whole_factor_is_named_and_put_right(factor: float) -> None:
    made = table()
    looked = inspect(RECIPE, replace(made, reading=made.reading * factor))
    assert [f.effect for f in looked.faults][:1] == ["wrong-scale"]
    assert looked.faults[0].numbers[0].value == pytest.approx(factor)
    assert looked.table.reading == pytest.approx(made.reading)


def test_a_gain_of_eight_per_cent_is_no_wrong_scale() -> None:
    made = table()
    assert not found(replace(made, reading=made.reading * 1.08))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_loud_tone_of_drives_that_hardly_differ_is_told_by_its_phase(seed: int) -> None:
    """Its power stands out first, and does not show that it grows with the drive."""
    fast = recipe(1).model_copy(update={"device": recipe(1).device.model_copy(update={"rate_hz": 200.0})})
    made, _ = hide(fast, None, 60 + seed, units=4)
    rng = np.random.default_rng(seed)
    made = made[np.arange(len(made)) % 200 < rng.integers(45, 116, 24)[made.visit]]
    drive = rng.uniform(0.25, 0.42, 24)[made.visit]
    tone = drive * np.sin(2 * np.pi * 23.7 * made.time_s)
    loud = made.reading + tone[:, None] * np.array([9e-4, 9e-4, -1.8e-3])
    faults = found(replace(made, reading=loud, values={"motor": drive, "started_s": 0 * drive}), fast)
    (frequency,) = (n for n in faults["motor-tone"].numbers if n.name == "frequency")
    assert abs(float(frequency.value) - 23.7) < 4 * (frequency.std or 0.0)


def test_a_tone_that_follows_the_motors_is_found_with_frequency_and_amplitude() -> None:
    made = table()
    angle = 2 * np.pi * 7.3 * (made.time_s + made.values["started_s"]) + 0.5
    tone = made.values["motor"] * np.sin(angle)
    faults = found(replace(made, reading=made.reading + tone[:, None] * np.array([0.0, 5e-4, -1e-3])))
    numbers = {(n.name, n.axis): n for n in faults["motor-tone"].numbers}
    assert float(numbers["frequency", None].value) == pytest.approx(7.3, abs=1e-3)
    for axis, size in (("x", 0.0), ("y", 5e-4), ("z", 1e-3)):
        n = numbers["amplitude", axis]
        assert abs(abs(float(n.value)) - size) < 4 * (n.std or 0.0) + 0.03 * size
    assert ("phase", None) in numbers
    steady = replace(made, reading=made.reading + 1e-3 * np.sin(angle)[:, None] * (made.values["motor"] == 0)[:, None])
    assert "motor-tone" not in found(steady)


def test_no_clock_is_judged_by_a_rate_taken_from_its_own_stamps() -> None:
    """Stamps of bursts of four were a clock-error with p = 1 where the recipe stated no rate."""
    sheet = RECIPE.device
    values = {name: getattr(sheet, name) for name in type(sheet).model_fields}
    silent = type(sheet).model_construct(_fields_set={"lsb"}, **values)
    made = table()
    stamped = {key: x for key, x in made.values.items() if key != "counter"}
    fast = replace(made, time_s=1.01 * made.time_s, values=stamped)
    looked = inspect(RECIPE.model_copy(update={"device": silent}), fast)
    assert "clock-error" not in {f.effect for f in looked.faults}
    assert "clock-error" in looked.undetectable
    assert "clock-error" in found(fast)


@pytest.mark.parametrize(("visits", "verdict"), [(2, "incomplete"), (24, "named")])
def test_a_fault_is_named_only_where_visits_held_out_confirm_it(visits: int, verdict: str) -> None:
    made = table()
    fast = made.unit.code == 1
    values = {key: x for key, x in made.values.items() if key != "counter"}
    made = replace(made, time_s=np.where(fast, 1.01 * made.time_s, made.time_s), values=values)
    found = diagnosis_of(RECIPE, made[~fast | (made.visit < visits)])
    (fault,) = found.faults
    assert (fault.effect, found.verdict) == ("clock-error", verdict)
    assert found.depends_on == (("unit",) if fault.gain is None else ())


def test_a_fault_of_frames_gains_a_frame_and_one_of_means_in_all() -> None:
    swapped = replace(table(), reading=table().reading[:, [1, 0, 2]])
    gain = found(swapped)["axis-permutation"].gain
    assert gain is not None
    assert (gain.per, gain.log_score) == (None, gain.total)
    made = table()
    gain = found(made[np.arange(len(made)) % 9 != 4])["lost-frames"].gain
    assert gain is not None
    assert gain.per == "frame"
    assert gain.log_score < gain.total


@pytest.mark.parametrize("seed", [300, 301])
def test_an_axis_noisier_than_the_others_is_no_tone(seed: int) -> None:
    made = simulate(SimulationJob(recipe(), ("A", "B"), seed)).table
    noise = np.random.default_rng(seed).standard_normal(len(made)) * 3 * np.std(np.diff(made.reading[:24, 2]))
    loud = np.c_[made.reading[:, :2], made.reading[:, 2] + noise]
    assert not inspect(recipe(), replace(made, reading=loud)).faults


#: What a sample keeps of those before it: falling noise, and a resonance at a sixth of the rate.
COLOURS = {"falling": (0.7, 0.0), "ringing": (0.9, -0.81)}


def coloured(colour: str, visits: int, seed: int) -> Any:
    """Noise of a colour (v, 25, 3), each visit anew, of one standard deviation."""
    noise, (one, two) = np.random.default_rng(seed).standard_normal((visits, 65, 3)), COLOURS[colour]
    for i in range(2, noise.shape[1]):
        noise[:, i] += one * noise[:, i - 1] + two * noise[:, i - 2]
    return noise[:, 40:] / np.std(noise[:, 40:])


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("seed", range(3))
def test_noise_of_any_colour_is_no_tone(seed: int, colour: str) -> None:
    """At the lower end of a spectrum that falls, all around a frequency is lower than it; where noise rings, a line
    stands in it at any drive."""
    made, _ = hide(recipe(1), None, seed)
    made = replace(made, reading=made.reading + 5e-4 * coloured(colour, 96, seed).reshape(-1, 3))
    assert "motor-tone" not in found(made, recipe(1))


@pytest.mark.parametrize("seed", range(8))
def test_noise_that_the_axes_share_is_no_tone(seed: int) -> None:
    """A supply's: where the three axes agree in it, that is one agreement."""
    made, _ = hide(recipe(1), None, seed)
    shared = np.random.default_rng(seed).standard_normal((len(made), 1))
    assert "motor-tone" not in found(replace(made, reading=made.reading + 2e-3 * shared), recipe(1))


def test_a_tone_beside_noise_that_the_axes_share_is_found() -> None:
    made = table()
    shared = 3e-4 * np.random.default_rng(1).standard_normal((len(made), 1))
    tone = made.values["motor"] * np.sin(2 * np.pi * 7.3 * (made.time_s + made.values["started_s"]))
    faults = found(replace(made, reading=made.reading + shared + tone[:, None] * np.array([0.0, 2e-4, -2e-4])))
    (frequency,) = (n.value for n in faults["motor-tone"].numbers if n.name == "frequency")
    assert frequency == pytest.approx(7.3, abs=5e-3)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("in_step", [True, False])
def test_a_hum_as_loud_at_any_drive_is_no_tone_of_the_motors(seed: int, in_step: bool) -> None:
    made, _ = hide(recipe(1), None, seed)
    rng = np.random.default_rng(seed)
    phase = np.repeat(rng.uniform(0, 2 * np.pi, len(made) // 25), 0 if in_step else 25)
    hum = np.sin(2 * np.pi * 7.3 * (made.time_s + made.values["started_s"]) + (phase if len(phase) else 0.0))
    made = replace(made, reading=made.reading + 5e-4 * hum[:, None] * np.array([0.3, 1.0, 0.5]))
    assert "motor-tone" not in found(made, recipe(1))


@pytest.mark.parametrize("seed", range(3))
def test_a_line_of_one_dwell_does_not_follow_the_drive_in_the_others(seed: int) -> None:
    rng, visits = np.random.default_rng(seed), 48
    time = 4.0 * np.arange(visits)[:, None] + np.arange(25) / 25
    motor = np.sort(rng.uniform(0, 1, visits))
    filter_ = TransientFilter(np.ones((visits, 25, 4)), np.zeros((visits, 3)), ())
    noise = rng.standard_normal((visits, 25, 3))
    in_step = np.sin(2 * np.pi * 7.3 * time)[..., None]
    for carried, follows in ((np.arange(visits) == visits - 4, False), (2 * motor, True)):
        white = noise + 2 * in_step * np.reshape(carried, (-1, 1, 1))
        dwells = WhiteDwells(white, np.zeros_like(white), time, motor, 25.0, filter_)
        every, others = PhaseAgreement(dwells, np.inf).power_follows_drive(7.3)
        assert chance(every, POWER_TERMS) < 1e-4
        assert (chance(others, POWER_TERMS) < ONE_DWELL) == follows


def test_a_tone_out_of_step_at_the_highest_frequency_is_looked_at_as_far_as_there_are_any() -> None:
    made, _ = hide(six_faces("listed", "reversed"), None, 3, units=4)
    stops = np.cumsum(np.diff(made.visit, prepend=-1) != 0)
    phase = np.random.default_rng(3).uniform(0, 2 * np.pi, stops[-1] + 1)[stops]
    tone = made.values["motor"] * np.sin(2 * np.pi * 12.15 * made.time_s + phase)
    readings = made.reading + tone[:, None] * np.array([0.0, 4e-4, -2e-3])
    faults = found(replace(made, reading=readings), six_faces("listed", "reversed"))
    (frequency,) = (n.value for n in faults["motor-tone"].numbers if n.name == "frequency")
    # Its likeness beyond half the rate lies within the same line, which is as wide as half of 1/dwell.
    assert float(frequency) == pytest.approx(12.15, abs=0.5)


@pytest.mark.parametrize("colour", COLOURS)
def test_noise_of_any_colour_agrees_in_phase_by_the_sum_of_three_exponentials(colour: str) -> None:
    visits, sets = 24, 60
    rng = np.random.default_rng(5)
    start = 4.0 * np.arange(visits)[:, None]
    curve = np.ones((visits, 25, 4))
    agreed = []
    for seed in range(sets):
        dwells = WhiteDwells(
            coloured(colour, visits, seed), np.zeros((visits, 25, 3)), start + np.arange(25) / 25,
            rng.uniform(0, 1, visits), 25.0, TransientFilter(curve, np.zeros((visits, 3)), ()),
        )  # fmt: skip
        agreement = PhaseAgreement(dwells, np.inf)
        agreed += [agreement.at(f) for f in (2.3, 4.2, 7.7, 11.1)]
    # Gamma's mean and variance are three; the standard error of the variance by its fourth moment, 3·3² + 6·3.
    count = len(agreed)
    assert np.mean(agreed) == pytest.approx(3, abs=4 * np.sqrt(3 / count))
    assert np.var(agreed) == pytest.approx(3, abs=4 * np.sqrt((45 - 9) / count))
