"""The space of very many units, made some units at a time and not kept: rows, bases and all."""

import numpy as np

from station.diagnosis.linear.evidence import DataSets
from station.diagnosis.linear.projection import (
    DataColumns,
    FloorCovariance,
    NuisanceColumns,
    ResidualSpace,
    SpaceSize,
    residual_space,
)


class PartedSpace:
    """`count` readings (one column) under a floor, beside known columns of which the units share none: what is summed
    over units is summed while they are gone through, each of them once."""

    def __init__(self, covariance: FloorCovariance, known: NuisanceColumns, readings: DataColumns, count: int) -> None:
        assert known.shared.visit.shape[-1] == 0
        self._covariance, self._known, self._readings = covariance, known, readings
        self._logdet, self._dof, self._squares = covariance.logdet, count, 0.0

    def part(self, units: slice) -> ResidualSpace:
        """The space of some units, which come in their order."""
        space = residual_space(
            self._covariance.of_units(units), self._known.of_units(units), self._readings.of_units(units), 0
        )
        self._logdet += space.logdet
        self._dof += space.dof
        self._squares += float(np.sum(space.data**2))
        return space

    def data_sets(self) -> DataSets:
        """The readings of all units, once they were gone through."""
        return DataSets(SpaceSize(self._logdet, self._dof, 1), np.array([self._squares]), np.zeros((1, 0)))
