"""Candidates of very many visits that no readings could tell from nothing: some leave each visit free and follow
whatever is read, some move nothing that is kept of a reading."""

import numpy as np

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.data.residuals import ResidualView

#: Visits above which such a candidate is left out at once. Of fewer it is known by its eigenvalues, whose cost grows
#: with the cube of the visits.
MOST_FREE_VISITS = 256
#: What moves a reading by a smaller share of what it moves the sensor is rounding.
ROUNDING = 1e-9


def says_nothing(candidate: Candidate, view: ResidualView) -> bool:
    """Whether each of the visits, which are many, is a group of its own that may read anything, or nothing at all."""
    visits = len(candidate.code)
    if not MOST_FREE_VISITS < visits <= len(candidate.names) or candidate.pattern == "scan" or candidate.moving:
        return False
    if len(np.unique(candidate.code)) < visits:
        return False
    columns = candidate.columns.retained(view.keep)
    if np.abs(columns).max() <= ROUNDING * np.abs(candidate.columns.still).max():
        return True
    return bool(np.all(np.linalg.matrix_rank(columns) == view.grid.k))
