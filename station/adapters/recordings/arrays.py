"""Files of NumPy arrays, `.npy` and `.npz` → raw tables."""

import zipfile
from pathlib import Path

import numpy as np

from station.adapters.recordings import matlab
from station.adapters.recordings.limits import check_unfolded
from station.domain.core.types import Array
from station.domain.recognition.raw_table import RawTable
from station.errors import SamplesError
from station.messages import Message

_CORRUPT = (ValueError, TypeError, KeyError, EOFError, OSError, OverflowError, zipfile.BadZipFile, NotImplementedError)


def read(path: Path) -> list[RawTable]:
    """One table for each length of columns, as of a MAT file; objects, which would be code, are left out.
    Errors: SamplesError."""
    try:
        found = _arrays(path)
    except _CORRUPT:
        raise SamplesError("recording-not-parsed", file=str(path), reason=Message("content-damaged")) from None
    return matlab.tables_of(str(path), found)


def _arrays(path: Path) -> dict[str, Array]:
    if not zipfile.is_zipfile(path):
        whole = np.load(path, allow_pickle=False)
        return _fields("column", whole)
    with zipfile.ZipFile(path) as archive:
        check_unfolded(str(path), path.stat().st_size, sum(i.file_size for i in archive.infolist()))
    with np.load(path, allow_pickle=False) as file:
        found: dict[str, Array] = {}
        for name in file.files:
            found.update(_fields(name, file[name]))
        return found


def _fields(name: str, value: Array) -> dict[str, Array]:
    """A plain array, or the fields of records."""
    if value.dtype.names is None:
        return {name: np.squeeze(value)}
    return {field: np.squeeze(value[field]) for field in value.dtype.names}
