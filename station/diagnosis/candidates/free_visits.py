"""Candidates of many visits that no readings could confirm or contradict: some leave every visit free, or every few of
them, and fit whatever is read; some move nothing that is kept of a reading."""

import numpy as np

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.data.residuals import ResidualView

#: Visits above which such a candidate is left out at once. Of fewer it is known by its eigenvalues, whose cost grows
#: with the cube of the visits.
MOST_FREE_VISITS = 64
#: What moves a reading by a smaller share of what it moves the sensor is rounding.
ROUNDING = 1e-9


def says_nothing(candidate: Candidate, view: ResidualView) -> bool:
    """Whether the groups of many visits are so small that each may fit anything, or nothing at all."""
    code, k = candidate.code, view.grid.k
    if len(code) <= MOST_FREE_VISITS or candidate.pattern == "scan" or candidate.moving:
        return False
    if len(candidate.names) * candidate.axes < len(code) * k:
        return False
    _, group, many = np.unique(code, return_inverse=True, return_counts=True)
    if many.max() * k > candidate.axes:
        return False
    columns = candidate.columns.retained(view.keep)
    if np.abs(columns).max() <= ROUNDING * np.abs(candidate.columns.still).max():
        return True
    in_order, sizes = np.argsort(group, kind="stable"), np.repeat(many, many)
    # Visits of groups of one size, group by group.
    parts = (columns[in_order[sizes == size]].reshape(-1, size * k, candidate.axes) for size in np.unique(many))
    return all(bool(np.all(np.linalg.matrix_rank(part) == part.shape[1])) for part in parts)
