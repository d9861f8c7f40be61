"""Clocks against jittering stamps, and recordings of one pose that are cut in several ways."""

from dataclasses import replace

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.data.faults import clock
from station.diagnosis.data.preflight import PARTLY, inspect
from station.diagnosis.data.stays import recut, whole_rests
from station.domain.core.types import Labels, SampleTable
from station.domain.recipe.recipe import Recipe
from tests.blind.recipes import recipe

RATE_HZ = 100.0


def fast() -> Recipe:
    """The blind recipe at a usual rate."""
    whole = recipe(1)
    return whole.model_copy(update={"device": whole.device.model_copy(update={"rate_hz": RATE_HZ})})


def table(time_s: np.ndarray, visit: np.ndarray, units: int = 1) -> SampleTable:
    """Stamps of each unit alike; readings are noise."""
    n = len(time_s)
    rng = np.random.default_rng(3)
    return SampleTable(
        unit=Labels(tuple(f"U{u}" for u in range(units)), np.repeat(np.arange(units, dtype=np.int32), n)),
        run=np.zeros(n * units, np.int32),
        visit=np.tile(visit.astype(np.int32), units),
        position=Labels(("z-up",), np.zeros(n * units, np.int32)),
        time_s=np.tile(time_s, units),
        reading=rng.standard_normal((n * units, 3)),
        labels={},
        values={},
    )


