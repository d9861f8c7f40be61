"""A head's one line is JSON as any reader writes it, and gives the head back."""

import json

from hypothesis import given
from hypothesis import strategies as st

from station.domain.records.head import SCHEMA, SealedHead

NAMES = st.text(st.characters(exclude_categories=["Cs"]))


@given(NAMES, NAMES, st.integers(0, 2**63 - 1), st.binary(min_size=32, max_size=32), st.binary(max_size=64))
def test_a_heads_line_is_json_and_comes_back(log_id: str, station: str, number: int, seal: bytes, by: bytes) -> None:
    head = SealedHead(log_id, station, number, seal.hex(), by.hex())
    fields = {"schema": SCHEMA, "log_id": log_id, "station": station, "number": number, "hash": seal.hex()}
    assert head.line() == json.dumps(fields | ({"signature": by.hex()} if by else {}))
    assert SealedHead.parse(head.line()) == head
