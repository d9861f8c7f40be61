"""A large table reduced some units at a time comes to what it does whole, or its samples are asked for together."""

import tracemalloc
import weakref
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.adapters.samples import write_samples
from station.cli import _diagnosis_samples
from station.cli._diagnosis_samples import MeasuredSource
from station.diagnosis.data import preflight
from station.diagnosis.data.faults import inspect
from station.diagnosis.data.faults.tone_search import ToneExtent, ToneSearch
from station.diagnosis.data.portions import PortionedTable, reduce_portions
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.data.visit_noise import NoiseTally, sample_noise
from station.diagnosis.results.diagnose import Diagnosis, diagnose_reduced
from station.domain.core.types import SampleTable
from station.domain.evaluation.unit_dwells import reduce_table
from station.domain.recipe.recipe import Recipe
from station.model.model_file import Model
from station.model.scene import visits_scene_of_table
from tests.blind.bench import hide
from tests.blind.hidden import KNOWN
from tests.blind.inspection import diagnosis_of, null_of
from tests.blind.recipes import recipe

LSB = 1e-5
#: Bound of a sample's scatter where none is an outlier, whatever noise a portion shows by itself.
BOUND = 7e-4


def stepping_by(lsb: float) -> Recipe:
    return recipe(2).model_copy(
        update={"device": recipe(2).device.model_copy(update={"lsb": lsb, "full_scale": 2.0, "counter_bits": 8})}
    )


RECIPE = stepping_by(LSB)


def table(units: int = 3, hidden: Any = None, seed: int = 5) -> SampleTable:
    """Units on a grid, whose counters run on while they are moved."""
    made, _ = hide(RECIPE, hidden, seed, units=units)
    counter = np.floor(made.time_s * RECIPE.device.rate_hz + 0.25).astype(np.int64) % 256
    grid = np.round(made.reading / LSB) * LSB
    return replace(made, reading=grid, values={**made.values, "counter": counter.astype(float)})


