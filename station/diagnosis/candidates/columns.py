"""Columns of a cause at the visits, stored without their zeros and each course once: most columns move a single axis,
and many move each axis alike. Those of a large fleet's bank are held in single precision. Of a column that a known
column follows, that leaves a share of 10⁻¹⁵ of its squares, a hundredth of what counts as zero."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Array, Floats

#: All visits.
ALL_VISITS = slice(None)
#: Visits above which a bank's columns are held in single precision.
MANY_VISITS = 1 << 12


@dataclass(frozen=True, slots=True, eq=False)
class CauseColumns:
    """Columns of the visits' means (v, 3, a), and of the contrasts (v, B−1, 3, a) where they change within a visit.

    axis, column (n): where a column is not zero at some visit; course (n) which of the courses stands there; still
    (v, f) and moving (v, B−1, f) the courses, the latter None where nothing moves; count: a; on_one_axis: whether each
    column moves exactly one axis.
    """

    axis: NDArray[np.intp]
    column: NDArray[np.intp]
    course: NDArray[np.intp]
    still: Array
    moving: Array | None
    count: int
    on_one_axis: bool

    @staticmethod
    def in_bank(view: ResidualView, visit: Floats, dwell: Floats | None = None) -> "CauseColumns":
        """The same for a bank; in full where only lengths are kept, beside which most of a column is lost."""
        columns = CauseColumns.of(visit, dwell)
        if len(visit) <= MANY_VISITS or view.grid.k != 3:
            return columns
        moving = None if columns.moving is None else columns.moving.astype(np.float32)
        return replace(columns, still=columns.still.astype(np.float32), moving=moving)

    @staticmethod
    def of(visit: Floats, dwell: Floats | None = None) -> "CauseColumns":
        """From whole columns."""
        by_column = np.ascontiguousarray(visit.T)
        there = by_column.any(axis=2)
        if dwell is not None:
            there = there | np.any(dwell, axis=(0, 1)).T
        column, axis = np.nonzero(there)
        found: dict[tuple[bytes, bytes], int] = {}
        course = [
            found.setdefault(
                (by_column[k, i].tobytes(), b"" if dwell is None else dwell[..., i, k].tobytes()), len(found)
            )
            for k, i in zip(column.tolist(), axis.tolist(), strict=True)
        ]
        first = [course.index(f) for f in range(len(found))]
        moving = None if dwell is None else dwell[..., axis[first], column[first]]
        still = np.ascontiguousarray(by_column[column[first], axis[first]].T)
        alone = np.array_equal(column, np.arange(visit.shape[2]))
        return CauseColumns(axis, column, np.array(course, np.intp), still, moving, visit.shape[2], alone)

    @staticmethod
    def by_axis(parts: Sequence[Floats]) -> "CauseColumns":
        """From functions (v, 3) of each axis, of which each is a column on that axis alone."""
        found: dict[bytes, int] = {}
        courses, course, axis, column = list[Floats](), list[int](), list[int](), list[int]()
        for p, part in enumerate(parts):
            for i, values in enumerate(np.ascontiguousarray(part.T)):
                if values.any():
                    place = found.setdefault(values.tobytes(), len(found))
                    courses += [values] if place == len(courses) else []
                    course, axis, column = [*course, place], [*axis, i], [*column, 3 * p + i]
        still = np.stack(courses, axis=1) if courses else np.zeros((len(parts[0]), 0))
        axes, columns, of_course = (np.array(x, np.intp) for x in (axis, column, course))
        return CauseColumns(axes, columns, of_course, still, None, 3 * len(parts), len(column) == 3 * len(parts))

    def visit(self, visits: slice = ALL_VISITS) -> Floats:
        """Whole columns of some visits' means (v, 3, a)."""
        return self._whole(self.still[visits])

    def dwell(self, visits: slice = ALL_VISITS) -> Floats | None:
        """Those of their contrasts (v, B−1, 3, a), if there are any."""
        return None if self.moving is None else self._whole(self.moving[visits])

    def retained(self, keep: Floats, visits: slice = ALL_VISITS) -> Floats:
        """What `keep` (v, k, 3) of all visits leaves of some visits' means (v, k, a)."""
        if not self.on_one_axis:
            return np.asarray(keep[visits] @ self.visit(visits))
        return np.asarray(keep[visits].take(self.axis, axis=2) * self.still[visits].take(self.course, axis=1)[:, None])

    def on_their_axes(self, visits: slice = ALL_VISITS) -> Array:
        """Of columns that move one axis each their values there at some visits (v, a)."""
        return self.still[visits].take(self.course, axis=1)

    def select_visits(self, chosen: Array) -> "CauseColumns":
        """The same at some of the visits."""
        return replace(self, still=self.still[chosen], moving=None if self.moving is None else self.moving[chosen])

    def _whole(self, values: Array) -> Floats:
        out = np.zeros((*values.shape[:-1], 3, self.count))
        out[..., self.axis, self.column] = values[..., self.course]
        return out
