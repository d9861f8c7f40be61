"""Simulated time: actors act at each due instant in order, nothing waits, equal calls give equal times."""

import math

import pytest

from station.adapters.clock import EPOCH_NS, SystemClock, VirtualClock
from station.errors import StationFault


class Ticker:
    """Acts every `period_s` and notes when."""

    def __init__(self, period_s: float, first_s: float = 0.0) -> None:
        self.period_s, self.due_s = period_s, first_s
        self.acted: list[float] = []
        self.observed: list[float] = []

    def next_due_s(self) -> float:
        return self.due_s

    def act(self, now_s: float) -> None:
        self.observed.append(now_s)
        while self.due_s <= now_s:
            self.acted.append(self.due_s)
            self.due_s += self.period_s


def test_time_stands_still_until_somebody_waits() -> None:
    clock = VirtualClock()
    assert (clock.monotonic_s(), clock.epoch_ns()) == (0.0, EPOCH_NS)
    clock.sleep(2.5)
    assert (clock.monotonic_s(), clock.epoch_ns()) == (2.5, EPOCH_NS + 2_500_000_000)
    clock.sleep(-1.0)
    assert clock.monotonic_s() == 2.5


def test_actors_act_when_due_in_order_and_at_the_end() -> None:
    clock, fast, slow = VirtualClock(), Ticker(0.25), Ticker(0.5, first_s=0.1)
    clock.attach(fast)
    clock.attach(slow)
    clock.sleep(1.0)
    assert fast.acted == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert slow.acted == [0.1, 0.6]
    assert slow.observed == fast.observed == [0.0, 0.1, 0.25, 0.5, 0.6, 0.75, 1.0]


def test_idle_actors_cost_one_step_however_long_the_sleep() -> None:
    clock, idle = VirtualClock(), Ticker(1.0, first_s=math.inf)
    clock.attach(idle)
    clock.sleep(1e6)
    assert idle.observed == [0.0, 1e6]


def test_advance_stops_at_the_first_event() -> None:
    clock, ticker = VirtualClock(), Ticker(10.0, first_s=3.0)
    clock.attach(ticker)
    clock.advance(5.0)
    assert (clock.monotonic_s(), ticker.acted) == (3.0, [3.0])
    clock.advance(5.0)
    assert clock.monotonic_s() == 5.0
    clock.advance(4.0)
    assert clock.monotonic_s() == 5.0


def test_settling_moves_no_time() -> None:
    clock, ticker = VirtualClock(), Ticker(10.0, first_s=3.0)
    clock.attach(ticker)
    clock.settle()
    assert (clock.monotonic_s(), ticker.observed) == (0.0, [0.0])


def test_an_actor_that_never_gets_done_is_a_fault_not_a_hang() -> None:
    class Stubborn(Ticker):
        def act(self, now_s: float) -> None:
            self.observed.append(now_s)

    clock = VirtualClock()
    clock.attach(Stubborn(1.0, first_s=0.5))
    with pytest.raises(StationFault, match="still due at"):
        clock.sleep(1.0)


def test_an_actor_that_waits_is_a_fault_not_a_recursion() -> None:
    clock = VirtualClock()

    class Sleeper(Ticker):
        def act(self, now_s: float) -> None:
            clock.sleep(1.0)

    clock.attach(Sleeper(1.0))
    with pytest.raises(StationFault, match="waited inside its own act"):
        clock.sleep(1.0)


def test_nanoseconds_are_exact_far_from_the_start() -> None:
    clock = VirtualClock(start_ns=5)
    assert clock.at_ns(123_456.000_000_001) == 123_456_000_000_006


def test_the_machines_clock_runs_forward_and_counts_from_1970() -> None:
    clock = SystemClock()
    first, before_ns = clock.monotonic_s(), clock.epoch_ns()
    clock.sleep(-1.0)
    clock.sleep(0.0)
    assert clock.monotonic_s() >= first
    assert clock.epoch_ns() >= before_ns > 1_700_000_000_000_000_000
