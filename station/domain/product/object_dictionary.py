"""The object dictionary of a device as frozen values: what an EDS says, REAL32 limits included (CiA 301, CiA 306)."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

Address = tuple[int, int]
Value = int | float | str | bytes

#: CiA 301 table 44: data type → (name, struct code); no code: as many bytes as there are.
TYPES: Mapping[int, tuple[str, str]] = {
    0x01: ("BOOLEAN", "<?"),
    0x02: ("INT8", "<b"),
    0x03: ("INT16", "<h"),
    0x04: ("INT32", "<i"),
    0x05: ("UINT8", "<B"),
    0x06: ("UINT16", "<H"),
    0x07: ("UINT32", "<I"),
    0x08: ("REAL32", "<f"),
    0x09: ("STRING", ""),
    0x0A: ("OCTETS", ""),
    0x0F: ("DOMAIN", ""),
    0x11: ("REAL64", "<d"),
    0x15: ("INT64", "<q"),
    0x1B: ("UINT64", "<Q"),
}


@dataclass(frozen=True, slots=True)
class ObjectEntry:
    """One variable. type: CiA 301 code; access: ro, wo, rw, rwr, rww or const; low, high: limits or None."""

    index: int
    sub: int
    name: str
    type: int
    access: str
    default: Value
    low: float | None = None
    high: float | None = None
    mappable: bool = False

    @property
    def address(self) -> Address:
        """(index, sub)."""
        return self.index, self.sub

    @property
    def type_name(self) -> str:
        """Type in the words of the device map: REAL32, UINT8, STRING …"""
        return TYPES[self.type][0]

    @property
    def size(self) -> int | None:
        """Bytes of the value; None where they vary."""
        code = TYPES[self.type][1]
        return struct.calcsize(code) if code else None

    @property
    def readable(self) -> bool:
        """Whether SDO may read it."""
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        """Whether SDO may write it."""
        return "w" in self.access

    def pack(self, value: Value) -> bytes:
        """`value` as the bytes of this object."""
        if isinstance(value, str):
            return value.encode("latin-1")
        if isinstance(value, bytes):
            return value
        return struct.pack(TYPES[self.type][1], value)

    def unpack(self, raw: bytes) -> Value:
        """The value of these bytes; struct.error when their count is not the type's."""
        name, code = TYPES[self.type]
        if code:
            (value,) = struct.unpack(code, raw)
            return int(value) if isinstance(value, bool) else value
        return raw.decode("latin-1") if name == "STRING" else raw


@dataclass(frozen=True, slots=True)
class ObjectDictionary:
    """All entries of a device by (index, sub), and the node id for which COB-IDs were worked out."""

    node: int
    entries: Mapping[Address, ObjectEntry] = field(default_factory=dict)

    def __getitem__(self, address: Address) -> ObjectEntry:
        return self.entries[address]

    def __contains__(self, address: object) -> bool:
        return address in self.entries

    def has_index(self, index: int) -> bool:
        """Whether any sub-index of `index` exists."""
        return any(i == index for i, _ in self.entries)
