"""The means of visits: one row each."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, SampleTable
from station.model.scene import COVARIATES


def visit_means(table: SampleTable, visit: NDArray[np.intp]) -> SampleTable:
    """One row a visit, with what all of its rows say and the means of its numbers; visit (n) of each row."""
    first = np.unique(visit, return_index=True)[1]
    count = np.bincount(visit)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(visit, values) / count)

    def means(rows: Floats) -> Floats:
        return np.stack([mean(column) for column in rows.T], axis=1)

    return replace(
        table[first],
        time_s=mean(table.time_s),
        reading=means(table.reading),
        values={name: mean(values) for name, values in table.values.items() if name in COVARIATES},
        gold=None if table.gold is None else means(table.gold),
    )
