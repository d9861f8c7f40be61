"""Reasons on a terminal: the root cause first, consequences of one kind in one line."""

from station.cli._fold import folded
from station.domain.core.types import Reason
from station.messages import Message


def test_the_root_cause_stands_first_and_many_of_a_kind_are_one_line() -> None:
    clipped = [
        Reason(Message.text(f"axis x is at the end of its range at p{i}"), 2.0, 2.0, check="range") for i in range(44)
    ]
    scale = Reason(Message.text("readings are 9.79 times the stimulus"), 9.79, 1.0, check="scale")
    lines = list(folded([*clipped, scale]))
    assert lines == [
        "readings are 9.79 times the stimulus",
        "axis x is at the end of its range at p0 (and 43 more like it; --json has all)",
    ]


def test_two_of_a_kind_are_both_told() -> None:
    two = [Reason(Message.text(f"gain {axis} is low"), 0.9, 0.05, check="gain") for axis in "xy"]
    assert list(folded(two)) == ["gain x is low", "gain y is low"]
