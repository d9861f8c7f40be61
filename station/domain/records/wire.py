"""Sealed records on their way to another machine: number, seal, signature and the very bytes that were sealed.

A portion is one line `station.records/1` and then, for each record, number (u64), length of its bytes (u32), length of
its signature (u8, 0 or 64), seal (32 bytes), signature and bytes, integers big-endian. Nothing is encoded anew on the
way, so what is checked is what the station sealed, and a record of a later version can be checked by one that cannot
read it.
"""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from station.domain.records.chain import Value

SCHEMA = "station.records/1"
_FIRST_LINE = SCHEMA.encode() + b"\n"
_HEAD = struct.Struct(">QIB32s")
_SIGNATURE_BYTES = 64
_DOUBLE = struct.Struct(">d")


@dataclass(frozen=True, slots=True)
class WireRecord:
    """One sealed record. body: its canonical bytes (chain.canonical); signature: b"" where it has none."""

    number: int
    hash: bytes
    signature: bytes
    body: bytes

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return _HEAD.size + len(self.signature) + len(self.body)


def encode(records: Iterable[WireRecord]) -> bytes:
    """A portion of records."""
    parts = [_FIRST_LINE]
    for r in records:
        parts += _HEAD.pack(r.number, len(r.body), len(r.signature), r.hash), r.signature, r.body
    return b"".join(parts)


def decode(data: bytes) -> list[WireRecord]:
    """The records of a portion. Errors: ValueError for what is no portion, or not a whole one."""
    if not data.startswith(_FIRST_LINE):
        raise ValueError("another schema")
    return list(_records(data, len(_FIRST_LINE)))


def _records(data: bytes, at: int) -> Iterator[WireRecord]:
    while at < len(data):
        if at + _HEAD.size > len(data):
            raise ValueError("cut off")
        number, body, signature, seal = _HEAD.unpack_from(data, at)
        start = at + _HEAD.size + signature
        at = start + body
        if signature not in (0, _SIGNATURE_BYTES) or at > len(data):
            raise ValueError("cut off")
        yield WireRecord(number, seal, data[start - signature : start], data[start:at])


def parse(body: bytes) -> tuple[str, dict[str, Value]]:
    """Table and values by name of a record's canonical bytes, in their order. Errors: ValueError."""
    at = body.index(b":")
    start, at = at + 1, at + 1 + int(body[:at])
    table, values = body[start:at].decode(), dict[str, Value]()
    while at < len(body):
        equals = body.index(b"=", at)
        colon = body.index(b":", equals)
        name, end = body[at:equals].decode(), colon + 1 + int(body[equals + 2 : colon])
        value = body[colon + 1 : end]
        if len(value) != end - colon - 1 or name in values:
            raise ValueError("cut off")
        values[name] = _decoded(body[equals + 1], value)
        at = end
    return table, values


def _decoded(tag: int, value: bytes) -> Value:
    if tag == _INTEGER:
        return int(value)
    if tag == _TEXT:
        return value.decode()
    if tag == _BYTES:
        return value
    if tag == _FLOAT and len(value) == _DOUBLE.size:
        return float(_DOUBLE.unpack(value)[0])
    raise ValueError("unknown type")


_INTEGER, _TEXT, _BYTES, _FLOAT = b"isbf"
