"""Stretches of time in which a group differs from all others: every beginning and every end, slice by slice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.fleet.slices import Indices, TimeSlices
from station.domain.core.types import Floats

#: A direction weaker than this share of the strongest is none.
_WEAKEST = 1e-6


@dataclass(frozen=True, slots=True)
class ScannedStretch:
    """Slices first to last − 1; test: twice the log likelihood gained by its causes there; tried: how many stretches of
    this kind there were."""

    first: int
    last: int
    test: float
    tried: int


@dataclass(frozen=True, slots=True, eq=False)
class CauseDirections:
    """Of causes (n): directions (r, d), orthonormal within each, side by side; whose (d, n): 1 where a direction is of
    that cause; rank of each."""

    directions: Floats
    whose: Floats
    rank: tuple[int, ...]

    @staticmethod
    def of(columns: Sequence[Floats]) -> "CauseDirections":
        """Of whitened columns (r, a) of each cause."""
        parts = []
        for own in columns:
            u, s, _ = np.linalg.svd(own, full_matrices=False)
            parts.append(u[:, s**2 > _WEAKEST * s[0] ** 2])
        rank = tuple(part.shape[1] for part in parts)
        return CauseDirections(np.concatenate(parts, axis=1), np.repeat(np.eye(len(rank)), rank, axis=0), rank)


class GroupScan:
    """One group over time. group (t, r): sum of what its units are off by, everything known taken off; units, all_units
    (t): of the group and of all; everyone (t, r): the sum of all units."""

    def __init__(self, group: Floats, units: Floats, everyone: Floats, all_units: Floats, fewest: int) -> None:
        others = np.maximum(all_units - units, 0.0)
        compared = (units > 0) & (others > 0)
        #: (t, r): what the others are off by, zero where there are none.
        self.others = (everyone - group) * compared[:, None] / np.maximum(others, 1.0)[:, None]
        # What a unit is worth that is compared with so many others.
        part = compared * others / np.maximum(all_units, 1.0)
        shown = (group - units[:, None] * self.others) * part[:, None]
        self._sum, self._worth = _prefix(shown), _prefix(units * part)
        inside = _prefix(units * compared)
        first, last = np.triu_indices(len(units) + 1, 1)
        wide = (inside[last] - inside[first] >= fewest) & ~((first == 0) & (last == len(units)))
        self._first, self._last = first[wide], last[wide]
        self._slices, self._used = len(units), int(compared.sum())

    def tests(self, causes: CauseDirections) -> tuple[list[ScannedStretch | None], list[ScannedStretch | None]]:
        """Of each cause the best stretch that still lasts, and the best that is over; None where there is none."""
        tests = self._tests(causes, self._first, self._last)
        lasting = self._last == self._slices
        used = self._used
        kinds = (lasting, max(used - 1, 1)), (~lasting, max(used * (used + 1) // 2 - used, 1))
        since, during = ([self._best(own, kind, tried) for own in tests.T] for kind, tried in kinds)
        return since, during

    def at(self, causes: CauseDirections, stretch: ScannedStretch) -> Floats:
        """Tests of all causes in one stretch."""
        return np.asarray(self._tests(causes, np.array([stretch.first]), np.array([stretch.last]))[0])

    def medians(self, causes: CauseDirections) -> Floats:
        """Of each cause the median of its tests of all stretches that still last; none where there are none."""
        lasting = self._last == self._slices
        if not lasting.any():
            return np.zeros(0)
        return np.asarray(np.median(self._tests(causes, self._first[lasting], self._last[lasting]), axis=0))

    def _tests(self, causes: CauseDirections, first: Indices, last: Indices) -> Floats:
        along = self._sum @ causes.directions
        square = (along[last] - along[first]) ** 2 / np.maximum(self._worth[last] - self._worth[first], 1e-9)[:, None]
        return np.asarray(square @ causes.whose)

    def _best(self, tests: Floats, kind: NDArray[np.bool_], tried: int) -> ScannedStretch | None:
        if not kind.any():
            return None
        own = np.flatnonzero(kind)
        best = own[int(tests[own].argmax())]
        return ScannedStretch(int(self._first[best]), int(self._last[best]), float(tests[best]), tried)


def group_scan(slices: TimeSlices, left: Floats, members: Floats, fewest: int) -> GroupScan:
    """left (k, r): the rows' sums, everything known taken off; members (c): which cells are of the group."""
    inside, every = (members[slices.cell] > 0).astype(float), np.ones(len(slices.cell))
    units = slices.units[:, None]
    sums = (slices.by_slice(inside, left), slices.by_slice(inside, units)[:, 0])
    return GroupScan(*sums, slices.by_slice(every, left), slices.by_slice(every, units)[:, 0], fewest)


def _prefix(values: Floats) -> Floats:
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
