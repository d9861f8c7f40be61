"""Numbers that become more, load after load."""

import numpy as np

from station.domain.core.types import Floats

_FIRST_CAPACITY = 64


class Rows:
    """Numbers (n, *shape) that become more: to add one costs the same however many there are."""

    def __init__(self, *shape: int) -> None:
        self._kept, self._count = np.empty((_FIRST_CAPACITY, *shape)), 0

    def __len__(self) -> int:
        return self._count

    @property
    def array(self) -> Floats:
        """All of them (n, *shape)."""
        return self._kept[: self._count]

    def add(self, row: "float | Floats") -> None:
        """One more."""
        self._make_room(1)
        self._kept[self._count] = row
        self._count += 1

    def extend(self, rows: Floats) -> None:
        """Rows (n, *shape) more."""
        self._make_room(len(rows))
        self._kept[self._count : self._count + len(rows)] = rows
        self._count += len(rows)

    def keep(self, count: int) -> None:
        """Only the first so many."""
        self._count = min(self._count, count)

    def _make_room(self, count: int) -> None:
        while self._count + count > len(self._kept):
            self._kept = np.concatenate([self._kept, np.empty_like(self._kept)])