def stamps(rate_error: float, late: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Stamps of 72 visits of 100 samples by a device of such a rate error, on a host that is late now and then."""
    visit = np.repeat(np.arange(72), 100)
    t = visit * 2.5 + np.tile(np.arange(100), 72) / (RATE_HZ * (1 + rate_error))
    n = len(t)
    if late == "sometimes":
        t = t + np.where(rng.uniform(size=n) < 0.05, rng.uniform(0, 8e-3, n), 0.0)
    elif late == "always":
        t = t + rng.exponential(1e-3, n)
    elif late == "bursts":
        # Four frames share the stamp of the last of them.
        t = np.ceil(t / 0.04) * 0.04
    elif late == "cut bursts":
        # Each visit begins with a whole burst of three, and its last one it cuts off after the first frame.
        place = np.tile(np.arange(100), 72)
        t = visit * 2.5 + (place // 3 * 3 + 2) / (RATE_HZ * (1 + rate_error)) + rng.uniform(0, 1e-4, n)
    elif late == "milliseconds":
        t = np.round(t, 3)
    elif late == "late and lost":
        t = t + rng.exponential(0.3 / RATE_HZ, n)
        keep = rng.uniform(size=n) > 0.05
        t, visit = t[keep], visit[keep]
    elif late == "lost":
        keep = rng.uniform(size=n) > 0.02
        t, visit = t[keep], visit[keep]
    order = np.lexsort((t, visit))
    return t[order], visit[order]


@pytest.mark.parametrize(
    "late", ["sometimes", "always", "bursts", "cut bursts", "milliseconds", "lost", "late and lost"]
)
def test_a_host_that_stamps_late_is_no_error_of_the_clock(late: str) -> None:
    for seed in range(10):
        t, visit = stamps(0.0, late, np.random.default_rng(seed))
        made = table(t, visit)
        stop = np.cumsum(np.diff(visit, prepend=-1) != 0) - 1
        assert clock.faults(fast(), made, stop) == []


@pytest.mark.parametrize("late", ["sometimes", "always", "cut bursts", "milliseconds", "lost"])
def test_an_error_of_the_clock_is_found_and_sized_beside_late_stamps(late: str) -> None:
    t, visit = stamps(0.01, late, np.random.default_rng(7))
    stop = np.cumsum(np.diff(visit, prepend=-1) != 0) - 1
    (found,) = clock.faults(fast(), table(t, visit), stop)
    (number,) = found.numbers
    assert number.std is not None
    assert abs(float(number.value) - 0.01) < 4 * number.std
    assert number.std < 1e-3
    assert found.gain is not None
    assert found.gain.accepted


def test_a_rate_that_is_another_setting_is_no_error_of_the_oscillator() -> None:
    visit = np.repeat(np.arange(24), 22)
    t = visit * 2.5 + np.tile(np.arange(22), 24) / 21.7
    assert clock.faults(fast(), table(t, visit), visit) == []


@pytest.mark.parametrize("cut_s", [5.0, 10.0, 30.0, 60.0])
def test_one_stay_becomes_the_same_table_however_it_is_cut(cut_s: float) -> None:
    t = np.arange(36_000) / 10.0
    made = recut(fast(), table(t, np.floor(t / cut_s + 1e-9), units=2))
    whole = recut(fast(), table(t, np.floor(t / 20.0 + 1e-9), units=2))
    assert np.array_equal(made.table.visit, whole.table.visit)
    assert made.stretches == whole.stretches == 2 * 96
    assert made.length_s == pytest.approx(3600 / 96, rel=1e-3)


def test_what_moves_at_the_ends_of_a_stay_is_left_out_however_it_is_cut() -> None:
    """The first 25 s and the last 10 s of 20 minutes are handled: of visits of 30 or 60 s a part is left out."""
    t = np.arange(12_000) / 10.0
    still = np.array([0.0, 0.0, 1.0]) + 0.002 * np.random.default_rng(5).standard_normal((len(t), 3))
    handled = (t < 25) | (t >= 1190)
    still[handled] += 0.4 * np.sin(t[handled])[:, None] * [1.0, 0.3, 0.1]
    device = {"device": fast().device.model_copy(update={"rate_hz": 10.0})}
    one = fast().model_copy(update={"positions": fast().positions[:1], **device})
    name = Labels((one.positions[0].name,), np.zeros(len(t), np.int32))
    kept = []
    for cut_s in (5.0, 10.0, 30.0, 60.0):
        made = table(t, np.floor(t / cut_s + 1e-9))
        found, left = inspect(one, replace(made, reading=still, position=name))
        kept.append(left.time_s)
        partly = [lost for lost in found.left_out if lost.reason.id == PARTLY]
        assert partly or cut_s < 30
        assert len({lost.reason for lost in found.left_out}) == len(found.left_out)
    assert all(np.array_equal(kept[0], other) for other in kept[1:])
    assert kept[0][0] >= 25
    assert kept[0][-1] < 1190
    assert len(kept[0]) > 0.94 * len(t)


def test_visits_that_the_fixture_left_are_not_joined() -> None:
    t, visit = stamps(0.0, "sometimes", np.random.default_rng(1))
    made = table(t, visit)
    assert recut(fast(), made).stretches == 0
    assert np.array_equal(recut(fast(), made).table.visit, visit)


def test_another_position_or_length_ends_a_stay() -> None:
    t = np.arange(4000) / 100.0
    made = table(t, np.floor(t / 10))
    two = replace(made, position=Labels(("a", "b"), (made.visit >= 2).astype(np.int32)))
    assert recut(fast(), two).table.visit[2000] == 4
    free = fast().model_copy(update={"reference": fast().reference.model_copy(update={"pose": "unknown"})})
    moved = replace(made, reading=made.reading * 1e-3 + np.where(made.visit[:, None] == 2, [1.0, 0, 0], [0, 0, 1.0]))
    # Twenty seconds in stretches of five, and two visits as they were.
    assert np.count_nonzero(np.diff(recut(free, moved).table.visit)) == 4 + 2 - 1


@pytest.mark.parametrize(("cut_s", "first_s"), [(0.5, 0.0), (1.0, 0.0), (2.0, 120.0), (5.0, 0.0), (10.0, 120.0)])
def test_the_rests_of_a_tumble_are_a_visit_each_however_they_are_cut(cut_s: float, first_s: float) -> None:
    """Pieces of half a second were visits of their own, whose errors are one error: it made causes evident. first_s: a
    tumble begins with a longer rest, of which the gyroscope's offset is taken."""
    rng = np.random.default_rng(4)
    rest_s = rng.uniform(3.0, 14.0, 12).round(2)
    rest_s[0] += first_s
    begins = np.cumsum(np.r_[0.0, rest_s[:-1] + 2.0])
    t = np.concatenate([b + np.arange(0.0, s, 0.01) for b, s in zip(begins, rest_s, strict=True)])
    rest = np.repeat(np.arange(12), [len(np.arange(0.0, s, 0.01)) for s in rest_s])
    piece = np.floor((t - begins[rest]) / cut_s + 1e-9).astype(int)
    visit = np.unique(1000 * rest + piece, return_inverse=True)[1]
    still = rng.standard_normal((12, 3))
    made = table(t, visit)
    made = replace(
        made, position=Labels(tuple(f"still-{i}" for i in range(12)), rest.astype(np.int32)), reading=still[rest]
    )
    for pose in ("unknown", "known"):
        held = fast().model_copy(update={"reference": fast().reference.model_copy(update={"pose": pose})})
        assert np.array_equal(recut(held, made).table.visit, rest)
        assert np.array_equal(whole_rests(held, made).visit, rest)
        # Stamps of a clock that ticks half as often as readings come.
        coarse = replace(made, time_s=np.floor(made.time_s / 0.02) * 0.02)
        assert np.array_equal(recut(held, coarse).table.visit, rest)


def test_the_deviation_of_a_rate_is_that_of_its_measurement() -> None:
    """Not the tolerance of the data sheet, which says nothing of a clock that is off."""
    off = []
    for seed in range(40):
        t, visit = stamps(0.01, "always", np.random.default_rng(seed))
        (found,) = clock.faults(fast(), table(t, visit), np.cumsum(np.diff(visit, prepend=-1) != 0) - 1)
        (number,) = found.numbers
        off.append((float(number.value) - 0.01) / float(number.std or 0))
    # Four deviations of a mean square of so many.
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(off)))


