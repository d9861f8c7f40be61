"""The state model against the transitions that OPC 30050 (PackML 1.01, 6.3) names, and random commands."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.domain.cell.effectiveness import Made, by_shift
from station.domain.cell.packml import DONE, TRANSITIONS, Command, State, after_command, after_done, allowed
from station.domain.cell.state_times import StateTimes, stays
from station.errors import UsageError

#: `python benchmarks/line.py packml` takes 100,000.
STEPS = 15_000
#: OPC 30050: the transitions inside "Running", as from, to, method; "" when the state's own work causes it.
RUNNING = """resetting idle -|idle starting start|starting execute -|starting holding hold|execute suspending suspend
suspending suspended -|suspending holding hold|suspended unsuspending unsuspend|suspended holding hold
unsuspending execute -|unsuspending holding hold|execute holding hold|holding held -|held unholding unhold
unholding execute -|unholding holding hold|execute completing complete|completing complete -|complete resetting reset"""
#: OPC 30050: the machines around it. Every state of Running takes Stop; every state but aborting and aborted, Abort.
AROUND = "stopped resetting reset|stopping stopped -|clearing stopped -|aborting aborted -|aborted clearing clear"


def published() -> dict[tuple[str, str], str]:
    found = {}
    for text in (*RUNNING.replace("\n", "|").split("|"), *AROUND.split("|")):
        origin, following, cause = text.split()
        found[origin, cause] = following
    running = {origin for text in RUNNING.replace("\n", "|").split("|") for origin in text.split()[:1]} | {
        "held",
        "complete",
    }
    found |= {(state, "stop"): "stopping" for state in running}
    return found | {(s, "abort"): "aborting" for s in {*running, "stopped", "stopping", "clearing"}}


def test_the_table_is_the_published_one() -> None:
    ours = {(s.label, c.label): t.label for c, ways in TRANSITIONS.items() for s, t in ways.items()}
    ours |= {(s.label, "-"): t.label for s, t in DONE.items() if s is not State.EXECUTE}
    assert ours == published()
    assert DONE[State.EXECUTE] is State.COMPLETING  # TR88: "state complete" leads on, as the command does


def test_there_are_17_states_with_the_numbers_of_packtags() -> None:
    assert [s.value for s in State] == list(range(1, 18))
    names = {2: "stopped", 4: "idle", 5: "suspended", 6: "execute", 9: "aborted", 11: "held", 17: "complete"}
    assert {number: State(number).label for number in names} == names
    waiting = {State.STOPPED, State.IDLE, State.SUSPENDED, State.ABORTED, State.HELD, State.COMPLETE}
    assert set(State) - DONE.keys() == waiting


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("command", Command)
def test_every_cell_of_the_table(state: State, command: Command) -> None:
    following = published().get((state.label, command.label))
    if following is None:
        assert command not in allowed(state)
        with pytest.raises(UsageError, match=rf"command {command.label} is not allowed in the state {state.label}"):
            after_command(state, command)
    else:
        assert after_command(state, command).label == following


def test_random_commands_make_no_illegal_transition() -> None:
    rng, legal = random.Random(17), published()
    times = StateTimes.begin(State.ABORTED, 0.0)
    taken = refused = 0
    # Stop and abort lead from everywhere: seldom, or the walk never comes far.
    weights = [8.0, *(0.2 if c in (Command.STOP, Command.ABORT) else 2.0 for c in Command)]
    for step in range(STEPS):
        before = times.state
        choice = rng.choices([None, *Command], weights)[0]
        try:
            times = times.done(float(step)) if choice is None else times.command(choice, float(step))
        except UsageError:
            refused += 1
            assert choice is not None
            assert (before.label, choice.label) not in legal
            continue
        if choice is None:
            assert times.state is DONE.get(before, before)
        else:
            taken += 1
            assert times.state.label == legal[before.label, choice.label]
    assert taken > STEPS // 20
    assert refused > STEPS // 10
    assert set(times.entries) == set(State), "the walk came through every state"
    assert sum(times.total_s(s, STEPS - 1.0) for s in State) == pytest.approx(STEPS - 1.0)


def test_from_every_state_clear_and_reset_lead_back_to_idle() -> None:
    for state in State:
        at = (
            state
            if state is State.ABORTED
            else after_done(after_command(state, Command.ABORT))
            if (state is not State.ABORTING)
            else after_done(state)
        )
        assert at is State.ABORTED
        stopped = after_done(after_command(at, Command.CLEAR))
        assert after_done(after_command(stopped, Command.RESET)) is State.IDLE


@given(st.lists(st.tuples(st.sampled_from([None, *Command]), st.floats(-5, 50)), max_size=60))
def test_times_add_up_whatever_the_clock_does(steps: list[tuple[Command | None, float]]) -> None:
    times, now_s = StateTimes.begin(State.STOPPED, 0.0), 0.0
    for command, passed_s in steps:
        now_s += passed_s
        try:
            times = times.done(now_s) if command is None else times.command(command, now_s)
        except UsageError:
            continue
    assert all(seconds >= 0 for seconds in times.seconds.values())
    assert sum(times.entries.values()) >= 1


def test_effectiveness_of_a_shift_by_hand() -> None:
    changes = [(0.0, State.IDLE), (100.0, State.EXECUTE), (700.0, State.HELD), (800.0, State.EXECUTE)]
    changes += [(900.0, State.SUSPENDED), (1000.0, State.STOPPED)]
    made = [Made(400.0, passed=True, first=True), Made(690.0, passed=False, first=True)]
    made += [Made(890.0, passed=True, first=False)]
    (shift,) = by_shift(stays(changes, 1200.0), made, shift_s=3600.0, offset_s=0.0, ideal_s=140.0)
    assert (shift.planned_s, shift.producing_s, shift.held_s, shift.suspended_s) == (900.0, 700.0, 100.0, 100.0)
    assert shift.availability == pytest.approx(7 / 9)
    assert shift.performance == pytest.approx(0.4)
    assert shift.quality == pytest.approx(0.5)
    assert shift.oee == pytest.approx(7 / 9 * 0.4 * 0.5)


def test_a_stay_over_the_end_of_a_shift_counts_in_both() -> None:
    shifts = by_shift(stays([(50.0, State.EXECUTE)], 250.0), [], shift_s=100.0, offset_s=0.0, ideal_s=1.0)
    assert [s.producing_s for s in shifts] == [50.0, 100.0, 50.0]
