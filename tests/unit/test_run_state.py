"""The state of a run, folded from its events."""

from station.domain.core.types import NestAssignment, Outcome, Reason
from station.domain.run.progress import (
    Identified,
    LiveReading,
    LoadDone,
    LoadStarted,
    Notice,
    ObjectWritten,
    Phase,
    PhaseEntered,
    UnitDone,
    UnitResult,
    VisitDone,
    VisitRejected,
    VisitStarted,
)
from station.domain.run.run_state import MAX_MESSAGES, RunState
from station.errors import BusFault
from station.messages import Message

TURN = Message.text("turn it")
SEATS = (NestAssignment("SN1", "A", 17), NestAssignment("SN2", "B", 18))
BEGUN = RunState(visits=("z-up", "z-down", "verify-x")).after(LoadStarted(SEATS, 3, 25.0), 1000.0)


def test_a_load_begins_with_its_nests_and_its_first_stop_next() -> None:
    assert [(n.nest, n.serial, n.outcome) for n in BEGUN.nests] == [("A", "SN1", ""), ("B", "SN2", "")]
    assert (BEGUN.following, BEGUN.done, BEGUN.total, BEGUN.began_s, BEGUN.estimate_s) == ("z-up", 0, 3, 1000.0, 25.0)


def test_stops_go_by_even_where_the_numbers_start_again_with_the_verification() -> None:
    state = BEGUN.after(VisitStarted(1, 2, "z-up"), 1001)
    assert (state.position, state.following) == ("z-up", "z-down")
    state = state.after(VisitDone(1, 2, "z-up", {"SN1": (0.0, 0.0, 1.0)}), 1002)
    state = state.after(VisitStarted(2, 2, "z-down"), 1003).after(VisitDone(2, 2, "z-down", {}), 1004)
    state = state.after(VisitStarted(1, 1, "verify-x", TURN), 1005)
    assert (state.position, state.following, state.done, state.instruction) == ("verify-x", "", 2, TURN)
    assert state.nests[0].vector == (0.0, 0.0, 1.0)
    assert state.nests[1].vector == ()


def test_readings_move_vector_and_noise_and_nothing_else() -> None:
    state = BEGUN.after(LiveReading({"SN2": (0.1, 0.2, 0.3)}, {"SN2": 0.001}), 1001)
    assert state.nests[0] == BEGUN.nests[0]
    assert (state.nests[1].vector, state.nests[1].noise, state.done) == ((0.1, 0.2, 0.3), 0.001, 0)


def test_a_unit_ends_with_every_reason_and_its_neighbour_goes_on() -> None:
    state = BEGUN.after(Identified(SEATS[0], "accelerometer", "1.0.0", 1), 1001)
    reasons = (
        Reason(Message.text("offset x is too large"), check="offset"),
        Reason(Message.text("too noisy"), check="noise"),
    )
    ended = UnitResult(SEATS[0], "id", Outcome.FAIL, reasons, None, False, False, 0.002, 3.0)
    state = state.after(UnitDone(ended), 1002)
    first, second = state.nests
    assert (first.outcome, first.attempt, first.device) == ("FAIL", "id", "accelerometer 1.0.0")
    assert first.reasons == tuple(r.message for r in reasons)
    assert second.outcome == ""


def test_phases_writes_and_the_end_with_its_fault() -> None:
    state = BEGUN.after(PhaseEntered(Phase.WRITE), 1001).after(ObjectWritten("SN1", "gain x", 2, 12), 1002)
    assert (state.phase, state.writing) == ("write", "gain x (2/12)")
    state = state.after(PhaseEntered(Phase.SAVE), 1003)
    assert state.writing == ""
    state = state.after(LoadDone((), BusFault("the bus is off")), 1004)
    assert state.fault == Message.text("the bus is off")
    assert (state.over, state.position, state.phase) == (True, "", "done")
    assert not state.after(LoadStarted(SEATS, 3, 25.0), 1005).over


def test_messages_are_held_but_never_without_end() -> None:
    state = BEGUN.after(VisitRejected("SN1", "z-up", (Reason(Message.text("frames were lost")),), True), 1001)
    reasons = (Message.text("frames were lost"),)
    assert state.messages == (Message("visit-measured-again", serial="SN1", reasons=reasons),)
    for i in range(3 * MAX_MESSAGES):
        state = state.after(Notice(Message.text(f"sentence {i}"), "SN2"), 1002)
    assert len(state.messages) == MAX_MESSAGES
    last = Message.text(f"sentence {3 * MAX_MESSAGES - 1}")
    assert state.messages[-1] == Message("about-unit", serial="SN2", message=last)