def test_a_pose_that_was_not_left_between_visits_is_met_once() -> None:
    """A unit that was turned about the vertical on one face lies there as it was laid: its visits share one error of
    placing, which looked like an error of each position. One that came back to the face was placed anew."""
    faces = load_recipe("six-faces")
    names = ("x-up", "x-down", "y-up", "y-down", "z-up", "z-down")
    order = np.array([0, 0, 1, 2, 3, 4, 5, 0, 0, 2, 2, 4, 4])
    visit, readings = np.repeat(np.arange(13), 400), 400 * 13
    made = table(np.arange(readings) / RATE_HZ + 2.0 * visit, visit)
    made = replace(made, position=Labels(names, order[visit].astype(np.int32)))
    placed = np.cumsum(np.r_[0, np.diff(order) != 0])[visit]
    assert np.array_equal(recut(faces, made).table.visit, placed)
    assert np.array_equal(whole_rests(faces, made).visit, placed)
    free = replace(made, position=Labels(tuple(f"still-{i}" for i in range(13)), visit.astype(np.int32)))
    assert recut(load_recipe("hand-held"), free).as_it_came


def test_a_loop_with_pauses_is_the_same_however_it_is_cut() -> None:
    """A logger that stalls now and then: where a cut fell on a pause a stay ended, and where it did not it went on."""
    t = np.arange(30_000) / 100.0
    # Rows between which all, some and none of the cuts fall.
    for row in (1500, 4250, 6000, 7777, 12_000, 20_500, 21_000, 23_333, 27_300):
        t[row:] += 3.0
    one_pose = fast().model_copy(update={"positions": fast().positions[:1]})
    cuts = [recut(one_pose, table(t, np.arange(len(t)) // (100 * s))).table for s in (5, 10, 30, 60)]
    assert all(np.array_equal(cut.visit, cuts[0].visit) for cut in cuts)
    # Dwells of which each is whole are visits, though the unit was never left.
    dwells = table(np.arange(1200) / 100.0 + 2.0 * (np.arange(1200) // 100), np.arange(1200) // 100)
    assert recut(one_pose, dwells).as_it_came
