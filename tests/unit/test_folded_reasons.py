"""Reasons on a terminal: the root cause first, consequences of one kind in one line."""

from types import SimpleNamespace

import pytest

from station.cli._run import _ProgressLines
from station.domain.core.folded_reasons import folded, folded_notes, folded_units
from station.domain.core.types import Reason
from station.domain.run.progress import VisitDone, VisitRejected
from station.messages import Message, render


def test_the_root_cause_stands_first_and_many_of_a_kind_are_one_line() -> None:
    clipped = [
        Reason(Message.text(f"axis x is at the end of its range at p{i}"), 2.0, 2.0, check="range") for i in range(44)
    ]
    scale = Reason(Message.text("readings are 9.79 times the stimulus"), 9.79, 1.0, check="scale")
    lines = list(map(render, folded([*clipped, scale])))
    assert lines == [
        "readings are 9.79 times the stimulus",
        "axis x is at the end of its range at p0 (and 43 more like it)",
    ]


def test_two_of_a_kind_are_both_told() -> None:
    two = [Reason(Message.text(f"gain {axis} is low"), 0.9, 0.05, check="gain") for axis in "xy"]
    assert list(map(render, folded(two))) == ["gain x is low", "gain y is low"]


def test_what_several_units_share_stands_once_with_their_names() -> None:
    times = [Message.text(f"readings are {9.7 + i / 100:.2f} times the stimulus") for i in range(4)]
    scales = [Reason(message, check="scale") for message in times]
    bus = Reason(Message.text("the bus went off"))
    units = [(f"SN{i}", [bus, scale]) for i, scale in enumerate(scales)]
    assert list(folded_units(units)) == [
        "SN0: readings are 9.70 times the stimulus (and 3 more units like it: SN1, SN2, SN3)",
        "SN0, SN1, SN2, SN3: the bus went off",
    ]


def test_what_several_nests_have_against_them_at_one_stop_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    bar = SimpleNamespace(add_task=lambda *_args, **_kwargs: 0, update=lambda *_args, **_kwargs: None)
    lines = _ProgressLines(bar, "run")
    silent, lost = (Reason(Message.text(text), check=text) for text in ("No readings.", "2 frames lost."))
    for serial, reason in (("SN1", silent), ("SN2", lost), ("SN3", silent)):
        lines.event(VisitRejected(serial, "z-up", (reason,), again=True))
    lines.event(VisitDone(1, 6, "z-up", {}))
    assert capsys.readouterr().err.splitlines() == [
        "SN1, SN3: No readings. Measuring again.",
        "SN2: 2 frames lost. Measuring again.",
    ]


def test_notes_of_one_kind_are_one_line_beside_notes_of_others() -> None:
    moved = [Message("visits-scatter", value=0.1 * i, unit="g") for i in range(5)]
    other = Message("activity-writing", file="a.csv")
    first, last = folded_notes([*moved, other])
    assert first.id == "and-more-like-it"
    assert render(first).endswith("(and 4 more like it)")
    assert last == other
