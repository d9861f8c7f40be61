"""What the page shows of a line: its state, lamp and loads while its process lives, and nothing of one that is gone."""

import json
from pathlib import Path

import pytest

from station.domain.cell.handover import LoadJournal, OpenLoad, Place
from station.domain.cell.packml import State
from station.domain.cell.state_times import StateTimes
from station.messages import Message, labels
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.line_state import LineStateWriter
from station.web.line_glance import LineGlance


def write(database: Path, state: State, why: Message | None = None) -> None:
    """The line's own file in that state, with load 7 in the nests."""
    journal = LoadJournal(OpenLoad(1, 7, (Place(0, "A", "SN1"),), None), 6)
    LineStateWriter(database, "S1", "six-point/1", ("A",)).write(StateTimes.begin(state, 0.0), journal, 6, why, 1.0)


@pytest.mark.parametrize(
    ("state", "lamp"),
    [
        (State.EXECUTE, "green"),
        (State.HELD, "blue"),
        (State.SUSPENDED, "amber"),
        (State.ABORTED, "red"),
        (State.IDLE, "white"),
    ],
)
def test_a_line_that_lives_is_shown(tmp_path: Path, state: State, lamp: str) -> None:
    write(tmp_path / "station.db", state)
    shown = LineGlance(tmp_path / "station.db").shown()
    assert shown == {"state": state.label, "lamp": lamp, "load": 7, "loads": 6, "why": None}


def test_why_it_is_held_goes_with_it(tmp_path: Path) -> None:
    write(tmp_path / "station.db", State.HELD, Message("printer-paper"))
    assert LineGlance(tmp_path / "station.db").shown()["why"]["id"] == "printer-paper"


def test_a_line_that_is_gone_or_never_was_shows_nothing(tmp_path: Path) -> None:
    database = tmp_path / "station.db"
    assert LineGlance(database).shown() == {}
    write(database, State.EXECUTE)
    file = companion_file(database, Companion.LINE)
    file.write_text(json.dumps(json.loads(file.read_text()) | {"pid": 2**22 + 1}))
    assert LineGlance(database).shown() == {}


def test_every_state_has_its_word_in_every_language() -> None:
    for code, texts in labels.all_texts().items():
        assert all(f"line_{state.label}" in texts for state in State), code
