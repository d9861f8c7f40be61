"""A file by what is in it → raw tables, within limits of size."""

import errno
from pathlib import Path

from station.adapters.recordings import limited, other_programs, text
from station.adapters.recordings.limits import MOST_BYTES
from station.domain.recognition.raw_table import RawTable
from station.errors import SamplesError
from station.messages import system_reason


def read_tables(path: Path) -> list[RawTable]:
    """The tables of a file, one for each time base; none of an MF4 that holds CAN frames. Errors: SamplesError."""
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, "", str(path))
        if not path.is_file():
            raise OSError(errno.ESPIPE, "", str(path))
        if size > MOST_BYTES:
            raise SamplesError("recording-too-large", file=str(path), size_mb=size / 1e6, limit_mb=MOST_BYTES / 1e6)
        with path.open("rb") as file:
            head = file.read(256)
        return _read(path, head)
    except FileNotFoundError:
        raise SamplesError("recording-not-found", file=str(path)) from None
    except OSError as error:
        raise SamplesError("recording-unreadable", file=str(path), reason=system_reason(error)) from None


def _read(path: Path, head: bytes) -> list[RawTable]:
    if not head:
        raise SamplesError("recording-empty", file=str(path))
    if head.startswith(b"PAR1"):
        return limited.read(path, "parquet")
    if head.startswith((b"MDF  ", b"UnFinMF ", b"MDF")):
        return limited.read(path, "mf4")
    if head.startswith(b"\x93NUMPY") or (path.suffix.lower() == ".npz" and head.startswith(b"PK")):
        return limited.read(path, "arrays")
    if head.startswith((b"MATLAB", b"\x89HDF")) or (path.suffix.lower() == ".mat" and b"\0" in head):
        return limited.read(path, "matlab")
    other_programs.check(path, head)
    return text.read(path)
