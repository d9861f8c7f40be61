"""MAT files of version 4, 5, 7 and 7.3 → raw tables: matrices, vectors of one length, structs and tables of them."""

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from station.adapters.recordings import matlab_objects
from station.adapters.recordings.limits import MOST_COLUMNS, check_shape
from station.adapters.recordings.matlab_checksum import without_checksums
from station.domain.core.types import Array
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.errors import SamplesError
from station.messages import Message

_CORRUPT = (ValueError, TypeError, KeyError, IndexError, EOFError, OSError, OverflowError)
#: What scipy calls every variable that holds an object.
OBJECT = "None"
#: How a file of HDF5 begins.
HDF5 = b"\x89HDF"
#: Names of scalars that state the rate.
RATES = ("fs", "rate", "rate_hz", "sample_rate", "samplerate", "sampling_rate", "fsamp", "frequency")


def read(path: Path) -> list[RawTable]:
    """One table for each length of columns in the file, the one of most readings first. Errors: SamplesError."""
    file = str(path)
    with path.open("rb") as opened:
        plain_hdf5 = opened.read(4) == HDF5
    try:
        found = _hdf5(path) if plain_hdf5 else _loaded(path)
    except NotImplementedError:
        found = _hdf5(path)
    except zlib.error:
        return _without_checksums(path)
    if OBJECT in found:
        found |= _columns_of_objects(path)
    return tables_of(file, {k: v for k, v in found.items() if not k.startswith("__")})


def _columns_of_objects(path: Path) -> dict[str, Array]:
    """Columns of MATLAB's tables by `variable.column`; none where what holds them is not as known."""
    from scipy.io.matlab import MatReadError

    try:
        return matlab_objects.columns_of_tables(path.read_bytes())
    except (*_CORRUPT, MatReadError, zlib.error):
        return {}


def _loaded(source: Path | BytesIO, file: str = "") -> dict[str, Any]:
    """Everything in a file of version 4 or 5. Errors: SamplesError; zlib.error, NotImplementedError (version 7.3)."""
    from scipy import io
    from scipy.io.matlab import MatReadError

    try:
        what = str(source) if isinstance(source, Path) else source
        return dict(io.loadmat(what, squeeze_me=True, struct_as_record=False, mat_dtype=False))
    except (NotImplementedError, zlib.error):
        raise
    except (*_CORRUPT, MatReadError):
        raise _damaged(file or str(source)) from None


def _damaged(file: str) -> SamplesError:
    return SamplesError("recording-not-parsed", file=file, reason=Message("content-damaged"))


def _without_checksums(path: Path) -> list[RawTable]:
    """The tables of a file whose writer computes no checksum right, with the remark that nothing vouches for it."""
    file, content = str(path), without_checksums(path.read_bytes())
    if content is None:
        raise _damaged(file)
    found = _loaded(BytesIO(content), file)
    tables = tables_of(file, {k: v for k, v in found.items() if not k.startswith("__")})
    return [replace(table, remarks=(*table.remarks, Message("checksums-wrong", file=file))) for table in tables]


def tables_of(file: str, found: Mapping[str, Any]) -> list[RawTable]:
    """One table for each length of the columns of named arrays. Errors: SamplesError."""
    groups: dict[int, list[RawColumn]] = {}
    rate_hz = None
    for name, value, names in _leaves(found):
        if value.size == 1 and name.rpartition(".")[2].lower() in RATES:
            rate_hz = float(value.reshape(-1)[0])
        for column in _columns(name, value, names):
            assert column.values is not None
            groups.setdefault(len(column.values), []).append(column)
    tables = [
        RawTable(file, tuple(columns[: MOST_COLUMNS + 1]), rate_hz=rate_hz)
        for rows, columns in sorted(groups.items(), key=lambda g: -g[0] * len(g[1]))
        if rows > 8
    ]
    if not tables:
        objects = any(type(value).__name__ == "MatlabOpaque" for value in found.values())
        raise SamplesError("mat-of-objects" if objects else "no-table-of-numbers", file=file)
    for table in tables:
        check_shape(file, len(table), len(table.columns))
    return tables


def _hdf5(path: Path) -> dict[str, Any]:
    """The numeric datasets of a file of version 7.3, which is HDF5 and lies transposed; groups are structs."""
    try:
        import h5py
    except ImportError:
        raise SamplesError("mat-version-7-3", file=str(path)) from None
    found: dict[str, Any] = {}

    def keep(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iufb" and not name.startswith("#"):
            check_shape(str(path), *_tall(item.shape))
            found[name.replace("/", ".")] = np.squeeze(item[()].T)

    try:
        with h5py.File(path, "r") as file:
            file.visititems(keep)
    except _CORRUPT:
        raise _damaged(str(path)) from None
    return found


def _tall(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of a matrix whose longer side is time; of anything else its numbers as rows of one."""
    return (max(shape), min(shape)) if len(shape) == 2 else (int(np.prod(shape)), 1)


def _leaves(values: Mapping[str, Any], depth: int = 0) -> Iterator[tuple[str, Array, list[str] | None]]:
    """Numeric arrays by name, with the names of their columns where a cell of text beside them states those; the
    fields of a struct by `struct.field`."""
    cells = {name: text for name, value in values.items() if (text := _text(value)) is not None}
    for name, value in values.items():
        fields = getattr(value, "_fieldnames", None)
        if fields is not None and depth < 4:
            inner = {f"{name}.{field}": getattr(value, field) for field in fields}
            yield from _leaves(inner, depth + 1)
            continue
        array = np.asarray(value)
        if array.dtype.kind in "iufb" and array.ndim <= 2:
            yield name, array, _names_of(name, array, cells)


def _text(value: Any) -> list[str] | None:
    """The words of a cell of text, all different; None of anything else."""
    array = np.asarray(value)
    words = array.tolist() if array.dtype.kind in "OU" and array.ndim == 1 else []
    if not all(isinstance(word, str) and word for word in words) or len(set(words)) < max(len(words), 2):
        return None
    return words


def _names_of(name: str, value: Array, cells: Mapping[str, list[str]]) -> list[str] | None:
    """A word a column of a matrix: of the cell that is called after it, as in `IMU_label`, else of the only cell of
    that length, as in `colheaders`."""
    if value.ndim != 2:
        return None
    fitting = {cell: words for cell, words in cells.items() if len(words) == min(value.shape)}
    called = [words for cell, words in fitting.items() if cell.startswith(name)]
    return called[0] if called else next(iter(fitting.values())) if len(fitting) == 1 else None


def _columns(name: str, value: Array, names: list[str] | None) -> Iterator[RawColumn]:
    """A vector as a column; of a matrix its longer side is time."""
    if value.ndim == 1:
        yield RawColumn(name, value)
    elif value.ndim == 2:
        tall = value if value.shape[0] >= value.shape[1] else value.T
        called = [f"{name}.{n}" for n in names] if names else [f"{name}_{i}" for i in range(tall.shape[1])]
        if tall.shape[1] <= MOST_COLUMNS:
            yield from (RawColumn(n, np.ascontiguousarray(tall[:, i])) for i, n in enumerate(called))