def bounded_table(hidden: Any = None) -> SampleTable:
    """The same with a scatter in bounds about the mean of each visit."""
    made = table(hidden=hidden)
    visit = np.cumsum(np.diff(made.visit, prepend=-1) != 0) - 1
    mean = np.stack([np.bincount(visit, column) for column in made.reading.T], axis=1) / np.bincount(visit)[:, None]
    # In pairs that cancel, so that the mean of a block is hardly off that of its visit.
    scatter = np.repeat(np.random.default_rng(11).uniform(-BOUND, BOUND, ((len(made) + 1) // 2, 3)), 2, axis=0)
    scatter[1::2] *= -1
    scatter = scatter[: len(made)]
    return replace(made, reading=np.round((mean[visit] + scatter) / LSB) * LSB)


def by_unit(made: SampleTable) -> Callable[[], Iterator[SampleTable]]:
    """A portion a unit."""
    return lambda: (made[made.unit.code == u] for u in range(len(made.unit.names)))


def reduced(made: SampleTable, of: Recipe = RECIPE) -> PortionedTable:
    found = reduce_portions(of, by_unit(made))
    assert found is not None
    return found


def same(one: Any, two: Any) -> None:
    """Every array of two frozen values, to rounding."""
    for field in fields(one):
        a, b = (getattr(x, field.name) for x in (one, two))
        if hasattr(a, "__dataclass_fields__"):
            same(a, b)
        elif isinstance(a, np.ndarray | float):
            scale = float(np.max(np.abs(b), initial=0.0, where=np.isfinite(b)))
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12 * scale, err_msg=field.name)
        else:
            assert a == b or not isinstance(a, str | int | tuple), field.name


def test_portions_come_to_what_the_whole_table_does() -> None:
    """One visit moves and is left out; one axis of a stop is noisier than all others."""
    made = bounded_table()
    moved = (made.unit.code == 1) & (made.run == 0) & (made.visit == 4)
    noisy = (made.unit.code == 2) & (made.run == 1) & (made.visit == 7)
    shaken = made.reading + moved[:, None] * np.linspace(0, 0.4, len(made))[:, None] * np.array([0.0, 1.0, 0.0])
    shaken[moved, 1] += np.linspace(0, 0.5, int(moved.sum()))
    # To and fro: differences show noise, and no sample is an outlier.
    to_and_fro = 1.45 * BOUND * (-1.0) ** np.arange(int(noisy.sum()))
    shaken[noisy, 2] = np.round((np.mean(shaken[noisy, 2]) + to_and_fro) / LSB) * LSB
    made = replace(made, reading=shaken)
    checked, used = preflight.inspect(RECIPE, made)
    whole = preflight.with_sheet(RECIPE, checked)
    inspected = inspect(whole, used.used())
    assert not inspected.faults and len(checked.left_out) == 1
    found = reduced(made, RECIPE)
    same(found.reduced, reduce_samples(whole, inspected.table))
    assert np.any(found.reduced.excess != 1.0)
    assert found.inspection.undetectable == inspected.undetectable
    assert _places(found.preflight) == _places(checked)
    assert found.preflight.magnitude == pytest.approx(checked.magnitude, rel=1e-12)
    assert (found.preflight.units, found.preflight.visits) == (checked.units, checked.visits)
    np.testing.assert_array_equal(found.inspection.samples.table.reading, used.reading)
    assert found.inspection.samples.rows == len(used) < len(made)
    for one, two in zip(found.inspection.samples.dwells(whole), reduce_table(used, whole), strict=True):
        same(one, two)


def test_the_visits_of_a_portion_are_reduced_by_its_own_noise() -> None:
    """A unit twice as noisy as the others moves no mean of theirs."""
    made, rng = table(), np.random.default_rng(8)
    louder = _last(made) * LSB * np.round(7e-4 / LSB * rng.standard_normal((len(made), 3)))
    found = reduced(replace(made, reading=made.reading + louder)).reduced
    means = [reduce_samples(RECIPE, portion.used()).mean for portion in by_unit(made)()][:2]
    np.testing.assert_allclose(found.mean[: len(found.mean) * 2 // 3], np.concatenate(means), rtol=1e-12)


def _places(found: preflight.Preflight) -> list[tuple[str, int, int]]:
    return [(one.unit, one.run, one.visit) for one in found.left_out]


def test_a_cause_is_the_same_in_portions() -> None:
    made = bounded_table(KNOWN["hysteresis"])
    whole, found = diagnosis_of(RECIPE, made), reduced(made, RECIPE)
    inspected = found.inspection
    apart = diagnose_reduced(RECIPE, inspected.samples, inspected, found.reduced, Model(), null_of)
    assert [c.finding.name for c in apart.causes] == [c.finding.name for c in whole.causes] == ["hysteresis"]
    assert (apart.verdict, apart.not_testable) == (whole.verdict, whole.not_testable)
    for one, two in zip(_numbers(apart), _numbers(whole), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-9)


def test_units_whose_rows_do_not_stand_together_are_seen_together() -> None:
    made = table()
    first = made.run == 0
    assert reduce_portions(RECIPE, lambda: iter([made[first], made[~first]])) is None


def _numbers(d: Diagnosis) -> list[Any]:
    (cause,) = d.causes
    assert cause.estimate is not None
    probability, evidence = (list(x.values()) for x in (cause.finding.probability, cause.finding.evidence))
    return [cause.estimate.value, cause.estimate.std, probability, evidence, cause.gain.log_score, d.floor.floor.noise]


def _with(made: SampleTable, reading: Any = None, **values: Any) -> SampleTable:
    return replace(made, reading=made.reading if reading is None else reading, values={**made.values, **values})


def _last(made: SampleTable) -> Any:
    return (made.unit.code == len(made.unit.names) - 1)[:, None]


def clipped(made: SampleTable) -> SampleTable:
    return _with(made, np.where(_last(made), np.clip(made.reading, -0.9, 0.9), made.reading))


def swapped(made: SampleTable) -> SampleTable:
    return _with(made, np.where(_last(made), made.reading[:, [1, 0, 2]], made.reading))


def one_frame_lost_in_each_of_two_units(made: SampleTable) -> SampleTable:
    rows = [int(np.flatnonzero(made.unit.code == u)[17]) for u in (0, 1)]
    return made[np.delete(np.arange(len(made)), rows)]


def coarse(made: SampleTable) -> SampleTable:
    return _with(made, np.where(_last(made), np.round(made.reading / 4e-4) * 4e-4, made.reading))


def bit_stuck_in_all(made: SampleTable) -> SampleTable:
    """So high that only the codes of all units together are enough to tell."""
    return _with(made, ((np.round(made.reading / LSB).astype(np.int64)) & ~(1 << 6)) * LSB)


def slow_clock(made: SampleTable) -> SampleTable:
    return replace(made, time_s=np.where(_last(made)[:, 0], made.time_s * 1.01, made.time_s))


def humming(made: SampleTable) -> SampleTable:
    """A tone that no unit alone shows."""
    at = made.time_s + made.values["started_s"]
    tone = made.values["motor"] * np.sin(2 * np.pi * 7.3 * at)
    return _with(made, np.round((made.reading + 5e-5 * tone[:, None]) / LSB) * LSB)


def with_gaps(made: SampleTable) -> SampleTable:
    return _with(made, temperature_degC=np.where(np.arange(len(made)) == len(made) - 3, np.nan, 25.0))


def of_unknown_positions(made: SampleTable) -> SampleTable:
    return replace(made, position=replace(made.position, names=("nowhere", *made.position.names[1:])))


@pytest.mark.parametrize(
    "change",
    [clipped, swapped, one_frame_lost_in_each_of_two_units, coarse, bit_stuck_in_all, slow_clock, humming, with_gaps,
     of_unknown_positions],
)  # fmt: skip
def test_what_is_out_of_the_ordinary_is_looked_at_whole(change: Callable[[SampleTable], SampleTable]) -> None:
    made = change(table(8 if change is humming else 3))
    assert reduce_portions(RECIPE, by_unit(made)) is None


def test_drives_that_differ_only_between_units_are_seen_together() -> None:
    """Nothing is known of a tone in the first unit until another drive is met."""
    made = table()
    still = _with(made, motor=np.ones(len(made)))
    found = reduced(still)
    assert "motor-tone" in found.inspection.undetectable
    assert reduce_portions(RECIPE, by_unit(_with(made, motor=1.0 * (made.unit.code == 2)))) is None


def test_dwells_that_show_no_tone_before_longer_ones_are_seen_together() -> None:
    made = table()
    place = np.arange(len(made)) % 25
    assert reduce_portions(RECIPE, by_unit(made[(made.unit.code > 0) | (place < 17)])) is not None
    assert reduce_portions(RECIPE, by_unit(made[(made.unit.code > 0) | (place < 11)])) is None


def test_a_tone_between_the_frequencies_of_shorter_dwells_is_not_missed() -> None:
    made = table()
    extent = ToneExtent.of(made, visits_scene_of_table(RECIPE, made).visit)
    assert extent is not None and extent.longest == 25
    assert ToneSearch(25.0, 13, in_parts=True).covers(extent)
    assert not ToneSearch(25.0, 12, in_parts=True).covers(extent)


def test_a_tone_that_all_units_show_together_is_in_none_of_them() -> None:
    made = humming(table(8))
    for portion in by_unit(made)():
        assert "motor-tone" not in {f.effect for f in inspect(RECIPE, portion.used()).faults}
    assert "motor-tone" in {f.effect for f in inspect(RECIPE, made).faults}


def test_only_a_large_file_of_one_unit_after_the_other_is_gone_through_in_portions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = table()

    def source(name: str, rows: Any, log: Path | None = None) -> MeasuredSource:
        write_samples(made[rows], tmp_path / name)
        return MeasuredSource(tmp_path / name, log, None, RECIPE.name, RECIPE)

    every = np.arange(len(made))
    assert source("small.parquet", every).portions() is None
    monkeypatch.setattr(_diagnosis_samples, "LARGE_ROWS", len(made) - 1)
    monkeypatch.setattr(_diagnosis_samples, "PORTION_ROWS", 1)
    portions = source("large.parquet", every).portions()
    assert portions is not None
    parts = [t.unit.text() for t in portions()]
    assert len(parts) > 1 and np.array_equal(np.concatenate(parts), made.unit.text())
    mixed = source("mixed.parquet", np.roll(every, 7)).portions()
    assert mixed is not None and reduce_portions(RECIPE, mixed) is None
    assert source("large.parquet", every, tmp_path / "a log").portions() is None
    monkeypatch.setattr(_diagnosis_samples, "MOST_ROWS", len(made) - 1)
    assert source("large.parquet", every).portions() is None


def test_each_portion_is_read_once_and_no_sample_is_held_longer() -> None:
    made, held = table(5), list[Any]()

    def portions() -> Iterator[SampleTable]:
        for portion in by_unit(made)():
            # Beside the one that is asked for now, its predecessor may be on its way out.
            assert sum(one() is not None for one in held) <= 1
            held.append(weakref.ref(portion.reading))
            yield portion

    assert reduce_portions(RECIPE, portions) is not None
    assert len(held) == 5 and all(one() is None for one in held[:-1])


def test_what_adds_up_holds_no_samples() -> None:
    made, rng = table(4), np.random.default_rng(2)
    tally, tones = NoiseTally(), ToneSearch(RECIPE.device.rate_hz, 25, in_parts=True)

    def add(after_s: float) -> None:
        part = replace(made, reading=rng.standard_normal(made.reading.shape), time_s=made.time_s + after_s)
        visit = visits_scene_of_table(RECIPE, part).visit
        extent = ToneExtent.of(part, visit)
        assert extent is not None
        tally.add(NoiseTally.of(part.reading, visit))
        tones.add(part, visit, extent)

    tracemalloc.start()
    try:
        add(0.0)
        before = tracemalloc.get_traced_memory()[0]
        for k in range(1, 6):
            add(1e5 * k)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < made.reading.nbytes / 4, (grown, made.reading.nbytes)


@given(st.lists(st.lists(st.integers(-3, 3), min_size=2, max_size=30), min_size=1, max_size=6), st.booleans())
def test_noise_added_up_is_that_of_all_samples(stops: list[list[int]], even: bool) -> None:
    visit = np.repeat(np.arange(len(stops)), [len(s) for s in stops])
    values = np.concatenate(stops) * (1.0 if even else np.sqrt(2)) + 0.0
    reading = np.stack([values, values[::-1] / 3, np.zeros(len(values))], axis=1)
    tally = NoiseTally()
    for v in range(len(stops)):
        tally.add(NoiseTally.of(reading[visit == v], visit[visit == v]))
    np.testing.assert_allclose(tally.sigma(), sample_noise(reading, visit), rtol=1e-12)
