"""`station diagnose --shared`: who in a fleet shares a cause and since when, told from data drawn elsewhere."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from station.cli.app import main
from station.diagnosis.fleet.interval import GroupUnits, best_stretch
from station.diagnosis.fleet.moments import FleetCell, Moments
from station.diagnosis.fleet.noise import ResponseNoise, response_noise, winsorised
from station.diagnosis.fleet.time_scan import CauseDirections, GroupScan
from tests.fakes import shared_fleet

Out = pytest.CaptureFixture[str]
UNITS, SEED, BEGIN = 2400, 11, 1400
TILT, QUADRATIC = 8e-3, 2e-3
LATE_UNITS, LATE_TILT = 2400, 3e-3


def worn(number: int, station: str, nest: str, lot: str) -> tuple[Any, Any, float]:
    """Nest B of two stations from unit 1,400 on, and a lot of bent sensors."""
    tilted = nest == "B" and station in ("bench-3", "bench-9") and number >= BEGIN
    return np.array([TILT * tilted, 0.0, 0.0]), np.zeros(3), QUADRATIC * (lot == "L07")


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shared")
    shared_fleet.write(folder / "worn", UNITS, worn, SEED)
    shared_fleet.write(folder / "quiet", 1000, lambda *_: shared_fleet.NOTHING, SEED + 1)
    return folder


def diagnose(capsys: Out, *words: str | Path, code: int) -> Any:
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", "--shared", "--recipe", "six-point", "--processes", "1", *map(str, words)])
    shown = capsys.readouterr()
    assert ended.value.code == code, shown.err
    return shown


def test_two_nests_and_a_lot_are_named_with_their_beginning_and_size(fleet: Path, capsys: Out) -> None:
    results = fleet / "results"
    named = ("--db", fleet / "worn", "--results", results)
    document = json.loads(diagnose(capsys, *named, "--json", "-", code=1).out)
    found = {(f["station"], f["nest"], f["lot"]): f for f in document["findings"]}
    assert set(found) == {("bench-3", "B", None), ("bench-9", "B", None), (None, None, "L07")}
    for station in ("bench-3", "bench-9"):
        one = found[station, "B", None]
        assert (one["effect"], one["end"]) == ("nest-tilt", None)
        # A vector of three, each within four of its stated deviations.
        assert np.all(np.abs(np.array(one["vector"]) - [TILT, 0, 0]) < 4 * np.array(one["std"]))
        first = shared_fleet.FIRST + BEGIN * shared_fleet.STEP
        late = (np.datetime64(one["begin"][:19]) - np.datetime64(first.replace(tzinfo=None))) / np.timedelta64(1, "s")
        # One unit of a nest comes every forty: three of them before or after.
        assert abs(late) <= 3 * 40 * shared_fleet.STEP.total_seconds()
    lot = found[None, None, "L07"]
    assert "quadratic" in {lot["effect"], *lot["indistinguishable_from"]}
    assert (lot["begin"], lot["end"]) == (None, None)
    # Twenty times the noise of a visit: far beyond what one unit is allowed to say of its group.
    assert np.all(np.abs(np.array(lot["vector"]) - QUADRATIC) < 4 * np.array(lot["std"]))
    text = diagnose(capsys, *named, code=1)
    assert "nest B of bench-9 since" in text.out
    assert "3 of 3 portions are there" in text.err


def late(number: int, station: str, nest: str, lot: str) -> tuple[Any, Any, float]:
    """Nest B of two stations from 60 % of the units on, by little more than units differ by anyhow."""
    tilted = nest == "B" and station in ("bench-3", "bench-9") and number >= 0.6 * LATE_UNITS
    return np.array([LATE_TILT * tilted, 0.0, 0.0]), np.zeros(3), 0.0


def test_a_tilt_too_small_over_all_time_is_named_since_its_beginning(tmp_path: Path, capsys: Out) -> None:
    shared_fleet.write(tmp_path / "late", LATE_UNITS, late, SEED)
    document = json.loads(diagnose(capsys, "--db", tmp_path / "late", "--json", "-", code=1).out)
    found = {(f["effect"], f["station"], f["nest"]): f for f in document["findings"]}
    assert set(found) == {("nest-tilt", "bench-3", "B"), ("nest-tilt", "bench-9", "B")}
    for one in found.values():
        assert one["begin"] is not None
        assert one["end"] is None
        assert np.all(np.abs(np.array(one["vector"]) - [LATE_TILT, 0, 0]) < 4 * np.array(one["std"]))


def scans(left: Any, rng: np.random.Generator) -> list[float]:
    """Chance, all that was tried allowed for, of the strongest stretch of each of ten groups of a fleet (t, r)."""
    units, every = np.full(len(left), 4.0), np.full(len(left), 40.0)
    groups = [rng.normal(size=left.shape) * 2 + 4 * left for _ in range(10)]
    known = ResponseNoise(np.zeros(left.shape[1]), np.eye(left.shape[1]), 1_000_000)
    causes, out = CauseDirections.of([np.eye(left.shape[1])[:, :3]]), []
    for group in groups:
        since, during = GroupScan(group, units, np.sum(groups, axis=0), every, 8).tests(causes)
        for stretch in (since[0], during[0]):
            assert stretch is not None
            out.append(known.log_chance(stretch.test, 3) + np.log(stretch.tried))
    return out


def test_stretches_of_groups_that_share_nothing_keep_the_chance_that_is_stated() -> None:
    rng = np.random.default_rng(6)
    chances = np.array([scans(np.zeros((20, 6)), rng) for _ in range(60)])
    # Groups of one fleet hang together a little, through what they are compared with; ten at most as one.
    assert (chances < np.log(0.05)).mean() <= 0.05 + 4 * np.sqrt(0.05 / len(chances))


def test_chance_is_larger_where_few_units_tell_the_noise() -> None:
    """Student's t of one direction, and χ² where the noise is known."""
    few, many = (ResponseNoise(np.zeros(18), np.eye(18), freedom) for freedom in (90, 10**9))
    assert many.log_chance(25.0, 3) == pytest.approx(stats.chi2.logsf(25.0, 3), abs=1e-5)
    assert few.log_chance(20.0, 1) == pytest.approx(np.log(2 * stats.t.sf(np.sqrt(20.0 * 73 / 90), 73)), abs=1e-9)
    beyond = [few.log_chance(10.0**n, 3) for n in range(1, 200, 20)]
    assert np.isfinite(beyond).all()
    assert (np.diff(beyond) < 0).all()


