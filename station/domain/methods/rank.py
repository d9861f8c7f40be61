"""Which columns of a design its rows cannot tell apart."""

from collections.abc import Sequence

import numpy as np

from station.domain.core.types import Floats

#: Singular values of the column-scaled design below this share of the largest count as zero.
EXACT_TOLERANCE = 1e-6
#: The same where directions are read off noisy means instead of being planned.
NOISY_TOLERANCE = 1e-3
#: A column this much shorter than the longest holds nothing but rounding.
NEGLIGIBLE_LENGTH = 1e-12
#: A column takes part in an undetermined combination when it makes up more than this share of it.
MIN_SHARE = 1e-3


def spectrum(rows: Floats) -> tuple[Floats, Floats]:
    """Singular values (k), falling, of rows (r, k) with columns scaled to length 1, and right vectors (k, k)."""
    length = np.linalg.norm(rows, axis=0)
    padded = np.zeros((max(rows.shape), rows.shape[1]))
    # A column of rounding errors is a column of zeros.
    some = length > NEGLIGIBLE_LENGTH * length.max(initial=0.0)
    padded[: len(rows)] = np.where(some, rows / np.where(some, length, 1.0), 0.0)
    _, values, vectors = np.linalg.svd(padded, full_matrices=False)
    return values, vectors


def of(rows: Floats, tolerance: float = EXACT_TOLERANCE) -> int:
    """Rank of rows (r, k)."""
    values, _ = spectrum(rows)
    return int((values > tolerance * max(values[0], 1e-300)).sum())


def undetermined(rows: Floats, names: Sequence[str], tolerance: float = EXACT_TOLERANCE) -> tuple[str, ...]:
    """Names of the columns that take part in what the rows (r, k) leave open, each once."""
    values, vectors = spectrum(rows)
    null = vectors[values <= tolerance * max(values[0], 1e-300)]
    share = (null**2).sum(axis=0)
    return tuple(dict.fromkeys(n for n, s in zip(names, share, strict=True) if s > MIN_SHARE))


def condition(rows: Floats) -> float:
    """Largest over smallest singular value of the column-scaled rows; infinite when a combination is open."""
    values, _ = spectrum(rows)
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")
