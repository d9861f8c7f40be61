"""MAT files that hold timetables and tables as MATLAB writes them, made byte by byte: only MATLAB writes such."""

from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np
from scipy import io

from station.domain.core.types import Floats

_INT8, _INT32, _UINT32, _MATRIX = 1, 5, 6, 14
#: Names of classes and properties, numbered from 1.
_NAMES = ("any", "data", "fmt", "datetime", "timetable", "nrows", "varnames", "table")
_ANY, _DATA, _, _DATETIME, _TIMETABLE, _NROWS, _VARNAMES, _TABLE = range(1, 9)
Property = tuple[int, int, int]


def timetables(variables: Mapping[str, tuple[Floats, Mapping[str, Floats]]]) -> bytes:
    """A file of timetables: of each variable the times of its rows, s since 1970, and its columns."""
    cells: list[Any] = []
    objects, saved, plain = [[0] * 6], [_block()], [_block()]
    refs = {}
    for at, (name, (time_s, columns)) in enumerate(variables.items()):
        mine, clock = 2 * at + 1, 2 * at + 2
        plain.append(_block((_DATA, 1, len(cells))))
        saved.append(_block((_ANY, 1, len(cells) + 1)))
        data = np.empty(len(columns), object)
        data[:] = [column[:, None] for column in columns.values()]
        cells += [
            (time_s * 1e3)[:, None],
            {
                "data": data, "dimNames": _texts("Timestamp", "Variables"), "varNames": _texts(*columns),
                "numRows": float(len(time_s)), "numVars": float(len(columns)), "rowTimes": _reference(clock, 1),
            },
        ]  # fmt: skip
        objects += [[2, 0, 0, at + 1, 0, clock], [1, 0, 0, 0, at + 1, clock]]
        refs[name] = ("timetable", _reference(mine, 2))
    return _file(refs, cells, (_DATETIME, _TIMETABLE), objects, saved, plain)


def table(name: str, columns: Mapping[str, Floats]) -> bytes:
    """A file of one table, as older versions of MATLAB keep it: a property each for columns, names and rows."""
    data = np.empty(len(columns), object)
    data[:] = list(columns.values())
    rows = len(next(iter(columns.values())))
    properties = (_DATA, 1, 0), (_VARNAMES, 1, 1), (_NROWS, 1, 2)
    cells = [data, _texts(*columns), float(rows)]
    objects, plain = [[0] * 6, [1, 0, 0, 0, 1, 1]], [_block(), _block(*properties)]
    return _file({name: ("table", _reference(1, 1))}, cells, (_TABLE,), objects, [_block()], plain)


def _texts(*words: str) -> Any:
    cell = np.empty(len(words), object)
    cell[:] = words
    return cell


def _reference(number: int, of_class: int) -> Any:
    return np.array([[0xDD000000], [2], [1], [1], [number], [of_class]], np.uint32)


def _block(*properties: Property) -> list[int]:
    numbers = [len(properties), *(n for p in properties for n in p)]
    return numbers + [0] * (len(numbers) % 2)


def _file(
    refs: Mapping[str, tuple[str, Any]], cells: list[Any], classes: tuple[int, ...],
    objects: list[list[int]], saved: list[list[int]], plain: list[list[int]],
) -> bytes:  # fmt: skip
    named = b"".join(name.encode() + b"\0" for name in _NAMES)
    named += bytes(-len(named) % 8)
    kinds = [[0] * 4, *([0, name, 0, 0] for name in classes)]
    regions = [np.concatenate(rows).astype("<i4").tobytes() for rows in (kinds, saved, objects, plain, [[0, 0]])]
    starts = np.cumsum([40 + len(named), *map(len, regions)]).tolist()
    head = np.array([4, len(_NAMES), *starts, 0, 0][:10], "<i4").tobytes()
    cell = np.empty((len(cells) + 2, 1), object)
    cell[:, 0] = [np.frombuffer(head + named + b"".join(regions), np.uint8)[:, None], np.zeros((0, 0)), *cells]
    inner = BytesIO()
    io.savemat(inner, {"a": cell})
    element = bytearray(inner.getvalue()[128:])
    element[40:48] = _element(_INT8, b"")
    wrapper = _matrix(17, _element(_INT8, b""), _words("MCOS", "FileWrapper__"), bytes(element))
    shape = _element(_INT32, np.array([1, 1], "<i4").tobytes())
    struct = _matrix(2, shape, _element(_INT8, b""), b"\x05\0\x04\0\x05\0\0\0", _element(_INT8, b"MCOS\0"), wrapper)
    workspace = np.frombuffer(b"\0\x01IM\0\0\0\0" + struct, np.uint8)[None, :]
    last = BytesIO()
    io.savemat(last, {"a": workspace})
    hidden = bytearray(last.getvalue()[128:])
    hidden[40:48] = _element(_INT8, b"")
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\x01IM"
    return header + b"".join(_variable(name, *ref) for name, ref in refs.items()) + bytes(hidden)


def _variable(name: str, of_class: str, reference: Any) -> bytes:
    alone = BytesIO()
    io.savemat(alone, {"a": reference})
    value = bytearray(alone.getvalue()[128:])
    value[40:48] = _element(_INT8, b"")
    return _matrix(17, _element(_INT8, name.encode()), _words("MCOS", of_class), bytes(value))


def _words(*words: str) -> bytes:
    return b"".join(_element(_INT8, word.encode()) for word in words)


def _matrix(of_class: int, *parts: bytes) -> bytes:
    return _element(_MATRIX, _element(_UINT32, np.array([of_class, 0], "<u4").tobytes()) + b"".join(parts))


def _element(kind: int, data: bytes) -> bytes:
    return np.array([kind, len(data)], "<u4").tobytes() + data + bytes(-len(data) % 8)
