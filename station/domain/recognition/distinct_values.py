"""The values that occur in a column of readings."""

import numpy as np

from station.domain.core.types import Floats

#: Places of a grid for each value: beyond them it is faster to sort.
MOST_PLACES = 4


def distinct(values: Floats) -> Floats:
    """The values (n) that occur, each once, rising: what `np.unique` gives.

    What lies on a grid is put in its place on it, which takes a fifth of the time of sorting.
    """
    apart = np.abs(np.diff(values))
    apart = apart[apart > 0]
    if not len(apart):
        return np.unique(values)
    low, step = values.min(), apart.min()
    places = (values.max() - low) / step
    if not places < MOST_PLACES * len(values):
        return np.unique(values)
    place = np.rint((values - low) / step).astype(np.intp)
    at = np.full(int(place.max()) + 1, np.nan)
    at[place] = values
    # Two values in one place lie on no grid of that step.
    return at[~np.isnan(at)] if np.array_equal(at[place], values) else np.unique(values)