def test_what_all_groups_share_at_a_time_is_the_cause_of_none() -> None:
    drift = np.linspace(0, 30, 20)[:, None] * np.ones(6)
    plain, drifting = (scans(left, np.random.default_rng(7)) for left in (np.zeros((20, 6)), drift))
    assert np.allclose(plain, drifting, rtol=0, atol=1e-6)


def test_a_fleet_that_shares_nothing_is_silent(fleet: Path, capsys: Out) -> None:
    assert "No group of the" in diagnose(capsys, "--db", fleet / "quiet", code=0).out


def test_wrong_input_is_one_sentence(fleet: Path, tmp_path: Path, capsys: Out) -> None:
    shared_fleet.write(tmp_path / "few", 40, lambda *_: shared_fleet.NOTHING, SEED)
    assert "at least 64" in diagnose(capsys, "--db", tmp_path / "few", code=2).err
    assert "names units with --db" in diagnose(capsys, code=2).err
    assert "names units with --db" in diagnose(capsys, "--db", fleet / "worn", "--report", "x.html", code=2).err


def test_moments_of_portions_add_up_to_those_of_all_units() -> None:
    rng = np.random.default_rng(3)
    cells = [FleetCell(f"s{rng.integers(2)}", f"n{rng.integers(2)}", "L") for _ in range(60)]
    z, columns = rng.normal(size=(60, 5)), rng.normal(size=(60, 5, 2))
    whole = Moments.join([Moments.of(cells, z, columns)])
    parts = [Moments.of(cells[i : i + 13], z[i : i + 13], columns[i : i + 13]) for i in range(0, 60, 13)]
    joined = Moments.join(parts)
    assert joined.cells == whole.cells
    for name in ("units", "z", "cross", "kz", "kk"):
        # Sums in another order: rounding of 60 terms of order one.
        assert np.allclose(getattr(joined, name), getattr(whole, name), rtol=0, atol=1e-12), name
    assert whole.units.sum() == 60


def test_a_cause_in_the_middle_of_a_group_has_a_beginning_and_an_end() -> None:
    rng = np.random.default_rng(4)
    z = rng.normal(size=(900, 1))
    z[300:600] += 2.0
    always_there = rng.normal(size=(900, 1)) + 2.0
    none = GroupUnits(np.arange(900), always_there, always_there, np.zeros(900, np.intp))
    found = best_stretch(GroupUnits(np.arange(900), z, z, np.zeros(900, np.intp)), np.eye(1), 1.0)
    assert abs(found.first - 300) <= 4
    assert abs(found.last - 600) <= 4
    assert (found.begun, found.ended) == (True, True)
    always = best_stretch(none, np.eye(1), 1.0)
    assert (always.first, always.last, always.begun, always.ended) == (0, 900, False, False)


def test_units_with_heavy_tails_scatter_no_more_than_the_search_reckons_with() -> None:
    """In every direction, winsorised as they are summed: half of the directions are Student's t with 3 degrees."""
    rng, known, d = np.random.default_rng(SEED), 2048, 12

    def draw(units: int) -> Any:
        return np.hstack([rng.standard_t(3, (units, d // 2)), rng.normal(size=(units, d // 2))])

    noise = response_noise(draw(known), [unit % 15 for unit in range(known)])
    largest = np.linalg.eigvalsh(np.cov(winsorised(noise.whitened(draw(20_000))).T))[-1]
    # What a covariance from so many units is off by in its worst direction (Marchenko and Pastur), and as much again.
    assert largest < (1 + np.sqrt(d / known)) ** 4
