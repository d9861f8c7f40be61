"""What many laws of one family do in a space: with P the precision of the readings beside what is known, columns b of
the base and courses x and y, the products are Σ x_v·(b_vᵀ·P·b_w)·y_w. What stands in the brackets is made once."""

from typing import NamedTuple

import numpy as np

from station.diagnosis.candidates.law_families import LawFamily
from station.diagnosis.linear.grid import RowLayout, VisitGrid
from station.diagnosis.linear.projection import ResidualSpace
from station.domain.core.types import Floats


class LawProducts(NamedTuple):
    """Of some laws: normal matrices (n, U, K, K) of their columns beside each unit's known ones, products with the
    shared known ones (n, U, K, c) and with the readings (n, U, K)."""

    normal: Floats
    border: Floats
    along: Floats


class FamilySpace(NamedTuple):
    """A family in a space. within: of two columns of the base the products (U, R, V, V) between visits of a run, where
    there are any; known: products (U, b, R·V, q) of the base's columns at single visits with what is known: readings,
    shared columns, each unit's own; shared: how many of them are shared; axes: columns of a group."""

    within: dict[tuple[int, int], Floats]
    known: Floats
    shared: int
    axes: int

    @staticmethod
    def of(family: LawFamily, layout: RowLayout, space: ResidualSpace) -> "FamilySpace":
        """From the family's base and the space."""
        runs = space.covariance.runs
        rows = layout.grid.spread(base_columns(family, layout))
        U, R, m, b = rows.shape
        V = m // layout.grid.k
        single, at = np.zeros((U, R, V, layout.grid.k, b, V)), np.arange(V)
        single[:, :, at, :, :, at] = np.moveaxis(rows.reshape(U, R, V, -1, b), 2, 0)
        white = np.ascontiguousarray(np.moveaxis(runs.whiten(single.reshape(U, R, m, -1)).reshape(U, R, m, b, V), 3, 0))
        pairs = {(i, j): white[i].swapaxes(-1, -2) @ white[j] for i in range(b) for j in range(i, b)}
        known = np.concatenate([space.residual[..., None], space.shared_basis, space.basis], axis=2)
        seen = np.moveaxis(white.swapaxes(-1, -2) @ known[:, : R * m].reshape(U, R, m, -1), 0, 1)
        within = {pair: product for pair, product in pairs.items() if product.any()}
        shared = space.shared_basis.shape[2]
        return FamilySpace(within, seen.reshape(U, b, R * V, -1), shared, family.columns.shape[2])

    def products(self, courses: Floats) -> LawProducts:
        """Of laws by courses (p, a, U, R, V, n), or (p, 1, U, R, V, n) of all columns alike. Columns of a law are in
        the order of groups, courses and columns of the base."""
        (U, b, _, q), (p, _, _, _, _, n) = self.known.shape, courses.shape
        course = np.broadcast_to(courses, (p, self.axes, *courses.shape[2:]))
        groups = b // self.axes
        normal = np.zeros((groups, p, self.axes, groups, p, self.axes, U, n))
        for (i, j), product in self.within.items():
            (g, a), (h, c) = divmod(i, self.axes), divmod(j, self.axes)
            for s in range(p):
                moved = product @ course[s, c]
                for t in range(p):
                    found = np.einsum("urvn,urvn->un", course[t, a], moved)
                    normal[g, t, a, h, s, c] = normal[h, s, c, g, t, a] = found
        flat = course.reshape(p, self.axes, U, -1, n).swapaxes(-1, -2)
        by_group = self.known.reshape(U, groups, self.axes, -1, q)
        taken = np.stack(
            [flat[t, a] @ by_group[:, g, a] for g in range(groups) for t in range(p) for a in range(self.axes)], axis=2
        ).swapaxes(0, 1)
        K = taken.shape[2]
        own = taken[..., 1 + self.shared :]
        left = np.moveaxis(normal.reshape(K, K, U, n), (3, 2), (0, 1)) - own @ own.swapaxes(-1, -2)
        return LawProducts(left, taken[..., 1 : 1 + self.shared], taken[..., 0])


def base_columns(family: LawFamily, layout: RowLayout) -> Floats:
    """Numbers that the columns of a family's base do to at the visits (v, k, groups · a)."""
    kept = layout.keep @ family.columns
    out = np.zeros((*kept.shape[:2], family.groups, kept.shape[2]))
    out[np.arange(len(kept)), :, family.code] = kept
    return out.reshape(*kept.shape[:2], -1)


def lengths(family: LawFamily, layout: RowLayout, courses: Floats) -> Floats:
    """Squares (n) of the longest column of each law before it is whitened, by courses (p, a, U, R, V, n)."""
    grid = VisitGrid(layout.grid.slot, 1)
    squares = np.sum(base_columns(family, layout) ** 2, axis=1)[:, None]
    spread = grid.spread(squares).reshape(*grid.slot.shape, family.groups, -1)
    axes = spread.shape[-1]
    course = np.broadcast_to(courses**2, (len(courses), axes, *courses.shape[2:]))
    each = [np.tensordot(x[a], spread[..., a], axes=((0, 1, 2), (0, 1, 2))) for x in course for a in range(axes)]
    return np.asarray(np.max(each, axis=(0, 2)))


def course_rows(courses: list[tuple[Floats, ...]], layout: RowLayout) -> Floats:
    """Courses of laws as (p, a, U, R, V, n)."""
    grid = VisitGrid(layout.grid.slot, 1)
    n, p, (v, a) = len(courses), len(courses[0]), courses[0][0].shape
    every = np.concatenate([part for parts in courses for part in parts]).reshape(n, p, v, a)
    spread = grid.spread(every.transpose(2, 1, 3, 0).reshape(v, 1, -1))
    return np.ascontiguousarray(np.moveaxis(spread.reshape(*grid.slot.shape, p, a, n), (3, 4), (0, 1)))
