"""Dwells that are livelier as they begin are told from noise of any colour, whatever each has of it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from station.diagnosis.data.arrivals import PIECES, chance_of_early, pieces_of_dwells
from station.domain.core.types import Floats

DWELLS, SAMPLES = 60, 50


def _scene(each: int = 12, dwells: int = DWELLS, drive: Floats | None = None) -> Any:
    """Runs of so many visits each."""
    previous = np.where(np.arange(dwells) % each, np.arange(dwells) - 1, -1)
    return SimpleNamespace(
        visits=SimpleNamespace(previous=previous, unit=SimpleNamespace(code=np.zeros(dwells, int))),
        time_s=np.arange(dwells) % float(each),
        temperature_degC=drive,
        motor=drive,
    )


def _chance(moves: Floats, rng: np.random.Generator, scene: Any = None) -> float:
    """Of dwells (v, s, 3) about other means."""
    means = rng.standard_normal((len(moves), 3))
    reading = (means[:, None] + moves).reshape(-1, 3)
    pieces = pieces_of_dwells(reading, np.repeat(np.arange(len(moves)), SAMPLES))
    return chance_of_early(pieces, means, scene or _scene())


def _ringing(size: Floats) -> Floats:
    t = np.arange(SAMPLES) / SAMPLES
    return np.asarray(np.exp(-t / 0.2)[:, None] * np.cos(2 * np.pi * 4.3 * t)[:, None] * size[:, None])


def test_ringing_of_another_size_and_direction_at_each_dwell_is_told(rng: np.random.Generator) -> None:
    noise = rng.standard_normal((DWELLS, SAMPLES, 3))
    assert _chance(noise + _ringing(1.2 * rng.standard_normal((DWELLS, 3))), rng) < 1e-6
    # The same at the other end of the dwells is none.
    assert _chance(noise + _ringing(1.2 * rng.standard_normal((DWELLS, 3)))[:, ::-1], rng) > 0.1


def test_what_all_dwells_of_a_run_have_in_common_is_none_of_it(rng: np.random.Generator) -> None:
    noise = rng.standard_normal((DWELLS, SAMPLES, 3))
    alike = np.repeat(3.0 * rng.standard_normal((DWELLS // 12, 3)), 12, axis=0)
    assert _chance(noise + _ringing(alike), rng) > 1e-3


def _slow(rng: np.random.Generator) -> Floats:
    white = rng.standard_normal((DWELLS, SAMPLES + 200, 3))
    for i in range(1, white.shape[1]):
        white[:, i] += 0.9 * white[:, i - 1]
    return np.asarray(white[:, 200:])


@pytest.mark.parametrize(
    "noise",
    [
        lambda rng: rng.standard_normal((DWELLS, SAMPLES, 3)),
        lambda rng: rng.standard_t(2.5, (DWELLS, SAMPLES, 3)),
        lambda rng: np.diff(rng.standard_normal((DWELLS, SAMPLES + 1, 3)), axis=1),
        lambda rng: np.exp(rng.standard_normal((DWELLS, 1, 1))) * rng.standard_normal((DWELLS, SAMPLES, 3)),
        _slow,
    ],
    ids=["white", "heavy", "differenced", "uneven", "slow"],
)
def test_noise_of_any_kind_is_as_lively_late(noise: Any, rng: np.random.Generator) -> None:
    """Of twenty sets the least chance is below 1/2000 once in a hundred."""
    assert min(_chance(noise(rng), rng) for _ in range(20)) > 5e-4


def test_dwells_of_few_samples_or_in_disorder_have_no_pieces(rng: np.random.Generator) -> None:
    reading = rng.standard_normal((4 * PIECES, 3))
    assert not pieces_of_dwells(reading, np.tile([0, 1], 2 * PIECES)).any()
    assert not pieces_of_dwells(reading, np.arange(4 * PIECES) // (PIECES - 1)).any()
    assert pieces_of_dwells(reading, np.arange(4 * PIECES) // PIECES).shape == (4, PIECES, 3)


def test_pieces_are_as_long_early_as_late(rng: np.random.Generator) -> None:
    """Backwards in time the pieces stand backwards, however many samples are left over."""
    reading = rng.standard_normal((PIECES + 11, 3))
    visit = np.zeros(len(reading), np.intp)
    there, back = pieces_of_dwells(reading, visit), pieces_of_dwells(reading[::-1], visit)
    assert np.allclose(there, back[:, ::-1], atol=1e-6)


def test_runs_of_six_visits_say_so_no_more_often_than_chance(rng: np.random.Generator) -> None:
    """What is taken off six visits leaves them alike: 30 of them count as 16 or so."""
    chances = [
        _chance(rng.standard_normal((30, SAMPLES, 3)), rng, _scene(6, 30, rng.standard_normal(30))) for _ in range(200)
    ]
    # 6 of 200 are expected at most; 15 and more come once in a thousand times.
    assert np.count_nonzero(np.array(chances) < 0.03) < 15
