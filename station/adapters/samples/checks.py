"""What may be wrong in the cells of a samples table, each as a message with file, row and column."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from station.adapters.samples.columns import INTEGER_COLUMNS, TEXT_COLUMNS
from station.domain.core.types import Array, SampleTable
from station.errors import SamplesError
from station.messages import Message

#: A run or visit beyond this is a slip of the pen.
LARGEST = 1_000_000
#: Rows of a piece from which on it must hold more than two of most of its units.
FLEET = 10_000
#: Characters of a name: of a unit, a position, a lot, a person.
LONGEST_TEXT = 200
#: Frames overtake each other now and then; more of them than this, and rows are out of order.
BACKWARDS = 0.1


@dataclass(frozen=True, slots=True)
class PieceOrigin:
    """Where a piece of a table comes from: its file, and how many rows came before."""

    path: Path
    before: int

    def of(self, row: int) -> Message:
        """A row as a person finds it: a line of a CSV (the header is line 1), a row of a Parquet file."""
        at, file = self.before + int(row), str(self.path)
        if self.path.suffix.lower() == ".csv":
            return Message("samples-line", file=file, line=at + 2)
        return Message("samples-row", file=file, row=at + 1)


def check_cells(table: SampleTable, place: PieceOrigin) -> SampleTable:
    """The table with run and visit as int32, or SamplesError."""
    for i, axis in enumerate("xyz"):
        _finite(table.reading[:, i], axis, place)
    _finite(table.time_s, "time_s", place)
    if table.gold is not None:
        for i, axis in enumerate("xyz"):
            _finite(table.gold[:, i], f"gold_{axis}", place)
    if len(table) >= FLEET and 2 * len(table.unit.names) > len(table):
        raise SamplesError("samples-units-without-rows", file=str(place.path), units=len(table.unit.names))
    for name, column in (("unit", table.unit), ("position", table.position)):
        for empty in np.flatnonzero([not n.strip() for n in column.names]):
            row = int(np.flatnonzero(column.code == empty)[0])
            raise SamplesError("samples-cell-empty", place=place.of(row), column=name)
    for name, column in (("unit", table.unit), ("position", table.position), *table.labels.items()):
        for long in np.flatnonzero([len(n) > LONGEST_TEXT for n in column.names]):
            row = int(np.flatnonzero(column.code == long)[0])
            raise SamplesError("samples-text-too-long", place=place.of(row), column=name, limit=LONGEST_TEXT)
    _rising(table, place)
    return SampleTable(
        unit=table.unit,
        run=_count(table.run, "run", place),
        visit=_count(table.visit, "visit", place),
        position=table.position,
        time_s=table.time_s,
        reading=table.reading,
        labels=table.labels,
        values=table.values,
        gold=table.gold,
    )


def _finite(column: Array, name: str, place: PieceOrigin) -> None:
    wrong = np.flatnonzero(~np.isfinite(column))
    if len(wrong):
        row = int(wrong[0])
        if np.isnan(column[row]):
            raise SamplesError("samples-cell-empty", place=place.of(row), column=name)
        raise SamplesError("samples-not-finite", place=place.of(row), column=name, value=float(column[row]))


def _count(column: Array, name: str, place: PieceOrigin) -> Array:
    """Whole numbers from 0; a missing one came as NaN."""
    wrong = np.flatnonzero(~((column >= 0) & (column <= LARGEST)))
    if len(wrong):
        row = int(wrong[0])
        value = float(column[row])
        raise SamplesError("samples-not-a-count", place=place.of(row), column=name, value=value, limit=LARGEST)
    return column.astype(np.int32)


def _rising(table: SampleTable, place: PieceOrigin) -> None:
    """Time goes on within a visit, but for frames that overtake each other."""
    same = (np.diff(table.unit.code) == 0) & (np.diff(table.run) == 0) & (np.diff(table.visit) == 0)
    back = same & (np.diff(table.time_s) < 0)
    if back.sum() > max(BACKWARDS * same.sum(), 2):
        row = int(np.flatnonzero(back)[0]) + 1
        time_s, before_s = float(table.time_s[row]), float(table.time_s[row - 1])
        count = int(back.sum())
        raise SamplesError("samples-time-back", place=place.of(row), time_s=time_s, before_s=before_s, count=count)


def explain_csv(path: Path, wanted: list[str], refusal: Exception) -> Message:
    """Why the fast reader refused a CSV: the slow one looks for the first wrong cell."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.reader(file)
        try:
            header = [name.strip() for name in next(reader)]
            found = next(
                filter(None, (_wrong_cell(path, reader.line_num, header, row, wanted) for row in reader)), None
            )
        except csv.Error:
            return Message("samples-line-not-csv", file=str(path), line=reader.line_num + 1)
    return found or Message("samples-no-csv", file=str(path), why=" ".join(str(refusal).split())[:120])


def _wrong_cell(path: Path, line: int, header: list[str], row: list[str], wanted: list[str]) -> Message | None:
    """What is wrong with a row, if anything."""
    place = Message("samples-line", file=str(path), line=line)
    if row and len(row) != len(header):
        return Message("samples-cells-in-row", place=place, cells=len(row), columns=len(header))
    for name, cell in zip(header, row, strict=False):
        if name in wanted and not _reads(name, cell):
            id_ = "samples-not-whole" if name in INTEGER_COLUMNS else "samples-not-number"
            return Message(id_, place=place, column=name, cell=cell[:40])
    return None


def _reads(name: str, cell: str) -> bool:
    if name in TEXT_COLUMNS:
        return True
    try:
        value = float(cell) if cell.strip() else 0.0
    except ValueError:
        return False
    return name not in INTEGER_COLUMNS or value.is_integer()
