"""What the diagnosis works through in portions, or counts a short way, is the same as all at once and the plain way."""

import numpy as np
import pytest
from numpy.typing import NDArray

from station.diagnosis.data import reduce
from station.diagnosis.data.faults import counters
from station.domain.core.types import Floats, Labels, SampleTable

STOPS, BLOCKS = 9, len(reduce.BLOCK_EDGES)


def stops(rng: np.random.Generator) -> tuple[Floats, Floats, NDArray[np.intp], Floats]:
    """Values (n, 3), times (n), cells (n) and their counts of stops of other lengths, with outliers and drift."""
    visit = np.repeat(np.arange(STOPS), rng.integers(10, 60, STOPS))
    cell = visit * BLOCKS + rng.integers(0, BLOCKS, len(visit))
    values = rng.standard_normal((len(visit), 3)) + 0.3 * (visit == 4)[:, None] * np.arange(len(visit))[:, None]
    values[:: len(visit) // 7] += 50.0
    return values, np.linspace(0.0, 1.0, len(visit)), cell, np.bincount(cell, minlength=STOPS * BLOCKS).astype(float)


@pytest.mark.parametrize("together", [1, 40, 100])
def test_means_in_portions_have_the_bits_of_one(
    together: int, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    values, time_s, cell, count = stops(rng)
    whole = reduce.huber_means(values, time_s, cell, count, np.ones(3))
    monkeypatch.setattr(reduce, "SAMPLES_AT_ONCE", together)
    assert np.array_equal(reduce.huber_means(values, time_s, cell, count, np.ones(3)), whole)


def test_rows_of_stops_that_do_not_stand_together_are_taken_at_once(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    values, time_s, cell, count = stops(rng)
    order = rng.permutation(len(cell))
    whole = reduce.huber_means(values[order], time_s[order], cell[order], count, np.ones(3))
    monkeypatch.setattr(reduce, "SAMPLES_AT_ONCE", 1)
    assert np.array_equal(reduce.huber_means(values[order], time_s[order], cell[order], count, np.ones(3)), whole)


def test_frames_are_tallied_as_one_would_by_hand(rng: np.random.Generator) -> None:
    stop = np.repeat(np.arange(12), 50)
    number = np.concatenate([3 * s + np.arange(50) for s in range(12)])
    keep = np.sort(np.r_[rng.choice(len(stop), 560, replace=False), 100, 101, 420])
    order = np.arange(len(keep))
    order[200], order[201] = 201, 200
    stop, number = stop[keep], number[keep][order]
    unit = Labels(("A", "B", "C"), (stop // 4).astype(np.int32))
    n = len(stop)
    table = SampleTable(
        unit=unit,
        run=np.zeros(n, np.int32),
        visit=stop.astype(np.int32),
        position=Labels(("p",), np.zeros(n, np.int32)),
        time_s=np.linspace(0.0, 1.0, n),
        reading=np.zeros((n, 3)),
        values={"counter": (number % 256).astype(float)},
    )
    found = counters.tally(table, stop, 8)
    assert found.unit.tolist() == [s // 4 for s in range(12)]
    for s in range(12):
        own = number[stop == s]
        assert found.arrived[s] == len(own)
        assert found.different[s] == len(set(own.tolist()))
        assert found.sent[s] == own.max() - own.min() + 1
        assert found.stepped_back[s] == (np.diff(own) < 0).sum()
