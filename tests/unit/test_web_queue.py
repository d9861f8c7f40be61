"""The units of the next load: kept over a restart, handed to a run, taken back from one that never began."""

from pathlib import Path

import pytest

from station.errors import StoreFault
from station.panel_protocol.queue import LoadQueue, WaitingUnit


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "s.db.queue.json"


def test_a_restart_forgets_nothing(path: Path) -> None:
    LoadQueue(path).put({"A": WaitingUnit("SN1"), "C": WaitingUnit("SN3")})
    again = LoadQueue(path)
    assert again.waiting == {"A": WaitingUnit("SN1"), "C": WaitingUnit("SN3")}
    again.hand_over(41)
    again.put({"A": WaitingUnit("SN5")})
    once_more = LoadQueue(path)
    assert (once_more.handed, once_more.serials()) == ({"A": WaitingUnit("SN1"), "C": WaitingUnit("SN3")}, ["SN5"])


def test_two_pages_on_one_log_see_the_same_list(path: Path) -> None:
    one, two = LoadQueue(path), LoadQueue(path)
    one.put({"A": WaitingUnit("SN1")})
    assert two.serials() == ["SN1"]
    two.put({"B": WaitingUnit("SN2")})
    assert one.serials() == ["SN1", "SN2"]
    one.clear()
    assert two.waiting == {}


def test_what_the_run_has_begun_is_let_go_of(path: Path) -> None:
    queue = LoadQueue(path)
    queue.put({"A": WaitingUnit("SN1")})
    queue.hand_over(41)
    queue.settle(begun=40, running=41)
    assert queue.handed, "the run of before is no sign"
    queue.settle(begun=41, running=41)
    assert (queue.handed, queue.waiting) == ({}, {})


def test_what_a_run_ended_without_beginning_comes_back(path: Path) -> None:
    queue = LoadQueue(path)
    queue.put({"A": WaitingUnit("SN1"), "B": WaitingUnit("SN2")})
    queue.hand_over(41)
    queue.put({"B": WaitingUnit("SN9")})
    queue.settle(begun=None, running=None)
    assert queue.waiting == {"A": WaitingUnit("SN1"), "B": WaitingUnit("SN2")}, "they lie in their nests"
    assert (queue.later, LoadQueue(path).handed) == (("SN9",), {})


def test_later_loads_move_up_in_the_order_scanned(path: Path) -> None:
    queue = LoadQueue(path)
    queue.put({"A": WaitingUnit("SN1"), "B": WaitingUnit("SN2")})
    for serial in ("SN3", "SN4", "SN5"):
        queue.append(serial)
    assert LoadQueue(path).serials() == ["SN1", "SN2", "SN3", "SN4", "SN5"]
    queue.hand_over(41, ["A", "B"])
    again = LoadQueue(path)
    assert again.waiting == {"A": WaitingUnit("SN3"), "B": WaitingUnit("SN4")}
    assert again.later == ("SN5",)
    again.take_out("SN5")
    assert not again.later


def test_a_unit_that_is_brought_forward_waits_only_once(path: Path) -> None:
    queue = LoadQueue(path)
    queue.append("SN3")
    queue.append("SN4")
    queue.put({"A": WaitingUnit("SN4")})
    assert (queue.waiting, queue.later) == ({"A": WaitingUnit("SN4")}, ("SN3",))
    queue.clear()
    assert queue.serials() == []


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"waiting": 1}', '{"waiting": {"A": {"x": 1}}, "handed": {}, "pid": 0}']
)
def test_a_file_that_nobody_can_read_is_an_empty_queue(path: Path, text: str) -> None:
    path.write_text(text)
    assert LoadQueue(path).waiting == {}


def test_what_cannot_be_kept_is_not_taken(tmp_path: Path) -> None:
    queue = LoadQueue(tmp_path / "none" / "q.json")
    with pytest.raises(StoreFault, match="free the disk"):
        queue.put({"A": WaitingUnit("SN1")})
    assert queue.waiting == {}


def test_what_a_person_has_dealt_with_survives_a_restart_and_a_start(path: Path) -> None:
    queue = LoadQueue(path)
    queue.acknowledge("41-7", all_done=False)
    assert (queue.state.binned, queue.state.cleared) == ("41-7", ())
    queue.acknowledge("41-7", all_done=True)
    queue.put({"A": WaitingUnit("SN1"), "B": WaitingUnit("SN2")})
    queue.take_out("SN1")
    queue.hand_over(42)
    queue.settle(begun=42, running=42)
    again = LoadQueue(path)
    assert again.state.cleared == ("41-7",)
    assert again.handed == {}
