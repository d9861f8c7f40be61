"""What a record keeps as JSON: the same values back, bit for bit, whatever kind of object they came in."""

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.records import plain_json

TEXT = st.text(st.characters(exclude_categories=["Cs"]))
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXT,
    lambda inner: st.lists(inner) | st.dictionaries(TEXT, inner),
)


class Sort(StrEnum):
    """A kind of text."""

    PASS = "PASS"


@dataclass(frozen=True)
class Reading:
    """A value of our own."""

    z: float
    axis: str


def as_kept(value: Any) -> Any:
    """The value with floats as their bits, and null for those that JSON does not know."""
    if isinstance(value, float):
        return struct.pack(">d", value) if math.isfinite(value) else None
    if isinstance(value, list):
        return [as_kept(v) for v in value]
    return {k: as_kept(v) for k, v in value.items()} if isinstance(value, dict) else value


@given(VALUES)
def test_every_value_comes_back_bit_for_bit(value: Any) -> None:
    assert as_kept(json.loads(plain_json.document(value))) == as_kept(value)


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(-(2**53), 2**53))
def test_numpy_scalars_and_arrays_are_kept_like_their_plain_values(real: float, whole: int) -> None:
    array = np.array([[real, 0.0], [1.0, real]])
    plain = {"a": array.tolist(), "f": real, "n": whole, "yes": True}
    assert plain_json.document({"n": np.int64(whole), "f": np.float64(real), "a": array, "yes": np.True_}) == (
        plain_json.document(plain)
    )


@given(st.dictionaries(TEXT, st.integers(-5, 5)))
def test_keys_are_sorted_and_nothing_is_padded(value: Mapping[str, int]) -> None:
    made = plain_json.document(value)
    assert list(json.loads(made)) == sorted(value)
    assert made == json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        ({"mean": [math.nan, math.inf, -0.0]}, '{"mean":[null,null,-0.0]}'),
        ({"serial": "SN\udcff"}, '{"serial":"SN\\\\udcff"}'),
        ({"raw": 2**64}, '{"raw":18446744073709551616}'),
        ({"raw": 2**64, "mean": math.nan}, '{"mean":null,"raw":18446744073709551616}'),
        ({7: "seven"}, '{"7":"seven"}'),
        ({"frame": b"\x01\xff"}, '{"frame":"01ff"}'),
        ({"outcome": Sort.PASS}, '{"outcome":"PASS"}'),
        ({"at": (1, 2), "one": Reading(1.5, "x")}, '{"at":[1,2],"one":{"axis":"x","z":1.5}}'),
    ],
)
def test_what_json_does_not_know_is_kept_in_plain_form(value: Any, kept: str) -> None:
    assert plain_json.document(value) == kept


@pytest.mark.parametrize("value", [datetime(2026, 1, 1, tzinfo=UTC), object(), 1j])
def test_what_has_no_plain_form_is_refused(value: Any) -> None:
    with pytest.raises(TypeError, match="the log cannot keep a"):
        plain_json.document({"value": value})
