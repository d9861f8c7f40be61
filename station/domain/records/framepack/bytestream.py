"""Whole numbers and byte strings, one after the other: LEB128 for numbers, a length before each string."""

from dataclasses import dataclass, field

from station.errors import LogError

#: No number of an archive has more.
_MOST_BITS = 70


@dataclass(slots=True)
class ByteWriter:
    """Collects values; `bytes()` gives them all."""

    out: bytearray = field(default_factory=bytearray)

    def count(self, *values: int) -> None:
        """Numbers from 0 on, seven bits a byte."""
        for value in values:
            remaining = value
            while remaining > 0x7F:
                self.out.append(remaining & 0x7F | 0x80)
                remaining >>= 7
            self.out.append(remaining)

    def whole(self, *values: int) -> None:
        """Numbers of either sign."""
        self.count(*(v * 2 if v >= 0 else -v * 2 - 1 for v in values))

    def string(self, data: bytes) -> None:
        """Bytes with their length."""
        self.count(len(data))
        self.out += data

    def __bytes__(self) -> bytes:
        return bytes(self.out)


@dataclass(slots=True)
class ByteReader:
    """Takes values in the order in which they were written. Errors: LogError where the bytes end too early."""

    data: bytes
    at: int = 0

    def count(self) -> int:
        """One number from 0 on."""
        value = shift = 0
        while True:
            byte = self.take(1)[0]
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7
            if shift > _MOST_BITS:
                raise LogError("frames-damaged")

    def whole(self) -> int:
        """One number of either sign."""
        value = self.count()
        return value >> 1 ^ -(value & 1)

    def string(self) -> bytes:
        """Bytes that were written with their length."""
        return self.take(self.count())

    def take(self, size: int) -> bytes:
        """The next `size` bytes."""
        if size > len(self.data) - self.at:
            raise LogError("frames-truncated")
        self.at += size
        return self.data[self.at - size : self.at]
