"""What arrives at a plant is checked there and then: kept as it was sealed, or set apart with station and number."""

import random
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from station.adapters.store import keys
from station.adapters.store.sqlite import SqliteStore
from station.domain.records.arrival import Arrival, Tip
from station.domain.records.chain import canonical, link
from station.domain.records.tables import COLUMNS
from station.domain.records.wire import WireRecord
from station.messages import render
from station.ports.log_reader import Query
from station.ports.plant import Claim
from tests.fakes import logs
from tests.fakes.plant import FakePlant, FakeStation

NewStation = Callable[..., FakeStation]


def only_refusal(plant: FakePlant) -> tuple[str, int, str]:
    (entry,) = plant.store.quarantined()
    return entry.station, entry.refusal.number, entry.refusal.reason


def kept(plant: FakePlant) -> int:
    with plant.connections.one() as db:
        parts = " + ".join(f'(SELECT count(*) FROM "{table}")' for table in COLUMNS)
        row = db.execute(f"SELECT {parts}".encode()).fetchone()
    assert row
    return int(row[0])


def sealed(station: FakeStation, after: WireRecord, table: str, values: tuple[object, ...]) -> WireRecord:
    """A further record of the log, signed by its key."""
    body = canonical(table, COLUMNS[table], values)  # type: ignore[arg-type]
    seal = link(after.hash, body)
    return WireRecord(after.number + 1, seal, station.key.sign(seal), body)


def test_every_record_arrives_once_whatever_is_sent_again(plant: FakePlant, new_station: NewStation) -> None:
    station = new_station(units=3)
    records = station.records()
    plant.receive(station, records[:10])
    for portion in (records[:10], records[3:20], records, records):
        assert plant.receive(station, portion).refusal is None
    standing = plant.receiver.standing(station.registered, station.log_id())
    assert (standing.number, standing.seal) == (records[-1].number, records[-1].hash)
    assert kept(plant) == len(records)
    with plant.reader() as log:
        assert list(log.findings()) == []
    assert plant.store.quarantined() == []


@pytest.mark.parametrize("signed", [False, True])
def test_ten_thousand_tampered_records_are_named_one_by_one(new_station: NewStation, signed: bool) -> None:
    """One byte anywhere in a record: content, seal or signature. Where the seal is made anew, the signature tells."""
    station, drawn = new_station(units=4), random.Random(20260101)
    records = station.records()
    known = plain_verify()
    tips = {0: Tip.start(station.log_id(), station.name, station.registered.public_key)}
    walk = Arrival(tips[0], known)
    for record in records:
        walk.take([record])
        tips[record.number] = walk.tip
    for trial in range(10_000 if not signed else 500):
        record = drawn.choice(records)
        bad = tampered(record, drawn, tips[record.number - 1].seal if signed else None)
        arrival = Arrival(tips[record.number - 1], known)
        arrival.take([bad])
        assert arrival.refusal is not None, (trial, record.number)
        assert arrival.refusal.number == record.number
        assert arrival.refusal.message.parameters["station"] == "bench-1"
        assert arrival.taken == []


def plain_verify() -> Callable[[bytes, bytes, bytes], bool]:
    """Every right signature is checked once by libsodium, and remembered: what remains is what is wrong."""
    from station.adapters.postgres.signatures import verify

    return verify


def tampered(record: WireRecord, drawn: random.Random, previous: bytes | None) -> WireRecord:
    where = drawn.randrange(len(record.body) + (0 if previous else 32 + len(record.signature)))
    flip = 1 << drawn.randrange(8)

    def flipped(data: bytes, at: int) -> bytes:
        return data[:at] + bytes([data[at] ^ flip]) + data[at + 1 :]

    if where < len(record.body):
        body = flipped(record.body, where)
        return replace(record, body=body, hash=link(previous, body) if previous else record.hash)
    where -= len(record.body)
    if where < 32:
        return replace(record, hash=flipped(record.hash, where))
    return replace(record, signature=flipped(record.signature, where - 32))


