"""A table put together from pieces is the one that they were cut from, however much room was made for it."""

from itertools import pairwise

import numpy as np
import pytest

from station.adapters.samples import join
from station.adapters.samples.gathering import gather
from station.domain.core.types import Labels, SampleTable
from tests.blind.bench import hide
from tests.blind.hidden import KNOWN
from tests.blind.recipes import recipe


def pieces(table: SampleTable) -> list[SampleTable]:
    """The table cut unevenly, without the names that a piece does not have."""
    ends = [0, 1, 700, 701, 5000, len(table)]
    return [table[a:b].used() for a, b in pairwise(ends)]


@pytest.mark.parametrize("room", [0, 3000, 100_000])
def test_pieces_become_the_table_that_joining_makes(room: int) -> None:
    table, _ = hide(recipe(), KNOWN["quadratic"], 1, units=2)
    expected, found = join(pieces(table)), gather(iter(pieces(table)), room)
    for name in ("run", "visit", "time_s", "reading"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for name, labels in {"unit": found.unit, "position": found.position, **found.labels}.items():
        other = getattr(expected, name) if name in ("unit", "position") else expected.labels[name]
        assert labels.names == other.names
        np.testing.assert_array_equal(labels.code, other.code)
    assert list(found.labels) == list(expected.labels)
    assert sorted(found.values) == sorted(expected.values)
    for name, values in found.values.items():
        np.testing.assert_array_equal(values, expected.values[name])
    assert found.gold is None


def test_a_column_that_a_piece_lacks_is_left_out() -> None:
    rows = np.zeros(2, np.int32)
    plain = SampleTable(Labels(("A",), rows), rows, rows, Labels(("p",), rows), np.zeros(2), np.zeros((2, 3)))
    more = SampleTable(
        plain.unit, rows, rows, plain.position, plain.time_s, plain.reading, values={"motor": np.ones(2)}
    )
    assert not gather(iter([more, plain]), 4).values
    assert len(gather(iter([plain, more]), 4)) == 4
