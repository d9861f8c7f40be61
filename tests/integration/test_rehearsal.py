"""A rehearsal bench: config.yaml's bus is `simulated`, and commands need no --simulate."""

from pathlib import Path
from typing import Any

import pytest

from station.adapters.bus.python_can import PythonCan
from station.cli.app import run_command
from station.errors import BusFault, ConfigError, UsageError
from station.wiring.bench import open_bench
from station.wiring.rehearsal import rehearsing
from station.wiring.run_order import RunOrder
from tests.fakes import fixture_run

#: What the device in the first nest sends.
HEARTBEAT, STREAM, SDO_ANSWER = 0x711, 0x191, 0x591
CONFIG = """\
schema: station.config/1
bus: {interface: BUS}
nests: [{name: A, node: 0x11}, {name: B, node: 0x12}]
recipe: one-point
REHEARSAL
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(here: Path, bus: str = "simulated", rehearsal: str = "") -> None:
    """The config file."""
    (here / "config.yaml").write_text(CONFIG.replace("BUS", bus).replace("REHEARSAL", rehearsal))


def test_a_run_needs_no_simulate_and_its_devices_keep_what_they_save(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(here, rehearsal="rehearsal: {device_state: memory, faults: ['SN0002/silent']}")
    assert run_command(["run", "--serial", "SN0001", "--serial", "SN0002"]) == 3
    shown = capsys.readouterr()
    assert "Rehearsal bench: bus, rig and devices are simulated (config.yaml)." in shown.err
    assert "SN0001  A     ✔ PASS" in shown.out
    assert "SN0002  B     ! ERROR" in shown.out
    assert (here / "memory" / "SN0001.json").exists()


def test_the_record_says_that_it_was_simulated(here: Path) -> None:
    write(here)
    with open_bench(RunOrder()) as bench:
        assert bench.simulated
        assert bench.station.simulated


def test_an_interface_on_the_command_line_is_a_real_one(here: Path) -> None:
    write(here)
    assert rehearsing(None)
    with pytest.raises(UsageError, match="a bus without units"):
        open_bench(RunOrder(interface="simulated"))


def test_a_rehearsal_on_a_real_bus_is_refused(here: Path) -> None:
    write(here, "socketcan", "rehearsal: {}")
    with pytest.raises(ConfigError, match=r"rehearsal block, but bus.interface is socketcan"):
        run_command(["run", "--serial", "SN0001"])


def test_devices_on_a_real_bus_outlive_a_frame_that_it_does_not_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused: list[int] = []
    later: set[int] = set()
    send = PythonCan.send

    def send_but_not_the_first(bus: PythonCan, sender: Any, can_id: int, *rest: Any) -> None:
        if can_id == HEARTBEAT and not refused:
            refused.append(can_id)
            raise BusFault("interface-queue-full", bus="virtual", timeout_s=1.0)
        if refused:
            later.add(can_id)
        send(bus, sender, can_id, *rest)

    monkeypatch.setattr(PythonCan, "send", send_but_not_the_first)
    name = fixture_run.recipe(tmp_path, "one-point", dwell={"time_s": 0.4}, verify=None, limits={})
    ran = fixture_run.run(tmp_path, recipe=name, interface="virtual", channel="heartbeats")
    assert ran.fault is None
    assert refused == [HEARTBEAT]
    assert later >= {STREAM, SDO_ANSWER}


@pytest.mark.parametrize("simulate", [False, True])
def test_a_channel_that_nothing_would_use_is_refused_before_anything_is_written(here: Path, simulate: bool) -> None:
    write(here)
    with pytest.raises(UsageError, match=r"--channel 'can1' would have no effect.*--interface virtual"):
        open_bench(RunOrder(simulate=simulate, channel="can1"))
    assert [file.name for file in here.iterdir()] == ["config.yaml"]
