"""Records that bear the right key's signature and were written by no station: their form is what is checked."""

from collections.abc import Callable

import pytest

from station.adapters.postgres.signatures import verify
from station.domain.product import product_record
from station.domain.records.arrival import Arrival, Tip
from station.domain.records.chain import canonical, link
from station.domain.records.key_schedule import KEY_EVENT, REVOKED_EVENT
from station.domain.records.tables import COLUMNS
from station.domain.records.wire import WireRecord
from tests.fakes.plant import FakeStation

NewStation = Callable[..., FakeStation]

EVENT = canonical("event", COLUMNS["event"], (None, 5, "x", "{}"))
#: Other bytes that a careless reader takes for the same values: the seal holds, and no walk would ever give them again.
OTHERWISE = {
    "plus": EVENT.replace(b"i1:5", b"i2:+5"),
    "underscore": EVENT.replace(b"i1:5", b"i3:1_0"),
    "blank": EVENT.replace(b"i1:5", b"i2: 5"),
    "leading zero": EVENT.replace(b"i1:5", b"i2:05"),
    "minus zero": EVENT.replace(b"i1:5", b"i2:-0"),
    "long length": EVENT.replace(b"kind=s1:", b"kind=s01:"),
    "long first length": b"0" + EVENT,
    "signed first length": b"+" + EVENT,
}


DEEP = "[" * 200_000


@pytest.mark.parametrize("case", OTHERWISE)
def test_signed_bytes_that_no_station_seals_are_not_taken(new_station: NewStation, case: str) -> None:
    station = new_station(units=1)
    last = station.records()[-1]
    refused, _ = arrived(station, last, sealed(station, last, OTHERWISE[case]))
    assert refused == "newer-schema"


@pytest.mark.parametrize("kind", [KEY_EVENT, REVOKED_EVENT])
@pytest.mark.parametrize(
    "detail", ["[" * 200_000, '{"a":' * 100_000, "[]", '{"public_key": "00", "beyond": 1e999}', "{"]
)
def test_a_change_of_key_that_says_nothing_changes_none(new_station: NewStation, kind: str, detail: str) -> None:
    station = new_station(units=1)
    last = station.records()[-1]
    refused, tip = arrived(
        station, last, sealed(station, last, canonical("event", COLUMNS["event"], (None, 1, kind, detail)))
    )
    assert (refused, tip.key, tip.revoked) == (None, station.registered.public_key, {})


def arrived(station: FakeStation, last: WireRecord, record: WireRecord) -> tuple[str | None, Tip]:
    """Why the record that follows the last one is refused, and how far the log then is."""
    key = station.registered.public_key
    arrival = Arrival(Tip(station.log_id(), station.name, key, last.number, last.hash, last.signature), verify)
    arrival.take([record])
    return str(arrival.refusal.reason) if arrival.refusal else None, arrival.tip


@pytest.mark.parametrize("text", [DEEP, '{"product": {"name": ["x"]}}', '{"product": {"name": "\\ud800"}}', "5"])
def test_a_product_that_says_no_name_has_none(text: str) -> None:
    assert product_record.name_in(text) == ""


def sealed(station: FakeStation, after: WireRecord, body: bytes) -> WireRecord:
    """A further record of the log, signed by its key."""
    seal = link(after.hash, body)
    return WireRecord(after.number + 1, seal, station.key.sign(seal), body)
