"""A rehearsal bench: config.yaml's bus is `simulated`, and commands need no --simulate."""

from pathlib import Path

import pytest

from station.cli.app import run_command
from station.errors import ConfigError, UsageError
from station.wiring.bench import open_bench
from station.wiring.rehearsal import rehearsing
from station.wiring.run_order import RunOrder

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
