"""CAN logs that python-can reads for us (.blf, .asc, .mf4) → Frames, block by block."""

import struct
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from station.domain.core.types import Frames
from station.errors import LogError

#: Frames per block: memory stays flat however long the log is.
BLOCK = 65_536
#: What its readers raise on a file that is none of theirs, cut off or corrupt, beside errors of their own.
_CORRUPT = (ValueError, KeyError, IndexError, EOFError, AttributeError, TypeError, struct.error, zlib.error)


def by_python_can(path: Path, channel: str | None) -> Iterator[Frames]:
    """Frames by python-can's own reader for the ending, in blocks. Errors: LogError."""
    from station.adapters.bus._messages import to_frames

    kind, mode, errors = _reader(path.suffix.lower())
    with path.open(mode) as file:  # opened here: a reader that fails to start leaves its file open
        try:
            with kind(file) as reader:
                messages = (m for m in reader if channel in (None, str(m.channel)))
                while block := list(islice(messages, BLOCK)):
                    yield to_frames(block, [round(m.timestamp * 1e9) for m in block])
        except errors:
            raise LogError("recording-not-readable", file=str(path), kind=path.suffix) from None


def _reader(suffix: str) -> tuple[Any, str, tuple[type[Exception], ...]]:
    """python-can's reader for an ending, how to open its file, and what it raises on a broken one."""
    from station.adapters.bus._python_can import can, mf4  # heavy, and only needed where such a log is read

    if suffix == ".mf4":
        reader = mf4().MF4Reader
        from asammdf.blocks.utils import MdfException

        return reader, "rb", (*_CORRUPT, MdfException)
    if suffix == ".blf":
        return can.BLFReader, "rb", (*_CORRUPT, can.io.blf.BLFParseError)
    return can.ASCReader, "r", _CORRUPT
