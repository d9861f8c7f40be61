"""Frame patterns: what they fill in, what they match, what is refused when a product is read."""

import pytest

from station.domain.product.frame_pattern import parse_pattern
from station.errors import InvalidValue

VALUES = {"index": b"\x01\x21", "sub": b"\x03", "node": b"\x11", "value": b"\x78\x56\x34\x12"}


@pytest.mark.parametrize(
    ("pattern", "filled"),
    [
        ("22 index sub value:4", "22 01 21 03 78 56 34 12"),
        ("A1 index> sub node", "a1 21 01 03 11"),
        ("B1 value>:4", "b1 12 34 56 78"),
        ("B1 value:2 ..", "b1 78 56 00"),
        ("C1 73 61 76 65", "c1 73 61 76 65"),
    ],
)
def test_a_pattern_is_filled_in_byte_by_byte(pattern: str, filled: str) -> None:
    values = {**VALUES, "value": VALUES["value"][: parse_pattern(pattern).width("value")]}
    assert parse_pattern(pattern).fill(values).hex(" ") == filled


def test_what_comes_is_taken_apart_and_another_frame_is_not() -> None:
    pattern = parse_pattern("A2 index> sub value>:4")
    assert pattern.match(bytes.fromhex("a2210103 0a0b0c0d")) == {
        "index": b"\x01\x21",
        "sub": b"\x03",
        "value": b"\x0d\x0c\x0b\x0a",
    }
    assert pattern.match(bytes.fromhex("a3210103 0a0b0c0d")) is None
    assert pattern.match(bytes.fromhex("a22101")) is None


@pytest.mark.parametrize("text", ["", "A1 what", "A1 value:9", "A1 index index", "A1 value:4 index sub 00 00", "1"])
def test_a_pattern_that_is_no_frame_is_refused(text: str) -> None:
    with pytest.raises(InvalidValue):
        parse_pattern(text)
