"""A recording read in a process of its own, within limits: asammdf is compiled code, and a damaged file can crash it;
python-can unfolds whatever a BLF holds."""

from collections.abc import Iterator
from pathlib import Path

from station.adapters.bus._recorded import by_python_can
from station.domain.core.types import Frames
from station.domain.records.framepack import plain
from station.errors import LogError
from station.files.limited_process import receive_blocks, send_blocks

_FRAMES = b"F"


def read(path: Path, channel: str | None) -> Iterator[Frames]:
    """Its frames in order, in blocks. Errors: LogError, also when its reader crashes or goes beyond its limits."""
    words = [] if channel is None else [channel]
    for _, data in receive_blocks(run_reader_process, path, *words, error=LogError):
        yield plain.from_bytes(data)


def run_reader_process(path: str, channel: str | None = None) -> None:
    """The other process: reads, and sends its blocks."""
    send_blocks((_FRAMES, plain.to_bytes(frames)) for frames in by_python_can(Path(path), channel))
