"""A table that nobody has made for this station: named columns of numbers or text, and what was asked about them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats, Labels
from station.messages import Message


@dataclass(frozen=True, slots=True, eq=False)
class RawColumn:
    """One column. values (n): numbers as they stand in the file, integers kept; text: its labels, where it is text;
    unit: what the header says of its unit, '' where nothing."""

    name: str
    values: Array | None
    text: Labels | None = None
    unit: str = ""

    def __getitem__(self, rows: NDArray[np.intp]) -> "RawColumn":
        values = None if self.values is None else self.values[rows]
        return replace(self, values=values, text=None if self.text is None else self.text[rows])


@dataclass(frozen=True, slots=True, eq=False)
class RawTable:
    """Columns of one length. source: the file as a person names it; named: whether the names are the file's own;
    rate_hz: where the file states one; remarks: what the reader left out."""

    source: str
    columns: tuple[RawColumn, ...]
    named: bool = True
    rate_hz: float | None = None
    remarks: tuple[Message, ...] = ()

    def __len__(self) -> int:
        first = self.columns[0]
        return len(first.values if first.values is not None else first.text.code if first.text is not None else ())

    def __getitem__(self, rows: NDArray[np.intp]) -> "RawTable":
        return replace(self, columns=tuple(column[rows] for column in self.columns))

    def numeric(self) -> list[int]:
        """Places of the columns that hold numbers."""
        return [i for i, column in enumerate(self.columns) if column.values is not None]

    def numbers(self, place: int) -> Floats:
        """A column (n) as floats."""
        values = self.columns[place].values
        assert values is not None
        return np.asarray(values, float)


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What a person states instead of having it recognised; None: recognised.

    columns: [time,] x, y, z by name or number from 0; unit: of the readings; rate_hz: readings a second where no
    column is time; blocks: readings of a visit; labels: the column whose changes begin a visit; find_labels: whether
    one is looked for; zero, scale: reading = (raw − zero) · scale.
    """

    columns: tuple[str, ...] | None = None
    time_unit: str | None = None
    rate_hz: float | None = None
    temperature: str | None = None
    labels: str | None = None
    find_labels: bool = True
    blocks: int | None = None
    unit: str | None = None
    zero: float | None = None
    scale: float | None = None
