"""Rows of the fault table on a real vcan, our device in a process of its own: the same outcome, the same sentence."""

from pathlib import Path

import pytest
from vcan_harness import fixture
from vcan_harness.interface import Interface

from station.cli._run import exit_code
from tests.faults.table import ROWS, Row

NODE, SERIAL = 0x11, "SN0001"

#: Rows whose fault does not depend on the pace of the simulated fixture, and shows in seconds of real time.
ON_VCAN = frozenset(
    {
        "device deaf",
        "device silent",
        "device twice",
        "device stale",
        "device reads:index=0x1018,sub=1,value=5",
        "device reads:index=0x1018,sub=2,value=7",
        "device reads:index=0x1018,sub=3,value=1",
        "device reads:index=0x1000,sub=0,value=0",
        "device reads:index=0x1018,sub=4,value=9",
        "device refuse:index=0x1018,sub=1,code=0x06020000",
        "device power-cut:at=10",
        "device other-unit:at=10,value=77",
        "device other-unit:at=33,value=77",
        "device late:seconds=3,at=12,times=1",
        "device wrong-object:at=12,times=1,value=8192",
        "device wrong-object:index=0x2101,sub=4,value=0x2102",
        "device wrong-toggle",
        "device crc-errors:fraction=0.2",
        "device frames-lost:fraction=0.2",
        "device frames-repeated:fraction=0.2",
        "device stuck-axis:value=1",
        "device reads:index=0x2106,sub=0,value=1",
        "device reboot:at=3",
        "device reboot:at=20",
        "device refuse:index=0x2106,access=write,code=0x08000022",
    }
)
CHOSEN = [row for row in ROWS if row.inject in ON_VCAN]


def test_at_least_twenty_rows_run_here() -> None:
    assert len(CHOSEN) == len(ON_VCAN) >= 20


@pytest.mark.parametrize("row", CHOSEN, ids=lambda row: row.inject)
def test_the_same_outcome_and_sentence_on_a_kernel_bus(row: Row, vcan: Interface, tmp_path: Path) -> None:
    for turn in range(3):
        folder = tmp_path / str(turn)
        folder.mkdir()
        ran = _run(row, vcan, folder)
        r = ran.results[SERIAL]
        # A machine that is busy may starve a dwell; the unit's fault is then the station's, and it is run again.
        if (row.outcome, str(r.outcome)) != ("FAIL", "ERROR"):
            break
    assert str(r.outcome) == row.outcome, r.reasons
    assert row.says in r.reasons[0].sentence
    assert exit_code(list(ran.results.values()), ran.fault) == row.code
    (attempt,) = fixture.life(folder, SERIAL)
    assert attempt["outcome"] == row.outcome
    assert not attempt["writes"]


def _run(row: Row, vcan: Interface, folder: Path) -> fixture.Ran:
    faults = (row.inject.removeprefix("device "),)
    # Where the fault is not in the readings, a starved dwell is taken again.
    repeats = 0 if row.outcome == "FAIL" else 2
    with (
        fixture.Served(vcan, (NODE,), (SERIAL,), faults=faults, flash_s=0.05) as served,
        fixture.opened(folder, vcan, (NODE,), recipe={"visit_repeats": repeats}) as bench,
    ):
        return fixture.run(bench, (SERIAL,), served.turn)
