"""Records on the wire: what was sealed comes out again, bit for bit, and what is no portion is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.records import wire
from station.domain.records.chain import Value, canonical
from station.domain.records.tables import TABLES, row_of
from station.domain.records.wire import WireRecord

OF_TYPE: dict[type, st.SearchStrategy[Value]] = {
    int: st.integers(-(2**63), 2**63 - 1),
    float: st.floats(allow_nan=False),
    str: st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"])),
    bytes: st.binary(max_size=40),
}


@st.composite
def rows(draw: st.DrawFn) -> tuple[str, tuple[Value, ...]]:
    table = draw(st.sampled_from(sorted(TABLES)))
    values = [
        draw(OF_TYPE[column.type] if column.required else st.none() | OF_TYPE[column.type]) for column in TABLES[table]
    ]
    return table, tuple(values)


@given(rows())
def test_every_row_survives_the_way(row: tuple[str, tuple[Value, ...]]) -> None:
    table, values = row
    body = canonical(table, [c.name for c in TABLES[table]], values)
    name, found = wire.parse(body)
    again = row_of(name, found)
    assert (name, again) == (table, values)
    assert again is not None
    assert canonical(name, [c.name for c in TABLES[name]], again) == body


RECORDS = st.builds(
    WireRecord,
    st.integers(1, 2**63),
    st.binary(min_size=32, max_size=32),
    st.sampled_from([b"", bytes(range(64))]),
    st.binary(max_size=200),
)


@given(st.lists(RECORDS, max_size=5), st.integers(0, 2000))
def test_a_portion_is_whole_or_refused(records: list[WireRecord], cut: int) -> None:
    data = wire.encode(records)
    assert wire.decode(data) == records
    ends = [len(wire.encode(records[:n])) for n in range(len(records) + 1)]
    if cut < len(data) and cut not in ends:
        with pytest.raises(ValueError, match=r"cut off|another schema"):
            wire.decode(data[:cut])


@given(st.binary(max_size=300))
def test_anything_else_is_a_value_error_at_worst(data: bytes) -> None:
    try:
        table, values = wire.parse(data)
    except ValueError:
        return
    assert isinstance(table, str)
    assert all(isinstance(name, str) for name in values)


@pytest.mark.parametrize(
    ("table", "values"),
    [
        ("shadow", {"attempt": 1}),
        ("finish", {"attempt": 1, "outcome": "PASS"}),
        ("finish", {"attempt": 1, "outcome": "PASS", "ended_ns": 1, "colour": "red"}),
        ("finish", {"outcome": "PASS", "attempt": 1, "ended_ns": 1}),
        ("finish", {"attempt": "1", "outcome": "PASS", "ended_ns": 1}),
        ("finish", {"attempt": 1, "outcome": "PA\0SS", "ended_ns": 1}),
        ("finish", {"attempt": 1, "outcome": "PASS", "ended_ns": 2**63}),
    ],
)
def test_a_form_that_this_version_does_not_know_is_no_row(table: str, values: dict[str, Value]) -> None:
    assert row_of(table, values) is None
