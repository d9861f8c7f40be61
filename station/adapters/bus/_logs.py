"""CAN logs of any kind → Frames, block by block, and back."""

from collections.abc import Callable, Iterator
from pathlib import Path

from station.adapters.bus import _candump, _limited
from station.adapters.bus._recorded import BLOCK, by_python_can
from station.domain.core.types import Frames
from station.errors import LogError, UsageError
from station.messages import Message, system_reason

#: What python-can reads for us; each keeps times to about 0.25 µs.
READ_BY_PYTHON_CAN = (".blf", ".asc", ".mf4")
#: No larger file needs no limits: DEFLATE packs 1032 : 1 at most (zlib technical details), so it unfolds to 64 MB.
SMALL_BYTES = 64 << 10


def read_blocks(path: Path, channel: str | None = None) -> Iterator[Frames]:
    """Frames of a .log (candump), .blf, .asc or .mf4 in order, in blocks; `channel`: of this one only.

    Errors: LogError names the file, where known the line, and the remedy.
    """
    suffix = path.suffix.lower()
    if suffix not in (".log", *READ_BY_PYTHON_CAN):
        raise LogError("recording-kind-unknown", file=str(path))
    if path.is_dir():
        raise LogError("recording-no-access", file=str(path), why=Message("system-is-folder"))
    if not path.is_file():
        raise LogError("recording-missing", file=str(path))
    try:
        yield from _blocks(path, suffix, channel)
    except OSError as error:
        raise LogError("recording-no-access", file=str(path), why=system_reason(error)) from None
    except OverflowError:
        raise LogError("recording-impossible-frame", file=str(path)) from None


def _blocks(path: Path, suffix: str, channel: str | None) -> Iterator[Frames]:
    if suffix == ".log":
        return _candump.read(path, channel, BLOCK)
    if suffix == ".mf4" or path.stat().st_size > SMALL_BYTES:
        return _limited.read(path, channel)
    return by_python_can(path, channel)


def read_log(path: Path, channel: str | None = None) -> Frames:
    """A whole log at once; LogError when there is no frame in it."""
    frames = Frames.join(list(read_blocks(path, channel)))
    if not len(frames):
        if channel is None:
            raise LogError("recording-without-frames", file=str(path))
        raise LogError("recording-without-channel", file=str(path), channel=channel)
    return frames


def write_log(path: Path, frames: Frames, channel: str = "can0") -> None:
    """Writes frames as a candump log (.log) or BLF (.blf), by the file's ending; UsageError for any other."""
    writers: dict[str, Callable[[Path, Frames, str], None]] = {".log": _candump.write, ".blf": _write_blf}
    if path.suffix.lower() not in writers:
        raise UsageError("recording-ending", file=str(path))
    try:
        writers[path.suffix.lower()](path, frames, channel)
    except OSError as error:
        raise UsageError("recording-not-written", file=str(path), why=system_reason(error)) from None


def _write_blf(path: Path, frames: Frames, channel: str) -> None:
    from station.adapters.bus._messages import to_message
    from station.adapters.bus._python_can import can

    columns = frames.time_ns.tolist(), frames.can_id.tolist(), frames.length.tolist(), frames.data
    with can.BLFWriter(path) as writer:
        if len(frames):
            writer.log_event(channel, int(frames.time_ns[0]) / 1e9)
        for time_ns, can_id, length, data in zip(*columns, strict=True):
            writer.on_message_received(to_message(can_id, data[:length].tobytes(), time_ns / 1e9, length))