def test_a_tampered_record_is_set_apart_and_the_right_one_taken_later(
    plant: FakePlant, new_station: NewStation
) -> None:
    station = new_station()
    records = station.records()
    bad = replace(records[7], body=records[7].body.replace(b"A", b"B", 1) + b"")
    assert bad != records[7]
    standing = plant.receive(station, [*records[:7], bad, *records[8:]])
    assert (standing.number, only_refusal(plant)) == (7, ("bench-1", 8, "tampered"))
    assert "Record 8 of bench-1 breaks its seal" in render(plant.store.quarantined()[0].refusal.message)
    plant.receive(station, records)
    assert plant.store.quarantined() == []  # decided by itself: it came after all
    assert [e.refusal.number for e in plant.store.quarantined(resolved=True)] == [8]
    with plant.reader() as log:
        assert list(log.findings()) == []


def test_a_hundred_gaps_are_named(plant: FakePlant, new_station: NewStation) -> None:
    station, drawn = new_station(units=12), random.Random(20260102)
    records = station.records()
    at = 0
    for _ in range(100):
        first = at + drawn.randrange(1, 3)
        standing = plant.receive(station, records[first : first + 2])
        assert standing.refusal is not None
        assert (standing.refusal.reason, standing.refusal.number, standing.number) == ("gap", at + 1, at)
        if drawn.random() < 0.5:
            at = plant.receive(station, records[at : at + 1]).number
    assert kept(plant) == at
    assert plant.receive(station, records[at:]).number == len(records)


def forked(station: FakeStation, folder: Path, units: int) -> FakeStation:
    """The station's log from a backup, gone on by itself."""
    folder.mkdir()
    shutil.copy(station.path, folder)
    other = FakeStation(station.name, folder, station.key)
    with SqliteStore(
        other.path, station.name, signer=keys.Signer(other.key.sign, other.registered.public_key), anchors=()
    ) as store:
        for number in range(units):
            logs.unit(store, f"FK{number:04d}", station=station.name)
    return other


def test_a_station_restored_from_a_backup_is_named_where_it_departs_and_can_go_on_as_a_branch(
    plant: FakePlant, new_station: NewStation, tmp_path: Path
) -> None:
    station = new_station(units=1)
    backup = tmp_path / "backup"
    backup.mkdir()
    for file in tmp_path.glob("bench-1.db*"):
        shutil.copy(file, backup)
    with station.store() as store:
        logs.unit(store, "SN0100")
    plant.take_all(station)
    before = kept(plant)
    other = FakeStation("bench-1", backup, station.key)
    shared = len(other.records())
    assert plant.receive(other, other.records()).refusal is None  # it says nothing new yet
    older = plant.receiver.receive(other.registered, other.log_id(), [], logs_claim(other.records()[-1]))
    assert older.refusal is not None
    assert (older.refusal.reason, older.refusal.number) == ("older", shared + 1)
    with other.store() as store:
        for number in range(3):
            logs.unit(store, f"SN02{number:02d}")
    standing = plant.receive(other, other.records()[shared - 2 :])
    assert standing.refusal is not None
    assert (standing.refusal.reason, standing.refusal.number) == ("fork", shared + 1)
    assert kept(plant) == before
    assert {(e.refusal.reason, e.refusal.number) for e in plant.store.quarantined()} == {
        ("fork", shared + 1),
        ("older", shared + 1),
    }
    plant.store.adopt("bench-1", other.log_id(), "Ada", "disk restored", 1)
    standing = plant.receiver.standing(other.registered, other.log_id())
    assert standing.number == shared
    plant.receive(other, other.records()[shared:])
    assert plant.store.quarantined() == []
    with plant.reader() as log:
        assert list(log.findings()) == []
        found = {a.serial for a in log.attempts(Query())}
    assert found == {"SN0000", "SN0100", "SN0200", "SN0201", "SN0202"}


def logs_claim(record: WireRecord) -> Claim:
    return Claim(record.number, record.hash.hex())


