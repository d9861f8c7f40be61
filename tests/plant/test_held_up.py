"""What holds one station's log up holds up no other: the same portion twice at once, and locks of the database."""

import hashlib
import http.client
import json
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import psycopg
import pytest

from station.adapters.postgres.connections import Connections
from station.adapters.postgres.plant import PostgresPlant
from station.adapters.postgres.schema import migrate
from station.domain.records.wire import encode
from station.errors import StoreFault
from station.service.receiver import Standing
from station.web.plant import Entrances, PlantFace, connection_options, create_plant_app
from tests.fakes.plant import FakePlant, FakeStation
from tests.fakes.serving import app_served

NewStation = Callable[..., FakeStation]


def test_a_log_that_comes_several_times_at_once_begins_once(plant: FakePlant, new_station: NewStation) -> None:
    station = new_station(units=1)
    records, log_id = station.records(), station.log_id()
    with ThreadPoolExecutor(8) as pool:
        portions = [records[: 3 + number] for number in range(8)]
        standings = list(pool.map(lambda portion: plant.receive(station, portion, log_id), portions))
    assert [s.refusal for s in standings] == [None] * 8
    assert plant.store.quarantined(resolved=True) == []


def test_after_the_database_ended_one_question_fails_and_not_one_for_each_connection(plant: FakePlant) -> None:
    with plant.connections.one() as first, plant.connections.one() as second, plant.connections.one() as third:
        pids = [one.info.backend_pid for one in (first, second, third)]
    with psycopg.connect(plant.address, autocommit=True) as other:
        other.execute("SELECT pg_terminate_backend(pid) FROM unnest(%s::int[]) pid", [pids])
    with pytest.raises(StoreFault, match="terminat"):
        plant.store.standings()
    assert plant.store.standings() == []


@pytest.mark.parametrize("held", ["SELECT 1 FROM log FOR UPDATE", "LOCK TABLE visit IN ACCESS EXCLUSIVE MODE"])
def test_a_lock_that_somebody_holds_is_not_waited_for_for_ever(
    plant: FakePlant, new_station: NewStation, held: str
) -> None:
    station = new_station(units=1)
    records = station.records()
    plant.receive(station, records[:3])
    hasty = Connections(plant.address, lock_timeout_s=0.05)
    plant.receiver._store = PostgresPlant(hasty, plant.store._objects, {})
    with plant.connections.one() as other, other.transaction():
        other.execute(held.encode())
        with pytest.raises(StoreFault, match="lock timeout"):
            plant.receive(station, records)
    assert plant.receive(station, records).number == len(records)
    with plant.connections.one() as other, other.transaction():
        other.execute("SELECT pg_advisory_xact_lock(%s)", [0x706C616E74])
        with pytest.raises(StoreFault, match="lock timeout"):
            migrate(hasty)
    hasty.close()


def test_a_station_that_is_held_up_takes_one_thread_however_often_it_asks() -> None:
    gate, entered = threading.Event(), list[str]()

    def receive(station: Any, *_: object) -> Standing:
        entered.append(station.name)
        if station.name == "held":
            assert gate.wait(30)
        return Standing(1, b"")

    names: Any = {hashlib.sha256(n.encode()).hexdigest(): SimpleNamespace(name=n) for n in ("held", "free")}
    nothing: Any = None
    store: Any = SimpleNamespace(standings=list)
    receiver: Any = SimpleNamespace(receive=receive)
    app = create_plant_app(PlantFace(receiver, store, Entrances(names, {}), nothing, None, 1000))

    with app_served(app, **connection_options()) as port, ThreadPoolExecutor(60) as pool:
        held = [pool.submit(sent, port, "held") for _ in range(59)]
        try:
            assert sent(port, "free") == 1
        finally:
            gate.set()
        assert [one.result() for one in held] == [1] * 59
    assert entered.index("free") <= 1, "one of those held, at most, was before"


def sent(port: int, token: str) -> int:
    """The number that the plant answers."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("POST", "/logs/a/records", encode([]), {"authorization": f"Bearer {token}"})
    number = int(json.loads(connection.getresponse().read())["number"])
    connection.close()
    return number
