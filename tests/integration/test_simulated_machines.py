"""`--simulate` with a configured machine: a twin of it turns the fixture, or one that runs in another process does."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from station.domain.core.types import Outcome
from station.wiring.bench import open_bench
from station.wiring.run_order import RunOrder
from tests.fakes import fixture_run

ROOT = Path(__file__).parents[2]
BRIEF: dict[str, Any] = {"settle": {"time_s": 0.1}, "dwell": {"time_s": 0.4}, "verify": None, "limits": {}}


@contextmanager
def machine(*command: str) -> Iterator[str]:
    """`station rig --simulate` in a process of its own; the first line that it prints."""
    process = subprocess.Popen(
        [sys.executable, "-m", "station", "rig", "--simulate", *command], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.mark.parametrize(
    ("kind", "options"),
    [("plc", {"host": "192.168.0.10"}), ("gcode", {"port": "/dev/ttyUSB0"})],
)
def test_a_twin_turns_the_fixture_and_a_sentence_names_what_it_replaces(
    kind: str, options: dict[str, str], tmp_path: Path
) -> None:
    config = fixture_run.config(tmp_path, positioner={"kind": kind, **options})
    recipe = fixture_run.recipe(tmp_path, settle={"time_s": 0.1}, dwell={"time_s": 0.5})
    ran = fixture_run.run(tmp_path, config=config, recipe=recipe)
    assert ran.fault is None
    assert ran.results["SN0001"].outcome is Outcome.PASS
    address = next(iter(options.values()))
    assert any(f"positioner {kind} at {address} is not commanded" in notice for notice in ran.notices)


def test_drives_turn_a_rehearsal_in_real_time(tmp_path: Path) -> None:
    config = fixture_run.config(tmp_path, positioner={"kind": "cia402"})
    recipe = fixture_run.recipe(tmp_path, "one-point", **BRIEF)
    ran = fixture_run.run(tmp_path, config=config, recipe=recipe, interface="virtual", channel="drives")
    assert ran.fault is None
    assert ran.parked


def test_a_machine_at_an_address_of_this_computer_is_commanded(tmp_path: Path) -> None:
    with machine("plc", "--loads", "1", "--change-s", "0", "--nests", "1") as said:
        port = int(said.split(":")[1].strip(" }\n"))
        plc = {"kind": "plc", "host": "127.0.0.1", "port": port}
        config = fixture_run.config(tmp_path, positioner=plc, nests=[{"name": "A", "node": 17}])
        recipe = fixture_run.recipe(tmp_path, "one-point", positions=[{"name": "side", "up": "+x"}], **BRIEF)
        with open_bench(RunOrder(simulate=True, config=config, recipe=recipe, database=tmp_path / "log.db")) as bench:
            assert any("follows the positioner plc at 127.0.0.1" in notice for notice in bench.notices)
            positioner = bench.station.positioner
            positioner.park(5.0)  # stands there: nothing turns while the clamps of an empty cell are open
            where = positioner.where()
            assert where is not None
            assert where.attitude.trace() == pytest.approx(3.0)
