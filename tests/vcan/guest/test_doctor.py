"""`station doctor` on a kernel's interface: up and busy, silent, down, and with error frames on it."""

import json
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from vcan_harness.interface import Interface
from vcan_harness.raw import RawSocket

from station.cli import app

Open = Callable[..., RawSocket]


@pytest.fixture
def doctor(
    vcan: Interface, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Callable[[], dict[str, tuple[bool, str]]]]:
    """Check → (well, said) for a station on the interface, nests A and B at nodes 0x11 and 0x12."""
    monkeypatch.chdir(tmp_path)
    nests = [{"name": "A", "node": 0x11}, {"name": "B", "node": 0x12}]
    bus = {"interface": "socketcan", "channel": vcan.name, "bitrate": 500000}
    shown = {"schema": "station.config/1", "station": "guest", "bus": bus, "nests": nests, "recipe": "six-point"}
    Path("config.yaml").write_text(json.dumps({**shown, "positioner": {"kind": "manual"}, "database": "s.db"}))

    def request() -> dict[str, tuple[bool, str]]:
        with pytest.raises(SystemExit) as ended:
            app.main(["doctor", "--json"])
        found: dict[str, Any] = json.loads(capsys.readouterr().out)
        assert ended.value.code == (0 if found["well"] else 3)
        return {c["check"]: (c["well"], c["said"]) for c in found["checks"]}

    yield request
    monkeypatch.chdir(os.sep)


@pytest.fixture
def sending(vcan: Interface, raw_socket: Open) -> Iterator[Callable[[int], None]]:
    """Frames of one identifier every 20 ms until the test ends."""
    over, senders = threading.Event(), list[threading.Thread]()

    def start(can_id: int) -> None:
        socket = raw_socket(vcan)

        def send() -> None:
            while not over.wait(0.02):
                socket.send(can_id, bytes(8))

        senders.append(threading.Thread(target=send))
        senders[-1].start()

    yield start
    over.set()
    for sender in senders:
        sender.join()


def test_a_busy_interface_is_well_and_says_who_speaks(
    doctor: Callable[[], dict[str, tuple[bool, str]]], sending: Callable[[int], None], vcan: Interface
) -> None:
    sending(0x192)
    found = doctor()
    assert found["bus"] == (True, f"{vcan.name} (vcan) is up, state unknown (error counters unknown)")
    assert found["traffic"][0]
    assert f"frames/s on {vcan.name}, from nests B" in found["traffic"][1]


def test_silence_is_said_and_no_fault(doctor: Callable[[], dict[str, tuple[bool, str]]], vcan: Interface) -> None:
    assert doctor()["traffic"] == (True, f"no frame on {vcan.name} within 1 s; are the units powered?")


def test_an_interface_that_is_down_is_named_with_the_command(
    doctor: Callable[[], dict[str, tuple[bool, str]]], vcan: Interface
) -> None:
    vcan.down()
    found = doctor()
    assert not found["bus"][0]
    assert f"{vcan.name} is down: as root, `ip link set {vcan.name} type can bitrate 500000" in found["bus"][1]
    assert not found["traffic"][0]
    assert f"ip link set {vcan.name} up" in found["traffic"][1]


def test_error_frames_are_somebodys_trouble(
    doctor: Callable[[], dict[str, tuple[bool, str]]], sending: Callable[[int], None]
) -> None:
    sending(0x2000_0000 | 0x20)
    well, printed = doctor()["traffic"]
    assert not well
    assert "no node acknowledged a frame" in printed
