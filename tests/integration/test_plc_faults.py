"""A PLC that dies, restarts, freezes, lies or loses its door: nothing moves uncommanded, and the sentence is right."""

import pytest

from station.adapters.simulated_plc import KINDS
from station.adapters.simulated_plc.faults import OF_LOADS
from tests.fakes.plc_faults import EXPECTED, attempt


@pytest.mark.parametrize("fault", EXPECTED)
def test_a_fault_moves_nothing_and_is_named(fault: str) -> None:
    tried = attempt(fault)
    assert tried.id == EXPECTED[fault], tried
    assert tried.uncommanded_s == 0.0
    assert tried.off_deg < 0.5
    assert not tried.id or tried.sentence.endswith((".", "?")), tried.sentence


def test_every_fault_of_a_move_is_tried() -> None:
    assert {fault.partition(":")[0] for fault in EXPECTED} == KINDS.keys() - OF_LOADS
