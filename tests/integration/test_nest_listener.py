"""What the units of a full load send before its run is heard beside the page, and nobody is written to."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from station.config.settings import load_settings
from station.files.owner import OwnerLock
from station.messages import Message
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.nest_readings import MOST_AGE_S, NestReading, read_readings, write_readings
from station.panel_protocol.queue import LoadQueue, WaitingUnit
from station.wiring import nest_listener
from station.wiring.nest_listener import NestListener
from station.wiring.run_order import RunOrder

NESTS = "ABCD"


@pytest.fixture
def database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log's place; no moment is waited for."""
    monkeypatch.chdir(tmp_path)
    return tmp_path / "station.db"


@pytest.fixture
def queue(database: Path) -> LoadQueue:
    return LoadQueue(companion_file(database, Companion.QUEUE))


@pytest.fixture
def listener(database: Path) -> Iterator[NestListener]:
    made = NestListener(RunOrder("six-point", database=database, simulate=True, faults=("SN0002/not-operational",)))
    yield made
    made.close()


def heard(database: Path) -> dict[str, NestReading]:
    return read_readings(database, time.time())


def fill(queue: LoadQueue) -> None:
    queue.put({nest: WaitingUnit(f"SN000{number}") for number, nest in enumerate(NESTS)})


def test_a_full_load_is_heard_and_a_silent_unit_is_left_out(
    database: Path, queue: LoadQueue, listener: NestListener
) -> None:
    queue.put({"A": WaitingUnit("SN0000")})
    listener.step()
    assert heard(database) == {}, "a nest is free"
    fill(queue)
    for _ in range(4):
        listener.step()
    found = heard(database)
    assert {nest: reading.serial for nest, reading in found.items()} == {"A": "SN0000", "B": "SN0001", "D": "SN0003"}
    for reading in found.values():
        assert reading.vector == pytest.approx((0.0, 0.0, 1.0), abs=0.15), "at rest, z up"
        assert reading.temperature_degC == pytest.approx(23.0, abs=5.0)
    queue.take_out("SN0003")
    listener.step()
    assert heard(database) == {}


def test_a_run_has_the_bus_to_itself(database: Path, queue: LoadQueue, listener: NestListener) -> None:
    fill(queue)
    listener.step()
    assert heard(database)
    lock = OwnerLock(companion_file(database, Companion.OWNER), Message("owned-log", path="x"), "b", 0)
    listener.step()
    assert not companion_file(database, Companion.READINGS).exists()
    lock.release()
    listener.step()
    assert heard(database)


@pytest.mark.parametrize("text", ["", "[]", '{"at_s": "now"}', '{"at_s": AT, "nests": {"A": {"vector": [1]}}}'])
def test_a_file_that_nobody_can_read_is_no_reading(database: Path, text: str) -> None:
    companion_file(database, Companion.READINGS).write_text(text.replace("AT", str(time.time())))
    assert heard(database) == {}


def test_an_old_reading_is_none(database: Path) -> None:
    write_readings(database, {"A": NestReading("SN1", (0.0, 0.0, 1.0))})
    assert heard(database) == {"A": NestReading("SN1", (0.0, 0.0, 1.0))}
    assert read_readings(database, time.time() + MOST_AGE_S + 1) == {}


def test_a_bus_that_one_process_has_to_itself_is_left_alone(database: Path) -> None:
    Path("config.yaml").write_text(
        "schema: station.config/1\nbus: {interface: pcan, channel: PCAN_USBBUS1}\nnests: [{name: A, node: 17}]\n"
    )
    settings = load_settings(None)
    assert not nest_listener._can_be_listened_to(RunOrder(database=database), settings)
