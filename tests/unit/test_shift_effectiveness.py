"""Effectiveness by shift out of a real log: states as a line left them, a crash in the middle, first attempts."""

from pathlib import Path

import pytest

from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.domain.cell.packml import State
from station.ports.log_reader import Query
from station.ports.store import AttemptStart
from station.reporting.line import charts
from station.reporting.words import words_of
from station.service.line_statistics import gather_statistics
from station.service.shift_effectiveness import START_EVENT, STATE_EVENT, shift_effectiveness

HOUR = 3600


@pytest.fixture
def log(tmp_path: Path) -> SqliteLogReader:
    """6:00 execute; 7:00 held; 7:30 execute; 8:00 last word of a line that died; 9:00 started again; 9:10 execute."""
    now = [0.0]
    store = SqliteStore(tmp_path / "station.db", epoch_ns=lambda: round(now[0] * 1e9))

    def entered(hour: float, kind: str, state: State) -> None:
        now[0] = hour * HOUR
        shifts = {"shift_h": 8.0, "shift_begins_h": 6.0, "ideal_s": 600.0} if kind == START_EVENT else {}
        store.event("", kind, {"state": int(state), **shifts})

    def unit(hour: float, serial: str, outcome: str) -> None:
        now[0] = hour * HOUR
        start = AttemptStart(serial, "s", "A", 17, "r", 1, "h", "{}", "c", "v", "", round(now[0] * 1e9))
        store.finish(store.begin(start), outcome, round(now[0] * 1e9))

    entered(6, START_EVENT, State.STOPPED)
    entered(6, STATE_EVENT, State.EXECUTE)
    unit(6.5, "SN1", "PASS")
    entered(7, STATE_EVENT, State.HELD)
    entered(7.5, STATE_EVENT, State.EXECUTE)
    unit(7.6, "SN2", "FAIL")
    unit(7.7, "SN2", "PASS")
    entered(8, STATE_EVENT, State.SUSPENDED)
    entered(9, START_EVENT, State.ABORTED)
    entered(9 + 1 / 6, STATE_EVENT, State.EXECUTE)
    entered(10, STATE_EVENT, State.STOPPED)
    store.close()
    return SqliteLogReader(tmp_path / "station.db")


def test_a_shift_by_hand(log: SqliteLogReader) -> None:
    with log:
        (shift,) = shift_effectiveness(log, Query())
    assert shift.held_s == 0.5 * HOUR
    assert shift.aborted_s == pytest.approx((1 + 1 / 6) * HOUR), "from its last word until it worked again"
    assert shift.suspended_s == 0
    assert shift.producing_s == pytest.approx((1 + 0.5 + 5 / 6) * HOUR)
    assert shift.planned_s == pytest.approx(4 * HOUR)
    assert (shift.units, shift.good) == (2, 1)
    assert shift.performance == pytest.approx(1200 / shift.producing_s)


def test_the_charts_show_it(log: SqliteLogReader) -> None:
    with log:
        line = gather_statistics(log, Query(serial="none"), 10)
        drawn = charts.draw(line, "offset x", 1, words_of("de"))
    table = next(t for t in drawn.tables if t.title == "Anlageneffektivität nach Schicht")
    assert table.rows[0][0] == "1970-01-01 06:00"
    assert any("Verfügbarkeit" in str(figure) for figure in drawn.figures)


def test_without_a_line_there_is_none(tmp_path: Path) -> None:
    SqliteStore(tmp_path / "station.db").close()
    with SqliteLogReader(tmp_path / "station.db") as log:
        assert shift_effectiveness(log, Query()) == ()
