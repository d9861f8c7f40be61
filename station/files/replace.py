"""A file is replaced whole or not at all: written under another name in its folder, then renamed (rename(2))."""

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path, *, durable: bool = False, mode: int = 0o666) -> Iterator[Path]:
    """A place to write to; the file takes its name when the block ends, and nothing is left when it fails.

    The place bears the file's ending, for writers that go by it. durable: both the content and the name are on the
    disk before this returns. mode: of the new file, less the umask. Errors: OSError.
    """
    if path.is_dir():  # '.' too, which an empty word on a command line becomes
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
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
