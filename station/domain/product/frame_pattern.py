"""Frames of a vendor's protocol as patterns, `22 index sub value:4`: filled in to send, matched with what comes."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from station.errors import InvalidValue

#: Widths of the fields that have one width alone.
_WIDTHS = {"index": 2, "index>": 2, "sub": 1, "node": 1}
_FIELD = re.compile(r"^(value|code)(>?):([1-8])$")
LONGEST = 8


@dataclass(frozen=True, slots=True)
class PatternField:
    """Some bytes of a pattern. name: of what fills them, '' for fixed bytes; big_endian: turned round on the wire.

    fixed: the bytes themselves; None with an empty name: any.
    """

    width: int
    name: str = ""
    big_endian: bool = False
    fixed: bytes | None = None


@dataclass(frozen=True, slots=True)
class FramePattern:
    """The payload of one frame."""

    fields: tuple[PatternField, ...]

    @property
    def length(self) -> int:
        """Bytes of the payload."""
        return sum(field.width for field in self.fields)

    def width(self, name: str) -> int:
        """Bytes of a field; 0 where the pattern has none of that name."""
        return next((field.width for field in self.fields if field.name == name), 0)

    def fill(self, values: Mapping[str, bytes]) -> bytes:
        """The payload with these values, little-endian; shorter ones are filled up with zeros, missing ones are 0."""
        parts = []
        for field in self.fields:
            raw = (values.get(field.name, b"") if field.name else field.fixed or b"").ljust(field.width, b"\0")
            parts.append(raw[::-1] if field.big_endian else raw)
        return b"".join(parts)

    def match(self, data: bytes) -> Mapping[str, bytes] | None:
        """The values that a payload holds, little-endian; None when it is another frame. Longer payloads fit."""
        if len(data) < self.length:
            return None
        found: dict[str, bytes] = {}
        at = 0
        for field in self.fields:
            raw = data[at : at + field.width]
            at += field.width
            if field.fixed is not None and raw != field.fixed:
                return None
            if field.name:
                found[field.name] = raw[::-1] if field.big_endian else raw
        return found


def parse_pattern(text: str) -> FramePattern:
    """A pattern from its text: bytes in hexadecimal, `index`, `sub`, `node`, `value:N`, `code:N`, `..` for any byte.

    `>` behind a name, before the colon, turns it round: `index>`, `value>:4`. Errors: InvalidValue.
    """
    fields = tuple(_field(text, word) for word in text.split())
    pattern = FramePattern(fields)
    names = [field.name for field in fields if field.name]
    if not 0 < pattern.length <= LONGEST or len(set(names)) < len(names):
        raise InvalidValue("pattern-not-a-frame", pattern=text, longest=LONGEST)
    return pattern


def _field(text: str, word: str) -> PatternField:
    if word == "..":
        return PatternField(1)
    if re.fullmatch("[0-9A-Fa-f]{2}", word):
        return PatternField(1, fixed=bytes.fromhex(word))
    if word in _WIDTHS:
        return PatternField(_WIDTHS[word], word.rstrip(">"), word.endswith(">"))
    if (sized := _FIELD.match(word)) is not None:
        return PatternField(int(sized[3]), sized[1], bool(sized[2]))
    raise InvalidValue("pattern-word-unknown", pattern=text, word=word)
