"""MAT files of version 4, 5, 7 and 7.3 → raw tables: matrices, vectors of one length, and structs of them."""

import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from station.adapters.recordings.limits import MOST_COLUMNS, check_shape
from station.domain.core.types import Array
from station.domain.recognition.raw_table import RawColumn, RawTable
from station.errors import SamplesError
from station.messages import Message

_CORRUPT = (ValueError, TypeError, KeyError, IndexError, EOFError, OSError, OverflowError, zlib.error)
#: How a file of HDF5 begins.
HDF5 = b"\x89HDF"
#: Names of scalars that state the rate.
RATES = ("fs", "rate", "rate_hz", "sample_rate", "samplerate", "sampling_rate", "fsamp", "frequency")


def read(path: Path) -> list[RawTable]:
    """One table for each length of columns in the file, the one of most readings first. Errors: SamplesError."""
    from scipy import io
    from scipy.io.matlab import MatReadError

    file = str(path)
    with path.open("rb") as opened:
        plain_hdf5 = opened.read(4) == HDF5
    try:
        found = (
            _hdf5(path) if plain_hdf5 else io.loadmat(file, squeeze_me=True, struct_as_record=False, mat_dtype=False)
        )
    except NotImplementedError:
        found = _hdf5(path)
    except (*_CORRUPT, MatReadError):
        raise SamplesError("recording-not-parsed", file=file, reason=Message("content-damaged")) from None
    return tables_of(file, {k: v for k, v in found.items() if not k.startswith("__")})


def tables_of(file: str, found: Mapping[str, Any]) -> list[RawTable]:
    """One table for each length of the columns of named arrays. Errors: SamplesError."""
    groups: dict[int, list[RawColumn]] = {}
    rate_hz = None
    for name, value in _leaves(found):
        if value.size == 1 and name.rpartition(".")[2].lower() in RATES:
            rate_hz = float(value.reshape(-1)[0])
        for column in _columns(name, value):
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
        raise SamplesError("recording-not-parsed", file=str(path), reason=Message("content-damaged")) from None
    return found


def _tall(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of a matrix whose longer side is time; of anything else its numbers as rows of one."""
    return (max(shape), min(shape)) if len(shape) == 2 else (int(np.prod(shape)), 1)


def _leaves(values: Mapping[str, Any], depth: int = 0) -> Iterator[tuple[str, Array]]:
    """Numeric arrays by name; the fields of a struct by `struct.field`."""
    for name, value in values.items():
        fields = getattr(value, "_fieldnames", None)
        if fields is not None and depth < 4:
            inner = {f"{name}.{field}": getattr(value, field) for field in fields}
            yield from _leaves(inner, depth + 1)
            continue
        array = np.asarray(value)
        if array.dtype.kind in "iufb" and array.ndim <= 2:
            yield name, array


def _columns(name: str, value: Array) -> Iterator[RawColumn]:
    """A vector as a column; of a matrix its longer side is time."""
    if value.ndim == 1:
        yield RawColumn(name, value)
    elif value.ndim == 2:
        tall = value if value.shape[0] >= value.shape[1] else value.T
        if tall.shape[1] <= MOST_COLUMNS:
            yield from (RawColumn(f"{name}_{i}", np.ascontiguousarray(tall[:, i])) for i in range(tall.shape[1]))
