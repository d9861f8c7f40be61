"""BLF files made to fill memory: a container of a few megabytes that unfolds to gigabytes is refused before it is read.

python-can unfolds each container whole. Writers fill them with 128 KiB or little more; DEFLATE packs at most 1032 : 1,
so only containers above MOST_CONTAINER / 1032 need a look (RFC 1951; zlib technical details).
"""

import struct
import zlib
from pathlib import Path
from typing import IO

MOST_CONTAINER = 64 << 20
_SMALL = MOST_CONTAINER // 1032
_OBJECT = struct.Struct("<4sHHLL")
_CONTAINER = struct.Struct("<H6xL4x")
_FILE = struct.Struct("<4sL")
_DEFLATE = 2


def unfolds_too_far(path: Path) -> bool:
    """Whether any container is larger than MOST_CONTAINER when unfolded. What is no BLF is left to the reader."""
    with path.open("rb") as file:
        signature, header_bytes = _FILE.unpack(file.read(_FILE.size).ljust(_FILE.size, b"\0"))
        if signature != b"LOGG":
            return False
        file.seek(header_bytes)
        while (size := _next_container(file)) is not None:
            begins = file.tell()
            if size > _SMALL and _too_large(file, size):
                return True
            file.seek(begins + size + (size + _OBJECT.size) % 4)  # padded as by its length
    return False


def _next_container(file: IO[bytes]) -> int | None:
    """Reads one object's head; how many bytes follow it, None at the end or where it is no object."""
    head = file.read(_OBJECT.size)
    if len(head) < _OBJECT.size:
        return None
    signature, _, _, size, _ = _OBJECT.unpack(head)
    return size - _OBJECT.size if signature == b"LOBJ" and size >= _OBJECT.size else None


def _too_large(file: IO[bytes], size: int) -> bool:
    """Whether the object that follows unfolds beyond the limit."""
    data = file.read(size)
    if len(data) < _CONTAINER.size or _CONTAINER.unpack_from(data)[0] != _DEFLATE:
        return False
    unpacker = zlib.decompressobj()
    try:
        return len(unpacker.decompress(data[_CONTAINER.size :], MOST_CONTAINER + 1)) > MOST_CONTAINER
    except zlib.error:
        return False