def test_a_hundred_forks_are_named_with_the_record_where_they_depart(plant: FakePlant, new_station: NewStation) -> None:
    station, drawn = new_station(units=4), random.Random(20260103)
    records = station.records()
    plant.take_all(station)
    for _ in range(100):
        at = drawn.randrange(1, len(records))
        fork = sealed(station, records[at - 1], "event", (None, drawn.randrange(10**6), "fork", "{}"))
        overlap = records[max(at - drawn.randrange(3), 0) : at]
        standing = plant.receive(station, [*overlap, fork])
        assert standing.refusal is not None
        assert (standing.refusal.reason, standing.refusal.number) == ("fork", at + 1)
    assert len(plant.store.quarantined()) == 100
    assert kept(plant) == len(records)


def test_two_stations_of_one_name_are_told_apart(plant: FakePlant, new_station: NewStation, tmp_path: Path) -> None:
    station = new_station()
    plant.take_all(station)
    (tmp_path / "b").mkdir()
    twin = FakeStation("bench-1", tmp_path / "b", station.key)
    with twin.store() as store:
        logs.unit(store, "SN9", station="bench-1")
    before = kept(plant)
    standing = plant.receive(twin, twin.records())
    assert standing.refusal is not None
    assert "comes with a second log" in render(standing.refusal.message)
    assert (kept(plant), only_refusal(plant)) == (before, ("bench-1", 1, "other-log"))
    plant.store.adopt("bench-1", twin.log_id(), "Ada", "new disk", 1)
    assert plant.take_all(twin).refusal is None
    back = plant.receive(station, station.records()[:1])
    assert back.refusal is not None
    assert back.refusal.reason == "other-log"


def test_wrong_key_wrong_name_newer_schema_and_replayed_head_are_refused(
    plant: FakePlant, new_station: NewStation, tmp_path: Path
) -> None:
    station = new_station()
    records = station.records()
    stranger = replace(station, key=Ed25519PrivateKey.generate())
    wrong = plant.receive(stranger, records, station.log_id())
    assert wrong.refusal is not None
    assert (wrong.refusal.reason, wrong.refusal.number, wrong.number) == ("forged", 1, 0)
    other = new_station("bench-2", units=1)
    renamed = FakeStation("bench-3", tmp_path, other.key)
    named = plant.receive(renamed, other.records(), other.log_id())
    assert named.refusal is not None
    assert named.refusal.reason == "other-station"
    plant.take_all(station)
    body = sealed(station, records[-1], "event", (None, 1, "x", "{}")).body + b"colour=s3:red"
    newer = [seal_of(station, records[-1], body), seal_of(station, records[-1], b"6:shadowa=i1:1")]
    for record in newer:
        refused = plant.receive(station, [record])
        assert refused.refusal is not None
        assert (refused.refusal.reason, refused.refusal.number) == ("newer-schema", len(records) + 1)
        assert "update the plant" in render(refused.refusal.message)
    old = plant.receiver.receive(station.registered, station.log_id(), [], logs_claim(records[5]))
    assert old.refusal is not None
    assert (old.refusal.reason, old.refusal.number) == ("older", 7)


def seal_of(station: FakeStation, after: WireRecord, body: bytes) -> WireRecord:
    seal = link(after.hash, body)
    return WireRecord(after.number + 1, seal, station.key.sign(seal), body)


def test_a_portion_that_somebody_recorded_and_sends_again_makes_no_silent_station_look_alive(
    plant: FakePlant, new_station: NewStation
) -> None:
    station = new_station(units=3)
    records = station.records()
    behind = Claim(len(records) + 50, "")
    plant.receiver.receive(station.registered, station.log_id(), records, behind)
    before = plant.store.standings()
    for portion in (records[:10], records[5:20], records):
        assert plant.receive(station, portion).refusal is None
    assert plant.store.standings() == before


