"""The units of a fleet by cell and slice of time, which a search for beginnings needs, in memory that follows the
cells.

A slice holds a fixed number of units of the whole fleet. A group is compared with all others in the same slice, so that
seasonal changes common to all are nobody's cause.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

Indices = NDArray[np.intp]
#: Units in a slice at least, and slices at most.
_LEAST_UNITS, _MOST_SLICES = 32, 128


@dataclass(frozen=True, slots=True, eq=False)
class TimeSlices:
    """edges_ns (t − 1): where one slice ends and the next begins. Rows (k), one for each cell and slice that has units:
    cell (k), at (k): indices of both; units (k)."""

    edges_ns: NDArray[np.int64]
    cell: Indices
    at: Indices
    units: Floats

    @property
    def count(self) -> int:
        """Slices."""
        return len(self.edges_ns) + 1

    def row_of(self, cell: int, began_ns: NDArray[np.int64]) -> Indices:
        """Rows of units of one cell."""
        own = np.flatnonzero(self.cell == cell)
        return np.asarray(own[np.searchsorted(self.at[own], slice_of(self.edges_ns, began_ns))])

    def by_slice(self, weight: Floats, rows: Floats) -> Floats:
        """Sums (t, m) of rows (k, m) times their weight (k)."""
        return np.stack([np.bincount(self.at, weight * column, self.count) for column in rows.T], axis=1)


def slice_edges(began_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """For slices of equally many units that began at such times."""
    count = int(np.clip(len(began_ns) // _LEAST_UNITS, 1, _MOST_SLICES))
    return np.unique(np.sort(began_ns)[np.arange(1, count) * len(began_ns) // count])


def slice_of(edges_ns: NDArray[np.int64], began_ns: NDArray[np.int64]) -> Indices:
    """Index of the slice of each time."""
    return np.asarray(np.searchsorted(edges_ns, began_ns, side="right"))


def time_slices(edges_ns: NDArray[np.int64], parts: Iterable[tuple[int, NDArray[np.int64]]]) -> TimeSlices:
    """parts: of each portion and cell the cell's index and when its units began (n)."""
    units: Counter[tuple[int, int]] = Counter()
    for cell, began_ns in parts:
        at, count = np.unique(slice_of(edges_ns, began_ns), return_counts=True)
        units.update({(cell, one): number for one, number in zip(at.tolist(), count.tolist(), strict=True)})
    keys = sorted(units)
    cells, ats = (np.array([key[i] for key in keys], np.intp) for i in (0, 1))
    return TimeSlices(edges_ns, cells, ats, np.array([units[key] for key in keys], float))
