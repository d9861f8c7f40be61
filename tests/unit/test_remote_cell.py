"""A cell without a PLC: clamps open only for units that may leave, whatever is pressed, stuck, pulled at or killed."""

import random
from itertools import repeat
from pathlib import Path

import pytest
from pydantic import ValidationError

from station.adapters.cell.remote_io import RemoteIoCell
from station.adapters.simulated_plc import IO_KINDS
from station.domain.cell.handover import Bin
from station.domain.cell.remote_cell import ClampPhase, RemoteCell, Signals
from station.errors import PlcFault, StationFault
from tests.fakes.remote_cell import RIGHT, RemoteBench, killed_load, requests_of_a_load


def test_good_units_leave_first_and_the_rest_after_somebody_took_note(tmp_path: Path) -> None:
    bench = RemoteBench(tmp_path)
    bench.go(bench.station(), 10.0)
    assert [t.serial for t in bench.io.taken[:2]] == ["SN1", "SN4"]
    assert bench.left() == RIGHT
    assert bench.log.lines[-1].step == "handed"
    assert dict(bench.log.lines[-1].bins) == {0: Bin.GOOD, 1: Bin.REJECT, 2: Bin.AGAIN, 3: Bin.GOOD}


def test_killed_at_a_request_no_unit_leaves_wrongly_and_none_is_tested_twice(tmp_path: Path) -> None:
    """At each of them: tests/endurance/torture_cell.py."""
    requests = requests_of_a_load(tmp_path / "whole")
    assert requests > 200
    killed = range(1, requests + 1, 23)
    assert [text for at in killed if (text := killed_load(tmp_path / str(at), at))] == []


@pytest.mark.parametrize("fault", sorted(IO_KINDS))
def test_what_is_stuck_or_pulled_lets_no_reject_go(tmp_path: Path, fault: str) -> None:
    first = ("SN2", "SN1", "SN3", "SN4")  # the unit of the faulty nest is a FAIL
    bench = RemoteBench(tmp_path, fault, iter([first]))
    station, said = bench.station(), list[str]()
    for _ in range(400):
        try:
            station.step()
        except (PlcFault, StationFault) as wrong:
            said.append(wrong.message.id)
        bench.clock.sleep(0.05)
    torn = {t.serial for t in bench.io.taken if not t.acknowledged} & {"SN2", "SN3"}
    expected = {
        "silent": "plc-lost",
        "clamp-loose": "cell-clamp-loose",
        "part-pulled": "cell-part-pulled",
    }
    assert set(said) == ({expected[fault]} if fault in expected else set())
    assert torn == ({"SN2"} if fault in ("part-pulled", "clamp-loose") else set())
    assert fault not in ("clamp-stuck", "start-taped", "silent") or bench.io.taken == []


def test_a_cell_whose_memory_is_lost_opens_no_clamp_before_somebody_took_note(tmp_path: Path) -> None:
    bench = RemoteBench(tmp_path)
    bench.go(bench.station(), 2.0)
    (tmp_path / "memory.json").unlink()
    bench.station()
    for _ in range(60):
        assert bench.cell.view().load == 0
        bench.clock.sleep(0.05)
    assert set(bench.left()) == set(RIGHT)
    assert all(bench.left().values())


def test_a_clamp_that_opens_under_a_reject_is_told_before_it_is_gone() -> None:
    cell = RemoteCell(ClampPhase.TESTING, load=1, parts=frozenset({0, 1})).given(1, {0: Bin.REJECT, 1: Bin.GOOD})
    loose = Signals(frozenset({0, 1}), frozenset({1}), start=False, acknowledge=False)
    assert (fault := cell.fault(loose)) is not None
    assert fault.id == "cell-clamp-loose"


def test_a_damaged_memory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "memory.json").write_text('{"phase": "dreaming"}')
    with pytest.raises(StationFault, match="does not say what the cell last did"):
        RemoteBench(tmp_path).station()


def test_any_order_of_signals_keeps_rejects_until_the_button(rng_seed: int = 3) -> None:
    """Random sensors and buttons: the clamp of a reject is never open between its verdict and the acknowledgement."""
    rng = random.Random(rng_seed)
    cell, acknowledged = RemoteCell(), False
    for _ in repeat(None, 20_000):
        some = frozenset(i for i in range(4) if rng.random() < 0.7)
        signals = Signals(
            some, frozenset(i for i in range(4) if rng.random() < 0.9), rng.random() < 0.3, rng.random() < 0.3
        )
        before, cell = cell, cell.after(signals)
        if cell.phase is ClampPhase.TESTING and rng.random() < 0.2:
            cell = cell.given(cell.load, {place: rng.choice(list(Bin)) for place in cell.parts})
            acknowledged = False
        acknowledged |= (
            before.phase is ClampPhase.ACKNOWLEDGE and signals.acknowledge and cell.phase is ClampPhase.REST_OUT
        )
        if cell.phase in (ClampPhase.GOOD_OUT, ClampPhase.ACKNOWLEDGE, ClampPhase.REST_OUT):
            assert acknowledged or not cell.open_clamps(4) & cell.rest
        assert RemoteCell.of(cell.document()) == cell


@pytest.mark.parametrize(
    "wrong",
    [{"parts": [0, 1]}, {"start": 0}, {"lamps": {"red": 0}}, {"clamps": [1, 1, 2, 3]}, {"memory": ""}],
)
def test_a_wiring_that_cannot_be_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        RemoteIoCell.Settings(**{"host": "io", **wrong})  # type: ignore[arg-type]