def test_what_the_database_cannot_keep_is_named_and_what_comes_before_is_kept(
    plant: FakePlant, new_station: NewStation
) -> None:
    station, drawn = new_station(units=1), random.Random(1)
    records = station.records()
    plant.take_all(station)
    long = "".join(chr(drawn.randrange(0x4E00, 0x9FFF)) for _ in range(5000))
    columns = dict.fromkeys(COLUMNS["attempt"], "")
    numbers = {"node": 1, "recipe_version": 1, "recipe": None, "product": None, "started_ns": 1}
    values = columns | numbers | {"id": "x", "serial": long, "station": "bench-1"}
    good = sealed(station, records[-1], "event", (None, 1, "before", "{}"))
    bad = sealed(station, good, "attempt", tuple(values.values()))
    after = sealed(station, bad, "event", (None, 1, "after", "{}"))
    standing = plant.receive(station, [good, bad, after])
    assert standing.refusal is not None
    assert (standing.refusal.reason, standing.refusal.number) == ("unstorable", bad.number)
    assert standing.number == good.number
    orphan = sealed(station, good, "finish", (good.number, "PASS", 1))
    standing = plant.receive(station, [orphan])
    assert standing.refusal is not None
    assert standing.refusal.reason == "unknown-attempt"


def test_a_log_whose_first_signature_comes_later_is_taken_with_it_and_one_without_is_not(
    plant: FakePlant, tmp_path: Path
) -> None:
    station = FakeStation("bench-1", tmp_path)
    with SqliteStore(station.path, "bench-1") as store:
        logs.unit(store, "SN1", station="bench-1")
    standing = plant.receive(station, station.records())
    assert standing.refusal is not None
    assert (standing.refusal.reason, standing.refusal.number, standing.number) == ("unsigned", 1, 0)
    with station.store() as store:
        logs.unit(store, "SN2", station="bench-1")
    assert plant.receive(station, station.records()).refusal is None
    with plant.reader() as log:
        assert list(log.findings()) == []
    late = replace(station.records()[-1], signature=b"", number=len(station.records()) + 1)
    late = replace(late, hash=link(station.records()[-1].hash, late.body))
    refused = plant.receive(station, [late])
    assert refused.refusal is not None
    assert refused.refusal.reason == "unsigned"


def test_a_key_handed_over_is_followed_and_a_revoked_one_ends(plant: FakePlant, new_station: NewStation) -> None:
    station = new_station(units=1)
    new = Ed25519PrivateKey.generate()
    old = keys.Signer(station.key.sign, station.registered.public_key)
    signer = keys.Signer(new.sign, new.public_key().public_bytes_raw())
    with SqliteStore(station.path, "bench-1", signer=signer, old_signer=old) as store:
        logs.unit(store, "SN8")
        revoked = {"public_key": signer.public_key.hex(), "beyond": store.head().number + 1, "by": "A", "reason": "b"}
        store.event("", keys.REVOKED_EVENT, revoked)
        logs.unit(store, "SN9")
    records = station.records()
    standing = plant.take_all(station)
    assert standing.refusal is not None
    assert (standing.refusal.reason, standing.refusal.number) == ("revoked", standing.number + 1)
    event = next(r for r in records if b"key-revoked" in r.body)
    assert standing.number == event.number


def test_what_somebody_alters_in_the_database_is_found(plant: FakePlant, new_station: NewStation) -> None:
    station = new_station()
    plant.take_all(station)
    with plant.connections.one() as db:
        db.execute("ALTER TABLE result DISABLE TRIGGER append_only")
        part = db.execute("SELECT tableoid::regclass::text FROM result LIMIT 1").fetchone()
        assert part
        db.execute(f"ALTER TABLE {part[0]} DISABLE TRIGGER ALL".encode())
        db.execute("""UPDATE result SET document = replace(document, '"PASS"', '"FAIL"') WHERE name = 'verdict'
            AND attempt = (SELECT min(attempt) FROM result)""")
    with plant.reader() as log:
        found = list(log.findings())
    assert [f.what for f in found] == ["tampered"]
