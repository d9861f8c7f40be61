"""Sets of columns of a bank, side by side."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.columns import CauseColumns
from station.domain.core.types import Array, Floats


class BankColumns(NamedTuple):
    """Columns of the bank: those of one group, the group (v) of each visit within its unit, and where they stand."""

    columns: CauseColumns
    code: NDArray[np.int32]
    at: slice

    @property
    def groups(self) -> int:
        """How many groups they are split into."""
        return int(self.at.stop - self.at.start) // self.columns.count


def places(made: Sequence[BankColumns]) -> Array | slice:
    """Where sets of columns stand, as a slice where they stand side by side."""
    beside = all(a.at.stop == b.at.start for a, b in pairwise(made))
    return slice(made[0].at.start, made[-1].at.stop) if beside else np.concatenate([np.r_[m.at] for m in made])


def scattered(made: Sequence[BankColumns], parts: Sequence[Array], visits: slice) -> Floats:
    """Columns (s, n, a) of each set as (s, n, C), those of each visit in the place of its group."""
    ends = np.cumsum([0, *(m.at.stop - m.at.start for m in made)]).tolist()
    out = np.zeros((*parts[0].shape[:2], ends[-1]))
    row = np.arange(len(out))
    for m, columns, first, last in zip(made, parts, ends, ends[1:], strict=False):
        whole = out[..., first:last]
        if whole.shape[-1] == m.columns.count:
            # One group: its columns are whole.
            whole[...] = columns
            continue
        by_group = whole.reshape(*out.shape[:2], -1, m.columns.count)
        by_group[row, :, m.code[visits]] = columns
    return out
