"""Runs of visits whitened block by block, at a cost that is linear in the visits.

Readings of a run are y_b = W_b·a + e_b in block b: a what the random walk has come to before the block, e the walk
within it and all noise. Kalman's filter makes innovations of them (Durbin and Koopman, Time Series Analysis by State
Space Methods, 2012, ch. 4), which are the rows of L⁻¹·y, L being the Cholesky factor of the whole run's covariance.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats

#: Rows of a block at most, 24 visits of three: so many that matrices are worth it, so few that their cubes are not
#: felt.
MAX_BLOCK_ROWS = 72
#: Rows of a triangular matrix that are multiplied together.
BAND_ROWS = 36


def block_visits(visits: int, k: int) -> tuple[int, int]:
    """Number of blocks, and visits in each, of runs of so many visits of k numbers."""
    blocks = max(1, -(-visits * k // (MAX_BLOCK_ROWS // k * k)))
    return blocks, -(-visits // blocks)


def split_blocks(values: Array, blocks: int, size: int, axis: int) -> Array:
    """Values with one axis split into blocks of a size, filled up with zeros."""
    missing = blocks * size - values.shape[axis]
    if missing:
        filled = np.zeros((*values.shape[:axis], blocks * size, *values.shape[axis + 1 :]), values.dtype)
        filled[(*[slice(None)] * axis, slice(values.shape[axis]))] = values
        values = filled
    return np.asarray(values.reshape(*values.shape[:axis], blocks, size, *values.shape[axis + 1 :]))


def _lower_triangular_product(lower: Array, rows: Array, out: Array) -> Array:
    """Lower triangular matrices (…, m, m) times rows (…, m, c), a band at a time: what is zero is not multiplied."""
    m = rows.shape[-2]
    for first in range(0, m, BAND_ROWS):
        last = min(first + BAND_ROWS, m)
        np.matmul(lower[..., first:last, :last], rows[..., :last, :], out=out[..., first:last, :])
    return out


@dataclass(frozen=True, slots=True, eq=False)
class RunFilter:
    """inverse (classes, B, s, s) of each block's Cholesky factor; observed (classes, B, s, 3) the walk before it as its
    white rows see it; gain (classes, B, 3, s) the walk after it from its white rows; member (U, R): the class of each
    unit's run; rows of a run; walks: whether anything walks at all, else no block knows of another."""

    inverse: Array
    observed: Array
    gain: Array
    member: NDArray[np.intp]
    rows: int
    walks: bool = True

    @staticmethod
    def of_white_rows(units: int, rows: int) -> "RunFilter":
        """The filter of one run a unit that is white already."""
        eye, nothing = np.eye(rows)[None, None], np.zeros((1, 1, rows, 3))
        return RunFilter(eye, nothing, nothing.swapaxes(-1, -2), np.zeros((units, 1), np.intp), rows)

    def single_precision(self) -> "RunFilter":
        """The same in single precision."""
        inverse, observed, gain = (x.astype(np.float32) for x in (self.inverse, self.observed, self.gain))
        return replace(self, inverse=inverse, observed=observed, gain=gain)

    def of_units(self, units: slice) -> "RunFilter":
        """The filter of some units."""
        return replace(self, member=self.member[units])

    def run_by_run(self) -> "RunFilter":
        """The same with a kind for each run, where they are of several: what whitens many columns one after the other
        gathers the factors once."""
        if len(self.inverse) == 1:
            return self
        every = self.member.ravel()
        inverse, observed, gain = (x[every] for x in (self.inverse, self.observed, self.gain))
        return replace(
            self, inverse=inverse, observed=observed, gain=gain, member=np.arange(every.size).reshape(self.member.shape)
        )

    def whiten(self, rows: Array, out: Array | None = None) -> Array:
        """L⁻¹ times rows (U, R, m, c)."""
        out = np.empty(rows.shape, rows.dtype) if out is None else out
        inverse = self._inverse_of_runs()
        if inverse.shape[-3] == 1:
            return _lower_triangular_product(inverse[..., 0, :, :], rows, out)
        split = self._split(rows)
        if not self.walks and split.shape[2] * split.shape[3] == rows.shape[2]:
            np.matmul(inverse, split, out=out.reshape(split.shape))
            return out
        white = inverse @ split
        if not self.walks:
            return self._joined(white, out)
        observed, gain = self.observed[self.member], self.gain[self.member]
        walk: Array = np.zeros((*white.shape[:2], 3, white.shape[-1]), white.dtype)
        for b in range(1, white.shape[2]):
            walk = walk + gain[:, :, b - 1] @ white[:, :, b - 1]
            white[:, :, b] -= observed[:, :, b] @ walk
        return self._joined(white, out)

    def axis_factors(self, gain: Floats) -> Array:
        """The columns of L⁻¹ that the numbers of each axis meet in each block, times a gain (U, R, V, axes) of them:
        (axes, U, R, B, s, s / axes)."""
        inverse, axes = self._inverse_of_runs(), gain.shape[-1]
        inverse = inverse.reshape(*(inverse.shape[:-3] or (1, 1)), *inverse.shape[-3:])
        of_block = gain.reshape(*gain.shape[:2], inverse.shape[-3], 1, -1, axes)
        return np.ascontiguousarray(np.moveaxis(inverse.reshape(*inverse.shape[:-1], -1, axes) * of_block, -1, 0))

    def transposed(self, rows: Array) -> Array:
        """L⁻ᵀ times rows (U, R, m, c)."""
        back = self._split(rows)
        if back.shape[2] > 1 and self.walks:
            observed, gain = (x[self.member].swapaxes(-1, -2) for x in (self.observed, self.gain))
            back = back.copy()
            walk: Array = np.zeros((*back.shape[:2], 3, back.shape[-1]), back.dtype)
            for b in range(back.shape[2])[::-1]:
                back[:, :, b] += gain[:, :, b] @ walk
                walk = walk - observed[:, :, b] @ back[:, :, b]
        return self._joined(self.inverse.swapaxes(-1, -2)[self.member] @ back)

    def coloured(self, white: Array) -> Array:
        """L times white rows (U, R, m, c)."""
        root, split = np.linalg.inv(self.inverse)[self.member], self._split(white)
        if not self.walks:
            return self._joined(root @ split)
        observed, gain = self.observed[self.member], self.gain[self.member]
        rows = split.copy()
        walk: Array = np.zeros((*rows.shape[:2], 3, rows.shape[-1]), rows.dtype)
        for b in range(1, rows.shape[2]):
            walk = walk + gain[:, :, b - 1] @ split[:, :, b - 1]
            rows[:, :, b] += observed[:, :, b] @ walk
        return self._joined(root @ rows)

    def log_variances(self) -> Array:
        """Logarithms of the innovations' variances (U, R, m), which add up to the log-determinant of a run's floor."""
        logs = -2 * np.log(np.einsum("cbii->cbi", self.inverse)).reshape(len(self.inverse), -1)
        return np.asarray(logs[:, : self.rows][self.member])

    def later_information(self) -> Floats:
        """N (classes, B, 3, 3): the information of all later blocks on the walk after each (de Jong, Biometrika 76
        (1989) 275): N = seenᵀ·observed + (I − gain·observed)ᵀ·N⁺·(I − gain·observed) for the block before."""
        found = np.zeros((*self.inverse.shape[:2], 3, 3))
        if found.shape[1] == 1:
            return found
        if not self.walks:
            # The walk after a block is that before the next one.
            found[:, :-1] = (self.observed.swapaxes(-1, -2) @ self.observed)[:, :0:-1].cumsum(1)[:, ::-1]
            return found
        left = np.eye(3) - self.gain @ self.observed
        for b in range(found.shape[1] - 1)[::-1]:
            observed, after = self.observed[:, b + 1], left[:, b + 1]
            found[:, b] = observed.swapaxes(-1, -2) @ observed + after.swapaxes(-1, -2) @ found[:, b + 1] @ after
        return found

    def precision_roots(self) -> Floats:
        """X (classes, B, s + 3, s) of each block, or (classes, 1, s, s) of a single one, XᵀX being its block on the
        diagonal of V⁻¹."""
        if self.inverse.shape[1] == 1:
            return np.asarray(self.inverse)
        values, vectors = np.linalg.eigh(self.later_information())
        roots = (vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]).swapaxes(-1, -2)
        return np.concatenate([self.inverse, roots @ self.gain @ self.inverse], axis=2)

    def precision_blocks(self, k: int) -> Floats:
        """Blocks (classes, V, k, k) on the diagonal of V⁻¹, k rows a visit."""
        roots = self.precision_roots()
        C, B, rows, s = roots.shape
        by_visit = roots.reshape(C, B, rows, s // k, k).swapaxes(2, 3)
        blocks = by_visit.swapaxes(-1, -2) @ by_visit
        return np.asarray(blocks.reshape(C, -1, k, k)[:, : self.rows // k])

    def _inverse_of_runs(self) -> Array:
        """The factors of each run (U, R, B, s, s), or (B, s, s) where all runs are of one kind: no copy is made of what
        they share, or where each is of its own kind."""
        if len(self.inverse) == 1:
            return np.asarray(self.inverse[0])
        if len(self.inverse) == self.member.size and np.array_equal(self.member.ravel(), np.arange(self.member.size)):
            return np.asarray(self.inverse.reshape(*self.member.shape, *self.inverse.shape[1:]))
        return np.asarray(self.inverse[self.member])

    def _split(self, rows: Array) -> Array:
        blocks, size = self.inverse.shape[1:3]
        return split_blocks(rows, blocks, size, axis=2)

    def _joined(self, blocks: Array, out: Array | None = None) -> Array:
        """Blocks (U, R, B, s, c) as rows (U, R, m, c)."""
        U, R, B, s, c = blocks.shape
        rows = blocks.reshape(U, R, B * s, c)[:, :, : self.rows]
        if out is None:
            return rows
        out[...] = rows
        return out
