"""A reader in a process of its own, within limits of memory, processor time and file size.

Compiled readers trust what a file says of itself: a few damaged or hostile bytes make them fill the memory, count for
ever or crash. In a child with limits of the operating system (setrlimit(2)) that ends the child, and its parent says so
in one sentence. What was read comes through a pipe, block by block.
"""

import json
import os
import resource
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from station.errors import StationError
from station.messages import Message

#: What comes through the pipe: kind and size, then that many bytes.
_HEAD = struct.Struct("<cQ")
_MESSAGE, _END, _NO_MEMORY = b"M", b".", b"!"
#: Data of the child: of a file of ten megabytes and less, and for each byte of a larger one.
LEAST_MEMORY, MEMORY_A_BYTE = 800 << 20, 12
#: Its processor time, its start included.
LEAST_S, SECONDS_A_MEGABYTE = 7, 0.8
_CODE = (
    "import sys; sys.path[:] = {path!r}; "
    "from station.files.limited_process import enter; enter({memory}, {seconds}); "
    "from {module} import {name} as run; run(*sys.argv[1:])"
)
#: One block: its kind and its bytes.
Block = tuple[bytes, bytes | bytearray]


def receive_blocks(
    reader: Callable[..., None], path: Path, *words: str, error: type[StationError]
) -> Iterator[tuple[bytes, bytearray]]:
    """What a module's function `reader` sends by `send_blocks` out of a process of its own that reads `path`.

    Errors: `error`: the reader's own message; or that it crashed, or needed more memory or time than any file of this
    size is worth.
    """
    size = path.stat().st_size
    memory = max(LEAST_MEMORY, MEMORY_A_BYTE * size)
    seconds = max(LEAST_S, int(SECONDS_A_MEGABYTE * size / 1e6))
    code = _CODE.format(
        path=sys.path, memory=memory, seconds=seconds, module=reader.__module__, name=reader.__qualname__
    )
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}  # each thread of it reserves memory
    quiet = subprocess.DEVNULL  # what a library says beside our sentence helps nobody
    with subprocess.Popen(
        [sys.executable, "-P", "-c", code, str(path), *words],
        stdin=quiet,
        stdout=subprocess.PIPE,
        stderr=quiet,
        env=environment,
    ) as child:
        try:
            if child.stdout is not None and not (yield from _received(child.stdout, path, error, memory)):
                raise error(_broken_off(child.wait(), path, seconds))
        finally:
            child.kill()


def send_blocks(blocks: Iterable[Block]) -> None:
    """In the child: writes the blocks, or a message, to what was its standard output; nothing else gets there."""
    with os.fdopen(os.dup(1), "wb") as pipe:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        kind, last = _END, b""
        try:
            for block in blocks:
                _write(pipe, *block)
        except StationError as error:
            kind, last = _MESSAGE, json.dumps(error.message.document()).encode()
        except MemoryError:
            kind = _NO_MEMORY
        _write(pipe, kind, last)


def enter(memory: int, seconds: int) -> None:
    """In the child, before anything is loaded: from here on the limits hold."""
    _limit(resource.RLIMIT_DATA, memory)
    _limit(resource.RLIMIT_FSIZE, memory)
    _limit(resource.RLIMIT_CPU, seconds)
    _limit(resource.RLIMIT_CORE, 0)


@contextmanager
def memory_ceiling(path: Path, most: int, error: type[StationError]) -> Iterator[None]:
    """Inside, this process gets so many bytes beyond what it has: for a reader that is not worth a process of its own.

    The limit is that of all threads. Errors: `error` where it does not suffice.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    present = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    if soft == resource.RLIM_INFINITY or present + most < soft:
        resource.setrlimit(resource.RLIMIT_DATA, (present + most, hard))
    try:
        yield
    except MemoryError:
        raise error("reader-out-of-memory", file=str(path), limit_mb=most / 1e6) from None
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _limit(kind: int, value: int) -> None:
    hard = resource.getrlimit(kind)[1]
    value = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(kind, (value, value))


def _received(
    pipe: IO[bytes], path: Path, error: type[StationError], memory: int
) -> Generator[tuple[bytes, bytearray], None, bool]:
    """The blocks; True at their end, False where the pipe broke off."""
    while True:
        head = pipe.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return False
        kind, size = _HEAD.unpack(head)
        if kind == _END:
            return True
        if kind == _NO_MEMORY:
            raise error("reader-out-of-memory", file=str(path), limit_mb=memory / 1e6)
        data = bytearray(size)
        if pipe.readinto(data) != size:  # type: ignore[attr-defined]  # a BufferedReader, which reads all there is
            return False
        if kind == _MESSAGE:
            raise error(Message.of(json.loads(data)))
        yield kind, data


def _broken_off(code: int, path: Path, seconds: int) -> Message:
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return Message("reader-out-of-time", file=str(path), limit_s=seconds)
    return Message("recording-crashes-reader", file=str(path))


def _write(pipe: IO[bytes], kind: bytes, data: bytes | bytearray) -> None:
    pipe.write(_HEAD.pack(kind, len(data)))
    pipe.write(data)
