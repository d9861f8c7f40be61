"""Tables and timetables of MATLAB in a file of version 7: their columns, from the part of it that MATLAB calls its
subsystem and documents nowhere.

The subsystem is a cell: a block of whole numbers first, the values of properties from its third place on. The block
names classes and properties, and says of each object which class it is of and where its properties lie. A variable
holds the number of its object only.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np

from station.domain.core.types import Array

#: What an array that stands for an object begins with, and the place in it of the object's number if there is one.
_REFERENCE, _NUMBER = 0xDD000000, 4
#: What stands before the cell; its text fills two words of eight bytes.
_WRAPPER, _WRAPPER_BYTES = b"FileWrapper__", 16
#: Where the cell's own name stands, which is empty, and a name of one letter that takes its place.
_NAME, _NAMED = slice(40, 48), b"\x01\x00\x01\x00a\x00\x00\x00"
#: Bytes of the header before a version and the order of bytes; of the block before its names.
_HEADER, _VERSION, _BEFORE_NAMES = 124, 4, 40
#: Places of the block's regions: classes, properties saved by a method, objects, properties saved as they are.
_CLASSES, _SAVED, _OBJECTS, _PLAIN, _END = 2, 3, 4, 5, 6
#: The values of properties begin here in the cell.
_FIRST_VALUE = 2
#: What stands before a value: it is a place in the cell, or the value itself.
_PLACE, _ITSELF = 1, 2
_TABLES = ("table", "timetable")


@dataclass(frozen=True, slots=True)
class _Subsystem:
    """cells: values; names: of classes and properties; classes: names by number; objects: (class, place among those
    saved by a method, place among the others) by number; saved, plain: (name, kind, value) of each property."""

    cells: Array
    names: tuple[str, ...]
    classes: tuple[str, ...]
    objects: tuple[tuple[int, int, int], ...]
    saved: tuple[tuple[tuple[int, int, int], ...], ...]
    plain: tuple[tuple[tuple[int, int, int], ...], ...]

    def properties(self, number: int) -> dict[str, Any]:
        """The properties of an object by name; those of tables that a newer MATLAB saves as one struct, too."""
        _, saved, plain = self.objects[number]
        found: dict[str, Any] = {}
        for name, kind, value in self.saved[saved] if saved else self.plain[plain]:
            if kind in (_PLACE, _ITSELF):
                found[self.names[name - 1]] = self.cells[value + _FIRST_VALUE] if kind == _PLACE else value
        whole = found.get("any")
        fields = getattr(whole, "_fieldnames", ())
        return {field: getattr(whole, field) for field in fields} if fields else found


def columns_of_tables(content: bytes) -> dict[str, Array]:
    """Numbers (n) or (n, columns) by `variable.column` of the tables and timetables in a file of version 5 or 7; times
    in s. Nothing where there are none. Errors: ValueError, IndexError, TypeError, KeyError of what is damaged."""
    from scipy.io import loadmat
    from scipy.io.matlab import varmats_from_mat

    variables: dict[str, Any] = {}
    inner = b""
    for name, one in varmats_from_mat(BytesIO(content)):
        if name not in ("None", ""):
            continue
        for value in loadmat(one, squeeze_me=True).values():
            if type(value).__name__ == "MatlabOpaque":
                opaque = value.reshape(-1)[0]
                variables[opaque["s0"].decode()] = opaque["arr"]
            elif isinstance(value, np.ndarray):
                inner = value.tobytes()
    cells = _cells(inner)
    if cells is None:
        return {}
    subsystem = _subsystem(cells)
    return {
        f"{variable}.{column}": numbers
        for variable, value in variables.items()
        if (number := _number(value)) and subsystem.classes[subsystem.objects[number][0]] in _TABLES
        for column, numbers in _columns(subsystem, subsystem.properties(number))
    }


def _cells(inner: bytes) -> Array | None:
    """The cell in a subsystem's bytes; None where there is none."""
    from scipy.io import loadmat

    start = inner.find(_WRAPPER) + _WRAPPER_BYTES
    if start < _WRAPPER_BYTES:
        return None
    cell = bytearray(inner[start : start + 8 + int.from_bytes(inner[start + 4 : start + 8], "little")])
    cell[_NAME] = _NAMED
    file = b"MATLAB".ljust(_HEADER) + inner[:_VERSION] + bytes(cell)
    found = loadmat(BytesIO(file), squeeze_me=True, struct_as_record=False)
    return np.asarray(found["a"])


