"""The phases of a fixture load: every one can end, none can be skipped, and the runner's stop is kept."""

from pathlib import Path

import pytest

from station.domain.run.progress import PHASES, Phase
from station.errors import Aborted, StationFault
from station.messages import Message
from station.service.stop_request import StopRequest


def test_every_phase_is_in_the_table_and_can_be_closed() -> None:
    assert set(PHASES.after) == set(Phase)
    for phase in Phase:
        if phase not in (Phase.CLOSE, Phase.PARK, Phase.DONE):
            assert Phase.CLOSE in PHASES.after[phase]


def test_nothing_is_written_before_it_is_judged_nor_passed_before_it_is_parked() -> None:
    before = {after: {p for p in Phase if after in PHASES.after[p]} for after in Phase}
    assert before[Phase.WRITE] == {Phase.JUDGE}
    assert before[Phase.SAVE] == {Phase.WRITE}
    assert before[Phase.VERIFY] == {Phase.RESTART}
    assert before[Phase.DONE] == {Phase.PARK}


@pytest.mark.parametrize("wanted", list(Phase))
@pytest.mark.parametrize("present", list(Phase))
def test_follow_keeps_to_the_table(present: Phase, wanted: Phase) -> None:
    if wanted in PHASES.after[present]:
        assert PHASES.follow(present, wanted) is wanted
    else:
        with pytest.raises(StationFault, match=f"from {present} to {wanted}"):
            PHASES.follow(present, wanted)


def test_the_diagram_draws_every_transition_once() -> None:
    lines = PHASES.diagram().splitlines()
    assert len(lines) == len(set(lines)) == 3 + sum(map(len, PHASES.after.values()))


def test_a_stop_is_seen_at_the_next_check_and_keeps_its_first_reason() -> None:
    stop = StopRequest()
    stop.check()
    stop.request(Message.text("cover opened"))
    stop.request(Message.text("again"))
    with pytest.raises(Aborted, match="cover opened"):
        stop.check()


def test_a_stop_asked_for_is_seen_before_waiting_begins() -> None:
    stop = StopRequest()
    with stop:
        inside = stop.waiting
    assert (inside, stop.waiting) == (True, False)
    stop.request()
    with pytest.raises(Aborted), stop:
        raise AssertionError("must not come here")
    assert not stop.waiting


def test_the_drawn_diagram_is_that_of_the_table() -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "decisions" / "0020-the-run.md"
    assert f"```mermaid\n{PHASES.diagram()}\n```" in page.read_text(encoding="utf-8")
