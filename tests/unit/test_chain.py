"""The chain of hashes: every edit breaks it, and the one edited record is the one that is named."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.records import chain
from station.domain.records.chain import ChainVerifier, IntegrityFinding, SealedRecord

START = chain.genesis("a-log")
VALUES = st.one_of(st.none(), st.integers(), st.floats(allow_nan=False), st.text(), st.binary())


def records(n: int) -> list[SealedRecord]:
    made, previous = [], START
    for number in range(1, n + 1):
        body = chain.canonical("event", ("attempt", "detail"), (number, f"what {number}"))
        made.append(SealedRecord(number, "event", previous, chain.link(previous, body), body))
        previous = made[-1].hash
    return made


def findings(found: list[SealedRecord], anchors: dict[int, bytes] | None = None) -> list[IntegrityFinding]:
    return list(ChainVerifier(START, anchors or {}).run(found))


def test_a_whole_chain_has_no_findings_and_ends_at_its_head() -> None:
    walk = ChainVerifier(START, {3: records(5)[2].hash})
    assert list(walk.run(records(5))) == []
    assert (walk.number, walk.hash) == (5, records(5)[4].hash)
    assert list(chain.check_tail(5, {5: b""})) == []


def test_the_seal_of_the_first_records_is_pinned() -> None:
    assert START.hex() == "d8b856e9cee966372bbfa7e69f8a7aa08fe145823ae26b8f65cca4d1592f5b73"
    body = chain.canonical("event", ("attempt", "detail", "gone"), (1, "é", None))
    assert body == b"5:eventattempt=i1:1detail=s2:\xc3\xa9"


@given(st.lists(st.tuples(VALUES, VALUES), min_size=2, max_size=2, unique_by=lambda p: tuple(map(repr, p))))
def test_two_different_records_never_give_the_same_bytes(two: list[tuple[chain.Value, chain.Value]]) -> None:
    first, second = (chain.canonical("t", ("a", "b"), values) for values in two)
    assert first != second


@pytest.mark.parametrize("at", range(6))
def test_an_edited_record_is_named_and_no_other(at: int) -> None:
    for field, value in (("body", b"else"), ("hash", b"\0" * 32), ("previous", b"\1" * 32)):
        changed, edit = records(6), dict[str, Any]({field: value})
        changed[at] = replace(changed[at], **edit)
        assert [(f.what, f.number) for f in findings(changed)] == [("edited", at + 1)]


@pytest.mark.parametrize("at", range(5))
def test_a_deleted_record_is_named(at: int) -> None:
    changed = records(6)
    del changed[at]
    assert [(f.what, f.number) for f in findings(changed)] == [("deleted", at + 1)]


def test_records_cut_off_at_the_end_show_against_an_anchor() -> None:
    anchors = {6: records(6)[5].hash}
    assert findings(records(4), anchors) == []
    assert [f.number for f in chain.check_tail(4, anchors)] == [5]


def test_a_swap_names_both_places() -> None:
    changed = records(6)
    changed[1], changed[3] = replace(changed[3], number=2), replace(changed[1], number=4)
    assert {2, 4} <= {f.number for f in findings(changed)}


def test_an_inserted_record_shows_by_its_number_or_by_its_neighbour() -> None:
    copy = records(6)
    assert [f.what for f in findings([*copy[:3], replace(copy[4], number=3), *copy[3:]])] == ["inserted"]
    shifted = [*copy[:3], copy[4], *(replace(r, number=r.number + 1) for r in copy[3:])]
    shifted[3] = replace(shifted[3], number=4)
    assert "reordered" in {f.what for f in findings(shifted)}


def test_a_chain_rebuilt_from_an_edit_on_shows_against_an_anchor() -> None:
    forged = records(3)
    previous = forged[1].hash
    for number in range(3, 7):
        body = b"forged %d" % number
        forged[number - 1 :] = [SealedRecord(number, "event", previous, chain.link(previous, body), body)]
        previous = forged[-1].hash
    assert findings(forged) == []
    assert [(f.what, f.number) for f in findings(forged, {6: records(6)[5].hash})] == [("replaced", 6)]


def test_after_the_first_signature_every_record_needs_a_right_one() -> None:
    made = records(5)
    signed = [made[0], *(replace(r, signature=b"s" + r.hash) for r in made[1:])]
    verify = lambda _, signature, seal: signature == b"s" + seal  # noqa: E731
    assert list(ChainVerifier(START, verify=verify).run(signed)) == []
    lost = [*signed[:3], replace(signed[3], signature=None), signed[4]]
    assert [(f.what, f.number) for f in ChainVerifier(START, verify=verify).run(lost)] == [("unsigned", 4)]
    assert [(f.what, f.number) for f in ChainVerifier(START).run(signed)] == [("forged", n) for n in range(2, 6)]
    wrong = [*signed[:3], replace(signed[3], signature=b"x"), signed[4]]
    assert [(f.what, f.number) for f in ChainVerifier(START, verify=verify).run(wrong)] == [("forged", 4)]
