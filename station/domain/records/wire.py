"""Sealed records on their way to another machine: number, seal, signature and the very bytes that were sealed.

A portion is one line `station.records/1` and then, for each record, number (u64), length of its bytes (u32), length of
its signature (u8, 0 or 64), seal (32 bytes), signature and bytes, integers big-endian. Nothing is encoded anew on the
way, so what is checked is what the station sealed, and a record of a later version can be checked by one that cannot
read it.
"""

import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from station.domain.records.chain import Value

SCHEMA = "station.records/1"
_FIRST_LINE = SCHEMA.encode() + b"\n"
_HEAD = struct.Struct(">QIB32s")
_SIGNATURE_BYTES = 64
_DOUBLE = struct.Struct(">d")
#: Name, type and length of a value (chain.canonical).
_FIELD = re.compile(rb"([^=]*)=([isbf])(0|[1-9]\d*):")


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
    at, size, field = body.index(b":"), len(body), _FIELD.match
    start, at = at + 1, at + 1 + _whole(body[:at])
    table, values = body[start:at].decode(), dict[str, Value]()
    while at < size:
        if (found := field(body, at)) is None:
            raise ValueError("no field")
        key, kind, length = found.groups()
        name, start = key.decode(), found.end()
        at = start + int(length)
        if at > size or name in values:
            raise ValueError("cut off")
        values[name] = _DECODERS[kind](body[start:at])
    return table, values


def _whole(digits: bytes) -> int:
    """A number as it is sealed: no other digits mean it, so that nothing but the sealed bytes gives them again."""
    number = int(digits)
    if b"%d" % number != digits:
        raise ValueError("not as it is sealed")
    return number


def _as_is(value: bytes) -> bytes:
    return value


def _float(value: bytes) -> float:
    try:
        return float(_DOUBLE.unpack(value)[0])
    except struct.error as error:
        raise ValueError("no double") from error


_DECODERS: Mapping[bytes, Callable[[bytes], Value]] = {b"i": _whole, b"s": bytes.decode, b"b": _as_is, b"f": _float}
