"""The samples of a table, held whole or gone through some units at a time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from station.domain.core.joined_tables import join
from station.domain.core.types import SampleTable


@dataclass(frozen=True, slots=True, eq=False)
class SampleSource:
    """rows: how many samples; units: their serials; portions: whole units of the table, sorted by unit, run and visit,
    a new pass at each call."""

    rows: int
    units: tuple[str, ...]
    portions: Callable[[], Iterator[SampleTable]]

    @staticmethod
    def of(table: SampleTable) -> "SampleSource":
        """Those of a table that is held whole."""
        return SampleSource(len(table), table.unit.names, lambda: iter([table]))

    @property
    def table(self) -> SampleTable:
        """All of them at once."""
        return join(list(self.portions()))
