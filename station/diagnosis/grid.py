"""Stops laid out by unit and run, so that one pass of arithmetic serves all units.

A unit's data are a vector of R runs × m rows, m = V stops × k numbers a stop: k = 3 readings, or 1 where only the
magnitude is known. Runs with fewer stops, and units with fewer runs, are filled with rows of zeros.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.types import Floats
from station.model.visits import Visits


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """slot (U, R, V): index of the stop, −1 where there is none; k: numbers a stop."""

    slot: NDArray[np.intp]
    k: int

    @property
    def units(self) -> int:
        """Number of units."""
        return int(self.slot.shape[0])

    @property
    def rows(self) -> int:
        """Numbers of one unit, the filled ones counted."""
        return int(self.slot[0].size) * self.k

    @property
    def data(self) -> int:
        """Numbers measured."""
        return int(np.count_nonzero(self.slot >= 0)) * self.k

    def spread(self, values: Floats) -> Floats:
        """Values of the stops (v, k, c) as (U, R, V·k, c); zeros where there is no stop."""
        padded = np.concatenate([values, np.zeros((1, *values.shape[1:]))])
        U, R, V = self.slot.shape
        return np.asarray(padded[self.slot].reshape(U, R, V * self.k, values.shape[2]))

    def codes(self, code: NDArray[np.int32]) -> NDArray[np.int32]:
        """Codes of the stops (v) for each row (U, R·V·k); −1 where there is no stop."""
        padded = np.append(code, np.int32(-1))
        return np.repeat(padded[self.slot].reshape(self.units, -1), self.k, axis=1)


def grid_of(visits: Visits, k: int) -> Grid:
    """The layout of stops that are sorted by unit, run and visit."""
    starts = np.flatnonzero(visits.previous < 0)
    length = np.diff(np.append(starts, len(visits)))
    unit = visits.unit.code[starts]
    run = np.arange(len(starts)) - np.searchsorted(unit, unit)
    slot = np.full((len(visits.unit.names), int(run.max(initial=0)) + 1, int(length.max(initial=1))), -1)
    for u, r, a, n in zip(unit, run, starts, length, strict=True):
        slot[u, r, :n] = np.arange(a, a + n)
    return Grid(slot, k)
