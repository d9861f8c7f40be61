"""The states of a unit in a load: what the table allows, and what no sequence of events can bring about."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.run.unit_state import HOLDS_NEW, SWITCHED, UNCERTAIN, UNIT_STATES, UnitState
from station.errors import StationFault

PAGE = Path(__file__).resolve().parents[2] / "docs" / "decisions" / "0032-states-of-a-unit.md"


def before(state: UnitState) -> set[UnitState]:
    return {s for s in UnitState if state in UNIT_STATES.after[s]}


def test_every_state_is_in_the_table_and_can_be_closed() -> None:
    assert list(UNIT_STATES.after) == list(UnitState)
    assert before(UnitState.CLOSED) == set(UnitState) - {UnitState.CLOSED}


def test_new_values_count_only_when_read_after_a_reset_and_only_then_can_be_verified() -> None:
    assert before(UnitState.STORED) == {UnitState.RESTARTED}
    assert before(UnitState.VERIFIED) == {UnitState.STORED}
    assert before(UnitState.WRITING) == {UnitState.PREPARED}
    assert not HOLDS_NEW & UNCERTAIN
    assert not HOLDS_NEW & SWITCHED


def test_from_a_mixture_every_way_leads_over_a_reset_or_the_old_values_or_ends() -> None:
    for state in UNCERTAIN:
        assert UNIT_STATES.after[state] <= UNCERTAIN | {
            UnitState.PUT_BACK, UnitState.REVERTED, UnitState.STORED, UnitState.CLOSED,
        }  # fmt: skip


@given(st.lists(st.sampled_from(list(UnitState)), max_size=40))
def test_random_events_never_skip_a_step(wanted: list[UnitState]) -> None:
    """Whatever is asked for in whatever order: illegal steps raise, and the way that was gone is a way of the run."""
    way = [UnitState.SEATED]
    for state in wanted:
        if state in UNIT_STATES.after[way[-1]]:
            way.append(UNIT_STATES.follow(way[-1], state))
        else:
            with pytest.raises(StationFault, match=f"from {way[-1]} to {state}"):
                UNIT_STATES.follow(way[-1], state)
    milestones = [UnitState.IDENTIFIED, UnitState.PREPARED, UnitState.WRITING, UnitState.RESTARTED, UnitState.STORED]
    if UnitState.VERIFIED in way:
        places = [way.index(m) for m in milestones]
        assert places == sorted(places)
    if UnitState.PUT_BACK in way:
        assert UnitState.SAVING not in way, "what may be in flash is not undone in working memory"
    assert way.count(UnitState.CLOSED) <= 1
    assert UnitState.CLOSED not in way[:-1]


def test_the_drawing_in_the_decisions_is_that_of_the_table() -> None:
    assert f"```mermaid\n{UNIT_STATES.diagram()}\n```" in PAGE.read_text(encoding="utf-8")
