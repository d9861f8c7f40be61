"""Sentences and tables on a screen: whole words, every digit, no line wider than the screen."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.cli._layout import TextTable, command_lines, sentence_lines

WIDTHS = st.integers(40, 120)
CELLS = st.text("0123456789.+-eSN", max_size=14)


def test_a_sentence_is_broken_between_words_and_goes_on_indented() -> None:
    lines = sentence_lines("  gain y is 0.9476, 5.2 % low; the limit is ±5 %", 30)
    assert lines == ["  gain y is 0.9476, 5.2 % low;", "    the limit is ±5 %"]


def test_a_broken_command_can_be_pasted() -> None:
    lines = command_lines("$ station run --serial SN0001 --serial SN0002", 30)
    assert lines == ["$ station run --serial \\", "  SN0001 --serial SN0002"]


@given(st.lists(st.lists(CELLS, min_size=9, max_size=9), max_size=4), WIDTHS)
def test_a_table_of_any_figures_fits_and_loses_none(rows: list[list[str]], width: int) -> None:
    heads = ("serial", "offset, g", "± 95 %", "first-pass yield", "mean time, s", "rms", "k", "U", "n")
    lines = list(TextTable(heads, rows, right=frozenset({1, 2})).lines(width))
    assert max(map(len, lines)) <= width
    shown = sorted(word for line in lines for word in line.replace("─", "").split())
    assert shown == sorted(word for row in (heads, *rows) for cell in row for word in cell.split())


@given(WIDTHS)
def test_heads_and_words_are_broken_before_a_row_is(width: int) -> None:
    words = "cannot be told from clamp-creep, warm-up, bias-drift and whatever else creeps"
    table = TextTable(("cause", "smallest", "remark"), [("settling", "0.0017", words)], words=frozenset({2}))
    lines = list(table.lines(width))
    assert max(map(len, lines)) <= width
    shown = " ".join(lines).replace("─", "").split()
    assert shown[:6] == ["cause", "smallest", "remark", "settling", "0.0017", "cannot"]


@pytest.mark.parametrize(("width", "height"), [(None, 3), (72, 4)])
def test_the_heads_are_broken_where_one_line_is_too_long(width: int | None, height: int) -> None:
    heads = ("station", "units", "first pass", "first-pass yield", "final yield", "FAIL", "ERROR", "mean time, s")
    table = TextTable(heads, [("rehearsal", "12", "10", "83.3 %", "83.3 %", "1", "1", "35.54")])
    lines = list(table.lines(width))
    assert len(lines) == height
    assert lines[-1].split() == ["rehearsal", "12", "10", "83.3", "%", "83.3", "%", "1", "1", "35.54"]


def test_a_long_name_gets_a_line_of_its_own_and_the_rest_of_its_row_stays_one_line() -> None:
    heads = ("serial", "verdict", "axis", "offset, g", "gain")
    rows = [("recording-of-a-unit-with-a-very-long-name", "PASS", "x", "+0.02", "1.01"), ("", "", "y", "-0.01", "0.99")]
    lines = list(TextTable(heads, rows, right=frozenset({3, 4})).lines(48))
    assert lines[-3] == rows[0][0]
    assert lines[-2].split() == list(rows[0][1:])
    assert lines[-1].split() == list(rows[1][2:])
    assert all(len(line) <= 48 for line in lines)
