"""One bus, one owner: who comes second is told who has it; whoever dies lets go."""

import os
import signal
from collections.abc import Iterator

import pytest

from station.config.settings import BusSettings
from station.errors import BusFault
from station.wiring.bus_owner import claim_bus, lock_path

CHANNEL = f"can{os.getpid()}"


@pytest.fixture
def bus() -> Iterator[BusSettings]:
    yield BusSettings(channel=CHANNEL)
    lock_path(CHANNEL).unlink(missing_ok=True)


def test_the_second_station_is_refused_with_the_firsts_name_and_time(bus: BusSettings) -> None:
    with claim_bus(bus, "bench-1"), pytest.raises(BusFault) as refused:
        claim_bus(bus, "bench-2")
    shown = refused.value.sentence
    assert shown.startswith(f"The bus {CHANNEL} is in use by bench-1 (pid {os.getpid()}) since 20")
    assert shown.endswith("stop that one first.")


def test_another_interface_is_nobodys_business(bus: BusSettings) -> None:
    with claim_bus(bus, "bench-1"):
        other = bus.model_copy(update={"channel": CHANNEL + "x"})
        claim_bus(other, "bench-2").release()
        lock_path(CHANNEL + "x").unlink()


def test_a_killed_station_lets_go(bus: BusSettings) -> None:
    reads, writes = os.pipe()
    child = os.fork()
    if child == 0:
        claim_bus(bus, "bench-1")
        os.write(writes, b"mine")
        signal.pause()
        os._exit(0)
    try:
        assert os.read(reads, 4) == b"mine"
        with pytest.raises(BusFault, match=f"bench-1 .pid {child}."):
            claim_bus(bus, "bench-2")
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(reads)
        os.close(writes)
    claim_bus(bus, "bench-2").release()


def test_a_name_cannot_leave_the_folder() -> None:
    assert lock_path("../../etc/passwd").name.startswith("station-______etc_passwd-")
