"""Visits that read as another position than the one they are called after."""

from dataclasses import replace

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.data import preflight
from station.domain.core import rotation
from station.domain.core.types import Floats, Labels, SampleTable
from station.errors import SamplesError

RECIPE = load_recipe("six-point")
NAMES = tuple(p.name for p in RECIPE.positions)
READINGS = 40


def table(rng: np.random.Generator, units: int = 2, runs: int = 2, matrix: Floats | None = None) -> SampleTable:
    """Six faces, with offsets and gains of a few hundredths."""
    unit, run, visit = (x.ravel() for x in np.indices((units, runs, len(NAMES))))
    true = np.array([RECIPE.true_vector(p) for p in RECIPE.positions])[visit]
    gain = np.eye(3) if matrix is None else matrix
    mean = true @ gain.T * (1 + 0.03 * rng.standard_normal((units, 3)))[unit]
    mean += 0.05 * rng.standard_normal((units, 3))[unit]
    rows = np.repeat(np.arange(len(visit)), READINGS)
    moving_s = 5.0 * visit[rows] + np.tile(np.arange(READINGS) / 100, len(visit))
    return SampleTable(
        Labels(tuple(f"SN{u}" for u in range(units)), unit[rows].astype(np.int32)),
        run[rows].astype(np.int32),
        visit[rows].astype(np.int32),
        Labels(NAMES, visit[rows].astype(np.int32)),
        moving_s,
        mean[rows] + 1e-3 * rng.standard_normal((len(rows), 3)),
    )


def called(made: SampleTable, unit: int, run: int, names: dict[int, int]) -> SampleTable:
    """The table with other positions in some visits of a run."""
    code = made.position.code.copy()
    for visit, name in names.items():
        code[(made.unit.code == unit) & (made.run == run) & (made.visit == visit)] = name
    return replace(made, position=Labels(NAMES, code))


@pytest.mark.parametrize("seed", range(3))
def test_two_visits_exchanged_are_left_out_and_named(seed: int) -> None:
    made = called(table(np.random.default_rng(seed)), 1, 1, {1: 4, 4: 1})
    found, used = preflight.inspect(RECIPE, made)
    assert [(one.of, one.reason.parameters["other"]) for one in found.left_out] == [
        ("visit:SN1/1/1", NAMES[1]), ("visit:SN1/1/4", NAMES[4]),
    ]  # fmt: skip
    assert len(used) == len(made) - 2 * READINGS
    (fault,) = found.faults
    assert fault.effect == "disturbed-visit"
    assert fault.gain is not None
    assert fault.gain.accepted


def test_a_run_that_began_a_position_late_is_left_out(rng: np.random.Generator) -> None:
    """Also where it is all that there is of its unit."""
    made = called(table(rng, runs=1), 0, 0, {v: (v + 1) % 6 for v in range(6)})
    found, used = preflight.inspect(RECIPE, made)
    assert [one.of for one in found.left_out] == [f"visit:SN0/0/{v}" for v in range(6)]
    assert used.used().unit.names == ("SN1",)


def test_no_visit_as_called_is_refused(rng: np.random.Generator) -> None:
    made = called(table(rng, units=1, runs=1), 0, 0, {v: (v + 1) % 6 for v in range(6)})
    with pytest.raises(SamplesError, match="another position than it is called"):
        preflight.inspect(RECIPE, made)


@pytest.mark.parametrize(
    "matrix",
    [np.eye(3), np.diag([1.0, 1.0, -1.0]), np.eye(3)[[1, 0, 2]], np.eye(3)[[2, 0, 1]], 9.80665 * np.eye(3)],
    ids=["as it should be", "an axis upside down", "two axes exchanged", "all axes exchanged", "m/s²"],
)
def test_axes_of_a_unit_are_not_taken_for_positions(rng: np.random.Generator, matrix: Floats) -> None:
    found, _ = preflight.inspect(RECIPE, table(rng, matrix=matrix))
    assert found.faults == ()
    assert [one for one in found.left_out if one.reason.id == "visit-at-another-position"] == []


def test_a_unit_that_sat_turned_in_a_run_is_not_taken_for_positions(rng: np.random.Generator) -> None:
    """By a quarter turn about z: that is its seating, whatever the table says of it."""
    turned = called(table(rng, runs=3), 0, 2, dict(enumerate([0, 1, 4, 5, 3, 2])))
    assert preflight.inspect(RECIPE, turned)[0].faults == ()


def test_one_face_put_down_instead_of_up_is_left_out(rng: np.random.Generator) -> None:
    found, _ = preflight.inspect(RECIPE, called(table(rng), 0, 1, {0: 1, 1: 0}))
    assert [one.of for one in found.left_out] == ["visit:SN0/1/0", "visit:SN0/1/1"]


@pytest.mark.parametrize("factor", [1.0, np.pi / 180])
def test_spins_exchanged_are_left_out_whatever_their_unit(rng: np.random.Generator, factor: float) -> None:
    spins = load_recipe("gyroscope-six-point")
    names = tuple(p.name for p in spins.positions)
    true = np.array([spins.true_vector(p) for p in spins.positions])
    made = table(rng)
    reading = factor * (true[made.visit] + rng.normal(0, 0.02, (len(made), 3)))
    made = replace(called(made, 1, 1, {0: 3, 3: 0}), reading=reading)
    made = replace(made, position=Labels(names, made.position.code))
    found, _ = preflight.inspect(spins, made)
    assert [one.of for one in found.left_out] == ["visit:SN1/1/0", "visit:SN1/1/3"]


@pytest.mark.parametrize("visit", [0, 3])
def test_one_face_turned_over_has_a_gain_of_its_own(rng: np.random.Generator, visit: int) -> None:
    """One visit, of which one axis reads another number: its halves say so apart."""
    made = table(rng)
    found, _ = preflight.inspect(RECIPE, called(made, 0, 1, {visit: visit + (1 if visit % 2 == 0 else -1)}))
    (fault,) = found.faults
    assert fault.gain is not None
    assert fault.gain.accepted
    assert fault.nats > 100


def test_the_angle_turns_the_part_to_where_it_reads(rng: np.random.Generator) -> None:
    """As the effect turns it: the reading of the position called is that of the other."""
    made = called(table(rng), 0, 1, {2: 5, 3: 2})
    found, _ = preflight.inspect(RECIPE, made)
    (fault,) = found.faults
    angles = np.array([n.value for n in fault.numbers], float).reshape(-1, 3)
    for angle, (visit, name) in zip(angles, {2: 5, 3: 2}.items(), strict=True):
        stated, read = (RECIPE.true_vector(RECIPE.positions[p]) for p in (name, visit))
        assert rotation.from_vector(angle).T @ stated == pytest.approx(read, abs=1e-6)