def _subsystem(cells: Array) -> _Subsystem:
    block = np.asarray(cells[0], np.uint8).tobytes()
    starts = np.frombuffer(block, "<i4", _BEFORE_NAMES // 4).tolist()
    regions = {place: np.frombuffer(block[starts[place] : starts[place + 1]], "<i4") for place in range(_CLASSES, _END)}
    names = block[_BEFORE_NAMES : starts[_CLASSES]].decode("latin1").split("\0")
    classes = regions[_CLASSES].reshape(-1, 4)[:, 1].tolist()
    return _Subsystem(
        cells,
        tuple(names),
        tuple(names[name - 1] if name else "" for name in classes),
        tuple((row[0], row[3], row[4]) for row in regions[_OBJECTS].reshape(-1, 6).tolist()),
        tuple(_blocks(regions[_SAVED].tolist())),
        tuple(_blocks(regions[_PLAIN].tolist())),
    )


def _blocks(numbers: list[int]) -> Iterator[tuple[tuple[int, int, int], ...]]:
    """Properties of each object in turn: their number, three numbers each, filled up to eight bytes; none of the
    first, which stands for no object."""
    at = 0
    while at < len(numbers):
        last = at + 1 + 3 * numbers[at]
        yield tuple((numbers[i], numbers[i + 1], numbers[i + 2]) for i in range(at + 1, last, 3))
        at = last + last % 2


def _number(value: Any) -> int:
    """The number of the object that a value stands for; 0 of what is a value itself."""
    array = np.asarray(value).reshape(-1)
    is_reference = array.dtype == np.uint32 and len(array) > _NUMBER and array[0] == _REFERENCE
    return int(array[_NUMBER]) if is_reference else 0


def _columns(subsystem: _Subsystem, table: Mapping[str, Any]) -> Iterator[tuple[str, Array]]:
    """Columns of numbers and of times; the times of rows first."""
    names = np.atleast_1d(table["varNames"] if "varNames" in table else table["varnames"]).tolist()
    data = table["data"]
    cells = [data] if len(names) == 1 and not _is_cell(data) else np.atleast_1d(data)
    rows = int(table["numRows"] if "numRows" in table else table["nrows"])
    if "rowTimes" in table:
        times = _row_times(subsystem, table["rowTimes"], rows)
        if times is not None:
            yield str(np.atleast_1d(table["dimNames"])[0]), times
    for name, value in zip(names, cells, strict=True):
        number = _number(value)
        column = _seconds(subsystem, number) if number else np.asarray(value)
        if column is not None and column.dtype.kind in "iufb" and column.ndim in (1, 2) and len(column) == rows:
            yield str(name), column


def _is_cell(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == object


def _seconds(subsystem: _Subsystem, number: int) -> Array | None:
    """Times (n) of an object of datetimes or durations, s; None of any other."""
    of = subsystem.properties(number)
    milliseconds = of.get("data", of.get("millis"))
    if milliseconds is None or np.asarray(milliseconds).dtype.kind not in "fc":
        return None
    whole = np.asarray(milliseconds).reshape(-1)
    # What a datetime's milliseconds lack of its full resolution stands in their imaginary part.
    return np.asarray(whole.real / 1e3 + whole.imag / 1e3, float)


def _row_times(subsystem: _Subsystem, value: Any, rows: int) -> Array | None:
    """Times of the rows (n), s: as they are, or of a rate."""
    if number := _number(value):
        return _seconds(subsystem, number)
    rate_hz = np.asarray(getattr(value, "sampleRate", np.nan), float)
    if rate_hz.size == 1 and 0 < float(rate_hz) < np.inf:
        return np.arange(rows) / float(rate_hz)
    step = _number(getattr(value, "stepSize", 0))
    step_s = _seconds(subsystem, step) if step else None
    return None if step_s is None or len(step_s) != 1 else np.arange(rows) * step_s[0]
