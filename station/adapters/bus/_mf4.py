"""An MF4 recording, read in a process of its own: asammdf is compiled code, and a damaged file can crash it."""

import json
import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from station.domain.core.types import Frames
from station.domain.records.framepack import plain
from station.errors import LogError
from station.messages import Message

#: What comes through the pipe: kind and size, then that many bytes.
_HEAD = struct.Struct("<cQ")
_FRAMES, _MESSAGE, _END = b"F", b"M", b"."
#: What the other process does; it finds the station where this one did.
_CODE = (
    "import sys; sys.path[:] = {path!r}; "
    "from station.adapters.bus._mf4 import run_reader_process as run; run(*sys.argv[1:])"
)


def read(path: Path, channel: str | None) -> Iterator[Frames]:
    """Its frames in order, in blocks. Errors: LogError, also when its reader crashes."""
    command = [sys.executable, "-c", _CODE.format(path=sys.path), str(path), *([] if channel is None else [channel])]
    quiet = subprocess.DEVNULL  # what asammdf says beside our sentence helps nobody
    with subprocess.Popen(command, stdin=quiet, stdout=subprocess.PIPE, stderr=quiet) as reader:
        try:
            if reader.stdout is not None:
                yield from _received_blocks(reader.stdout, path)
        finally:
            reader.kill()


def _received_blocks(pipe: IO[bytes], path: Path) -> Iterator[Frames]:
    while True:
        head = pipe.read(_HEAD.size)
        kind, size = _HEAD.unpack(head) if len(head) == _HEAD.size else (b"", 0)
        data = pipe.read(size)
        if kind == _END:
            return
        if kind == _MESSAGE:
            raise LogError(Message.of(json.loads(data)))
        if kind != _FRAMES or len(data) != size:
            raise LogError("recording-crashes-reader", file=str(path))
        yield plain.from_bytes(data)


def run_reader_process(path: str, channel: str | None = None) -> None:
    """The other process: reads, and writes blocks, a message, or the end to what was its standard output."""
    from station.adapters.bus._recorded import by_python_can

    with os.fdopen(os.dup(1), "wb") as pipe:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        kind, last = _END, b""
        try:
            for frames in by_python_can(Path(path), channel):
                _write(pipe, _FRAMES, plain.to_bytes(frames))
        except LogError as error:
            kind, last = _MESSAGE, json.dumps(error.message.document()).encode()
        _write(pipe, kind, last)


def _write(pipe: IO[bytes], kind: bytes, data: bytes) -> None:
    pipe.write(_HEAD.pack(kind, len(data)) + data)
