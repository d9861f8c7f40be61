"""A scan of single visits without its columns says what the columns say."""

import numpy as np
import pytest

from station.diagnosis.candidates import projected_bank
from station.diagnosis.candidates.bank import Bank, Candidate, build_bank
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.linear import noise_floor as floors
from station.diagnosis.linear.evidence import Pattern
from station.diagnosis.linear.grid import RowLayout, VisitGrid
from station.diagnosis.linear.projection import DataColumns, NuisanceColumns, ResidualSpace, residual_space
from station.diagnosis.search import null_simulation
from station.diagnosis.search.null_noise import NullNoise

UNITS, RUNS, VISITS = 3, 2, 40
LEVELS: tuple[tuple[str, Pattern], ...] = (("unit", "own"), ("common", "shared"))


def scene(k: int, rng: np.random.Generator) -> tuple[RowLayout, ResidualSpace, Bank]:
    """Three units of two runs, the last one short, under a floor with a walk, each with offsets of its own and one
    column shared; and a scan of any reading of a visit."""
    n = UNITS * RUNS * VISITS - 7
    unit, run, visit = (x[:n] for x in np.unravel_index(np.arange(UNITS * RUNS * VISITS), (UNITS, RUNS, VISITS)))
    slot = np.full((UNITS, RUNS, VISITS), -1)
    slot[unit, run, visit] = np.arange(n)
    grid = VisitGrid(slot, k)
    keep = np.round(rng.standard_normal((n, k, 3)), 3)
    layout = RowLayout(grid, keep, 1.0, unit)
    weight = rng.choice([0.5, 1.0, 2.0], n)
    turn, steps = np.round(rng.standard_normal((n, k, 3)), 3), (visit + 1).astype(float)
    structure = floors.floor_structure(grid, weight, turn, steps, keep)
    floor = structure.covariance(np.array([1.0, 0.5, 0.2]))
    columns, data = (grid.spread(rng.standard_normal((n, k, c))) for c in (3, 1))
    own, shared = DataColumns(columns[..., :2]), DataColumns(columns[..., 2:])
    known = NuisanceColumns(own, np.zeros((UNITS, 2)), np.zeros((UNITS, 2)), shared, np.zeros(1), np.zeros(1))
    space = residual_space(floor, known, DataColumns(data), grid.data)
    stop = np.round(rng.standard_normal((n, 3, 2)), 3)
    names = tuple(f"visit:{i}" for i in range(n))
    scan = Candidate(
        "disturbed-visit", None, "visit", "scan", np.arange(n, dtype=np.int32), names, CauseColumns.of(stop)
    )
    return layout, space, build_bank([scan], layout, moving=False)


@pytest.mark.parametrize("k", [1, 3])
def test_a_scan_finds_what_its_columns_find(k: int, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    layout, space, bank = scene(k, rng)
    (short,) = projected_bank.project_bank(bank, layout, [space])
    monkeypatch.setattr(Candidate, "scans_visits", False)
    layout_bank = build_bank(list(bank.candidates), layout, moving=False)
    (whole,) = projected_bank.project_bank(layout_bank, layout, [space])
    assert np.allclose(short.evidence, whole.evidence, rtol=1e-9)
    a, b = short.found[0], whole.found[0]
    assert np.allclose(a.spectrum.m, b.spectrum.m, rtol=1e-8, atol=1e-10)
    assert a.components is not None and b.components is not None
    assert np.allclose(np.abs(a.components), np.abs(b.components), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("k", [1, 3])
def test_new_data_meet_a_scan_as_they_meet_its_columns(
    k: int, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout, space, bank = scene(k, rng)
    white = rng.standard_normal((5, *space.data.shape)) * space.live
    results = []
    for plain in (False, True):
        if plain:
            monkeypatch.setattr(Candidate, "scans_visits", False)
            bank = build_bank(list(bank.candidates), layout, moving=False)
        (seen,) = projected_bank.project_bank(bank, layout, [space], axes=True)
        light = null_simulation.SinglePrecisionBank(seen)
        drawn = NullNoise.of(white.astype(np.float32), space.covariance.runs.single_precision())
        results.append(light.scores([drawn], None))
    assert np.allclose(results[0][0], results[1][0], rtol=1e-3, atol=1e-3)


def test_candidates_of_one_shape_are_judged_together_as_each_alone(rng: np.random.Generator) -> None:
    layout, space, scans = scene(3, rng)
    n = len(layout.unit)
    codes = {"unit": layout.unit.astype(np.int32), "common": np.zeros(n, np.int32)}
    items = list(scans.candidates)
    for i in range(4):
        of, pattern = LEVELS[i % 2]
        columns = CauseColumns.of(np.round(rng.standard_normal((n, 3, 2 + i // 3)), 3))
        items.append(Candidate(f"{i}", None, of, pattern, codes[of], ("a",) * (codes[of].max() + 1), columns))
    white = rng.standard_normal((400, *space.data.shape)) * space.live
    drawn = [NullNoise.of(white.astype(np.float32), space.covariance.runs.single_precision())]
    (seen,) = projected_bank.project_bank(build_bank(items, layout, moving=False), layout, [space], axes=True)
    together, _ = null_simulation.SinglePrecisionBank(seen).scores(drawn, None)
    for i in range(len(items)):
        alone, _ = null_simulation.SinglePrecisionBank(seen.only([j == i for j in range(len(items))])).scores(
            drawn, None
        )
        assert np.allclose(together[:, i], alone[:, 0], rtol=1e-4, atol=1e-4)
