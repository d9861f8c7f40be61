"""Number formats: every number that fits comes back within half a step, every other one is refused."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.product import number_format

NAMES = ["REAL32", "REAL64", "INT8", "INT16", "INT32", "UINT8", "UINT16", "UINT32", "Q2.14", "Q1.15", "Q0.15"]
NAMES += ["Q3.29", "Q8.24", "Q4.4", "ppm16", "ppm32"]


def span(name: str) -> tuple[float, float]:
    shape = number_format.parse(name)
    if shape.is_float:
        largest = float(np.finfo(np.float32 if name == "REAL32" else np.float64).max)
        return -largest, largest
    bits = 8 * shape.size
    unsigned = name.startswith("UINT")
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return low * shape.step, high * shape.step


@given(name=st.sampled_from(NAMES), part=st.floats(0, 1))
def test_what_fits_comes_back_within_half_a_step(name: str, part: float) -> None:
    shape = number_format.parse(name)
    low, high = span(name)
    value = low * (1 - part) + high * part
    back = shape.decode(shape.encode(value))
    assert abs(back - value) <= shape.spacing(value) * (0.5 + 1e-9)


@given(name=st.sampled_from(NAMES))
def test_what_was_kept_once_is_kept_bit_for_bit(name: str) -> None:
    shape = number_format.parse(name)
    raw = shape.encode(0.3 * span(name)[1])
    assert shape.encode(shape.decode(raw)) == raw


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match="not a finite number"):
        number_format.parse(name).encode(value)


@pytest.mark.parametrize("name", [n for n in NAMES if not n.startswith("REAL")])
def test_beyond_either_end_is_refused_with_the_range(name: str) -> None:
    shape = number_format.parse(name)
    low, high = span(name)
    for beyond in (low - shape.step, high + shape.step):
        with pytest.raises(ValueError, match=f"{name} holds"):
            shape.encode(beyond)
    assert shape.decode(shape.encode(low)) == low
    assert shape.decode(shape.encode(high)) == high


def test_a_real_too_large_for_32_bits_is_refused() -> None:
    with pytest.raises(ValueError, match="REAL32 holds"):
        number_format.parse("REAL32").encode(1e39)


@pytest.mark.parametrize(
    ("name", "value", "raw"),
    [
        ("REAL32", 1.01, struct.pack("<f", 1.01)),
        ("INT16", -3.0, b"\xfd\xff"),
        ("UNSIGNED8", 1.0, b"\x01"),
        ("INTEGER32", 70_000.0, b"\x70\x11\x01\x00"),
        ("Q2.14", 1.0, b"\x00\x40"),  # ARM: two bits before the point, the sign among them
        ("Q1.14", 1.0, b"\x00\x40"),  # Texas Instruments: one bit before the point and the sign
        ("Q2.14", -2.0, b"\x00\x80"),
        ("ppm32", 0.000123, b"\x7b\x00\x00\x00"),
    ],
)
def test_known_bytes(name: str, value: float, raw: bytes) -> None:
    assert number_format.parse(name).encode(value) == raw


@pytest.mark.parametrize("name", ["REAL16", "Q3.3", "Q40.24", "ppm", "int16", "", "Q2,14"])
def test_an_unknown_format_lists_the_known_ones(name: str) -> None:
    with pytest.raises(ValueError, match=r"use BOOLEAN, INT8.*ppm32"):
        number_format.parse(name)


@given(st.floats(-(2.0**127), 2.0**127, width=32))
def test_spacing_of_a_real_is_that_of_its_neighbours(value: float) -> None:
    shape = number_format.parse("REAL32")
    assert shape.spacing(value) == float(np.spacing(np.abs(np.float32(value))))


def test_a_wrong_length_is_refused() -> None:
    with pytest.raises(ValueError, match="REAL32 has 4 bytes, not 2"):
        number_format.parse("REAL32").decode(b"\0\0")
