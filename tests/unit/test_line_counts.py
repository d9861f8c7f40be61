"""Counts, reasons and adjustments of a line, each as its file and its tables say."""

import json
from pathlib import Path

from station.domain.cell.adjustment import LineAdjustment, UnitMode
from station.domain.cell.handover import Bin
from station.domain.cell.packml import State
from station.domain.cell.stop_reasons import MOST_REASONS, after_change
from station.domain.cell.unit_counts import UnitCounts
from station.messages import Message
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.line_adjustment import LineAdjustments, send_line_adjustment

PAPER, STARVED = Message("printer-paper"), Message("line-starved")


def test_the_speed_is_that_between_the_two_newest_loads() -> None:
    counts = UnitCounts().handed_back({0: Bin.GOOD, 1: Bin.REJECT}, 100.0)
    assert counts.per_hour == 0.0, "one load has no speed"
    counts = counts.handed_back({0: Bin.GOOD, 1: Bin.GOOD, 2: Bin.AGAIN}, 160.0)
    assert counts.per_hour == 3600.0 * 3 / 60.0
    assert counts.since_start == {Bin.GOOD: 3, Bin.REJECT: 1, Bin.AGAIN: 1}


def test_a_reason_lasts_from_holding_to_unholding() -> None:
    reasons = after_change((), State.HOLDING, PAPER, 1.0)
    reasons = after_change(reasons, State.HELD, PAPER, 2.0)
    reasons = after_change(reasons, State.HELD, None, 3.0)
    assert [(r.why, r.began_s, r.ended_s) for r in reasons] == [(PAPER, 1.0, None)]
    reasons = after_change(reasons, State.UNHOLDING, None, 4.0)
    assert [(r.why, r.began_s, r.ended_s) for r in reasons] == [(PAPER, 1.0, 4.0)]
    reasons = after_change(reasons, State.ABORTING, STARVED, 5.0)
    assert [(r.why, r.state) for r in reasons] == [(STARVED, State.ABORTING), (PAPER, State.HOLDING)]


def test_a_refused_command_is_no_reason_to_stand() -> None:
    refused = Message("packml-command-refused", command="start", state="execute", allowed=["stop"])
    assert after_change((), State.EXECUTE, refused, 1.0) == ()


def test_only_the_newest_reasons_are_remembered() -> None:
    reasons = after_change((), State.HOLDING, PAPER, 0.0)
    for second in range(1, 50):
        reasons = after_change(reasons, State.SUSPENDING, Message("line-starved") if second % 2 else PAPER, second)
    assert len(reasons) == MOST_REASONS


def test_an_adjustment_comes_once_and_only_within_its_limits(tmp_path: Path) -> None:
    database = tmp_path / "station.db"
    send_line_adjustment(database, LineAdjustment(UnitMode.MAINTENANCE))
    adjustments = LineAdjustments(database)
    assert adjustments.next() is None, "what lay there before the line began is void"
    wanted = LineAdjustment(UnitMode.PRODUCE, {"starved_s": 9.0})
    send_line_adjustment(database, wanted)
    assert [adjustments.next(), adjustments.next()] == [wanted, None]
    file = companion_file(database, Companion.LINE_ADJUSTMENT)
    file.write_text(json.dumps({"number": 7, "mode": "produce", "times_s": {"starved_s": 1e9, "scan_s": 2}}))
    assert adjustments.next() == LineAdjustment(UnitMode.PRODUCE, {"scan_s": 2.0})
    file.write_text(json.dumps({"number": 8, "mode": "manual", "times_s": {}}))
    assert adjustments.next() is None
