"""Medians of many short rows."""

import numpy as np

from station.domain.core.types import Array, Floats


def medians(rows: Array) -> Floats:
    """Medians (…) of rows (…, n) of finite numbers, n > 0, bit for bit those of `np.median`: a processor sorts a row of
    a hundred twenty times as fast as that parts it."""
    rising, count = np.sort(rows, axis=-1), rows.shape[-1]
    return np.asarray((rising[..., (count - 1) // 2] + rising[..., count // 2]) / 2)
