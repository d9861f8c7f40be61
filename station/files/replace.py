"""A file is replaced whole or not at all: written under another name in its folder, then renamed (rename(2))."""

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: How a database of SQLite begins.
_DATABASE = b"SQLite format 3\0"


@contextmanager
def replacing(path: Path, *, durable: bool = False, mode: int = 0o666) -> Iterator[Path]:
    """A place to write to; the file takes its name when the block ends, and nothing is left when it fails.

    The place bears the file's ending, for writers that go by it. durable: both the content and the name are on the
    disk before this returns. mode: of the new file, less the umask. Errors: OSError.
    """
    check_replaceable(path)
    part = path.with_name(f".{secrets.token_hex(4)}.{path.name}")
    os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode))
    try:
        yield part
        if durable:
            _sync(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    if durable:
        _sync(path.parent)


def check_replaceable(path: Path) -> None:
    """Refuses a place where no file may be written, and one where a device, a pipe or a log is. Errors: OSError."""
    if path.is_dir():  # '.' too, which an empty word on a command line becomes
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not path.parent.is_dir():
        number = errno.ENOTDIR if path.parent.exists() else errno.ENOENT
        raise OSError(number, os.strerror(number), str(path))
    if not path.exists():
        return
    if not path.is_file():  # to be renamed over would end a device such as /dev/null for the whole machine
        raise OSError(errno.ESPIPE, os.strerror(errno.ESPIPE), str(path))
    with path.open("rb") as file:
        if file.read(len(_DATABASE)) == _DATABASE:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))


def replace_text(path: Path, text: str, *, durable: bool = False, mode: int = 0o666) -> None:
    """The file holds this text, in UTF-8, or what it held before. Errors: OSError."""
    with replacing(path, durable=durable, mode=mode) as part:
        part.write_text(text, encoding="utf-8")


def _sync(path: Path) -> None:
    """Waits until a file, or the names in a folder, are on the disk."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
