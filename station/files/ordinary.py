"""Files at names that others can put something at: a link is not followed, a pipe not waited for, an end is set.

Whoever may write into the folder of a log or of its heads can exchange any name there for a link to another file, for a
pipe that never gives a byte, or for a file of a terabyte without a block on the disk.
"""

import errno
import os
import stat
from pathlib import Path

_SAFE = os.O_CLOEXEC | os.O_NONBLOCK


def read_ordinary(path: Path, most_bytes: int, *, follow: bool = True) -> bytes:
    """What stands in it. follow: it may be a link. Errors: OSError; ValueError where it is no file or longer."""
    handle = os.open(path, os.O_RDONLY | _SAFE | (0 if follow else os.O_NOFOLLOW))
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise ValueError("it is no ordinary file")
        with os.fdopen(handle, "rb", closefd=False) as file:
            data = file.read(most_bytes + 1)
    finally:
        os.close(handle)
    if len(data) > most_bytes:
        raise ValueError(f"it is longer than {most_bytes} bytes")
    return data


def open_ordinary(path: Path, flags: int, mode: int = 0o644) -> int:
    """A handle to write with; with O_TRUNC it is emptied once it is known to be a file. Errors: OSError, also for a
    link, a pipe, or a second name of another file."""
    handle = os.open(path, (flags & ~os.O_TRUNC) | _SAFE | os.O_NOFOLLOW, mode)
    try:
        if not is_alone(os.fstat(handle)):
            raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), str(path))
        if flags & os.O_TRUNC:
            os.ftruncate(handle, 0)
    except OSError:
        os.close(handle)
        raise
    return handle


def is_alone(found: os.stat_result) -> bool:
    """Whether it is an ordinary file of one name."""
    return stat.S_ISREG(found.st_mode) and found.st_nlink == 1
