"""The page's own record: appended, chained, and an edit is seen."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from station.errors import LogError, StoreFault
from station.panel_protocol.journal import Journal


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    made = Journal(tmp_path / "panel.jsonl", lambda: datetime(2026, 11, 21, tzinfo=UTC))
    for i in range(3):
        made.add("Zoë\n", "scan", serial=f"SN{i}")
    return made


def test_lines_come_back_in_their_order(journal: Journal) -> None:
    assert [line["detail"]["serial"] for line in journal.lines()] == ["SN0", "SN1", "SN2"]
    assert {line["person"] for line in journal.lines()} == {"Zoë\n"}


@pytest.mark.parametrize("number", [0, 1])
def test_an_edit_or_a_missing_line_is_seen(journal: Journal, number: int) -> None:
    lines = journal.path.read_text().splitlines(keepends=True)
    journal.path.write_text("".join([*lines[:number], lines[number].replace("SN", "XX"), *lines[number + 1 :]]))
    with pytest.raises(LogError, match=f"line {number + 2}"):
        list(journal.lines())
    journal.path.write_text("".join(lines[:number] + lines[number + 1 :]))
    with pytest.raises(LogError, match="edited"):
        list(journal.lines())


def test_what_cannot_be_kept_is_said(tmp_path: Path) -> None:
    with pytest.raises(StoreFault, match="cannot be written"):
        Journal(tmp_path / "none" / "panel.jsonl").add("a", "scan")


def test_a_line_that_a_power_cut_tore_keeps_its_place(journal: Journal) -> None:
    with journal.path.open("ab") as file:
        file.write(b'{"schema": "station.panel-jour')
    assert [line["deed"] for line in journal.lines()] == ["scan"] * 3 + ["torn"]
    journal.add("anna", "scan", serial="SN9")
    journal.add("anna", "stop")
    assert [line["deed"] for line in journal.lines()] == ["scan"] * 3 + ["torn", "scan", "stop"]
    raw = journal.path.read_bytes().splitlines(keepends=True)
    journal.path.write_bytes(b"".join([*raw[:3], b"another torn one\n", *raw[4:]]))
    with pytest.raises(LogError, match="line 5"):
        list(journal.lines())


def test_a_line_longer_than_one_look_is_chained_like_any_other(journal: Journal) -> None:
    journal.add("anna", "note", text="x" * 300_000)
    journal.add("anna", "scan", serial="SN9")
    assert len(list(journal.lines())) == 5
