"""MAT files of version 5 whose writer put a wrong checksum behind everything it compressed."""

import struct
import zlib

#: Length of the header of a MAT file of version 5, and its mark of the byte order at the end of it.
HEADER, LITTLE = 128, b"IM"
#: Type of an element that holds another one, compressed by zlib.
COMPRESSED = 15


def without_checksums(content: bytes) -> bytes | None:
    """The same file, nothing compressed, where every checksum in it is wrong and every stream is whole: some writers
    never compute it right, and others than this reader do not look. None where it is damaged in another way; a file of
    which one element alone fails its checksum is damaged."""
    order = "<" if content[HEADER - 2 : HEADER] == LITTLE else ">"
    parts, place = [content[:HEADER]], HEADER
    while place + 8 <= len(content):
        kind, size = struct.unpack(order + "II", content[place : place + 8])
        element, place = content[place + 8 : place + 8 + size], place + 8 + size
        inner = _inflated(element) if kind == COMPRESSED and len(element) == size else None
        if inner is None:
            return None
        parts.append(inner)
    return b"".join(parts) if len(parts) > 1 else None


def _inflated(element: bytes) -> bytes | None:
    """What a zlib stream holds, where it is whole and its checksum, the last four bytes, is wrong."""
    stream = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        inner = stream.decompress(element[2:])
    except zlib.error:
        return None
    wrong = zlib.adler32(inner) != int.from_bytes(element[-4:], "big")
    return inner if stream.eof and len(stream.unused_data) == 4 and wrong else None
