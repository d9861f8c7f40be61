"""The samples of a table, held whole or gone through some units at a time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from station.domain.core.joined_tables import join
from station.domain.core.types import SampleTable
from station.domain.evaluation.unit_dwells import UnitDwells, reduce_table
from station.domain.recipe.recipe import Recipe


@dataclass(frozen=True, slots=True, eq=False)
class SampleSource:
    """rows: how many samples; units: their serials; portions: whole units of the table, sorted by unit, run and visit,
    a new pass at each call; reduced: the dwells of each unit, None where they were not reduced on the way."""

    rows: int
    units: tuple[str, ...]
    portions: Callable[[], Iterator[SampleTable]]
    reduced: tuple[UnitDwells, ...] | None = None

    @staticmethod
    def of(table: SampleTable) -> "SampleSource":
        """Those of a table that is held whole."""
        return SampleSource(len(table), table.unit.names, lambda: iter([table]))

    @property
    def table(self) -> SampleTable:
        """All of them at once."""
        return join(list(self.portions()))

    def dwells(self, recipe: Recipe) -> list[UnitDwells]:
        """The dwells of each unit, as a calibration takes them. Errors: SamplesError."""
        if self.reduced is not None:
            return list(self.reduced)
        return [unit for table in self.portions() for unit in reduce_table(table, recipe)]
