"""Serials as they come: options, a scanner on standard input, a prompt."""

import io
from types import SimpleNamespace
from typing import Any

import pytest

from station.cli._serials import ask_serials
from station.config.recipes import load_recipe
from station.config.settings import Nest
from station.errors import UsageError


def bench(nests: int = 2, simulated: bool = False) -> Any:
    settings = SimpleNamespace(nests=tuple(Nest(name="ABCD"[i], node=17 + i) for i in range(nests)))
    return SimpleNamespace(
        simulated=simulated,
        job=SimpleNamespace(recipe=load_recipe("six-point")),
        station=SimpleNamespace(settings=settings),
    )


class Terminal(io.StringIO):
    """Standard input with a person at it."""

    def isatty(self) -> bool:
        return True


def feed(monkeypatch: pytest.MonkeyPatch, stdin: io.StringIO) -> None:
    monkeypatch.setattr("sys.stdin", stdin)


def test_options_are_taken_as_they_are() -> None:
    assert ask_serials(bench(), ["SN0042", "SN0043"], None) == ("SN0042", "SN0043")


def test_simulated_units_have_serials_of_their_own() -> None:
    assert ask_serials(bench(simulated=True), [], 3) == ("SN0001", "SN0002", "SN0003")
    assert ask_serials(bench(nests=4, simulated=True), [], None) == ("SN0001", "SN0002", "SN0003", "SN0004")


def test_a_scanner_types_lines_until_it_ends_or_enough_came(monkeypatch: pytest.MonkeyPatch) -> None:
    feed(monkeypatch, io.StringIO("SN0042\r\n\nSN0043\t\nSN0044\n"))
    assert ask_serials(bench(), [], None) == ("SN0042", "SN0043", "SN0044")
    feed(monkeypatch, io.StringIO("SN0042\nSN0043\nSN0044\n"))
    assert ask_serials(bench(), [], 2) == ("SN0042", "SN0043")


@pytest.mark.parametrize("text", ["X\n", "SN0042 SN0043\n", "S" * 10_000_000, "SN00\x1b[2J42\n", "\x00\n"])
def test_a_wrong_scan_stops_at_once_in_one_short_sentence(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    feed(monkeypatch, io.StringIO(text))
    with pytest.raises(UsageError) as caught:
        ask_serials(bench(), [], None)
    assert len(caught.value.sentence) < 300


def test_no_scan_at_all_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    feed(monkeypatch, io.StringIO(""))
    with pytest.raises(UsageError, match="No serial: give --serial"):
        ask_serials(bench(), [], None)


def test_a_person_is_asked_nest_by_nest_and_may_mistype(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    feed(monkeypatch, Terminal("SN0042\nnonsense\nSN0042\nSN0043\n"))
    assert ask_serials(bench(), [], None) == ("SN0042", "SN0043")
    requested = capsys.readouterr().err
    assert requested.count("nest A") == 1
    assert requested.count("nest B") == 3
    assert "does not match" in requested
    assert "is listed twice" in requested


def test_an_empty_line_starts_a_fixture_that_is_not_full(monkeypatch: pytest.MonkeyPatch) -> None:
    feed(monkeypatch, Terminal("SN0042\n\n"))
    assert ask_serials(bench(), [], None) == ("SN0042",)


def test_what_needs_a_person_is_refused_before_anything_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    from station.cli._run import _check_person

    feed(monkeypatch, io.StringIO(""))
    _check_person(bench(), 1)
    with pytest.raises(UsageError, match="More than 2 units need a person to change the load"):
        _check_person(bench(), 2)
    turned = bench()
    turned.job.recipe = load_recipe("tilt-24")
    with pytest.raises(UsageError, match="needs a person to turn the units"):
        _check_person(turned, 1)
    _check_person(bench(simulated=True), 9)
    feed(monkeypatch, Terminal(""))
    _check_person(turned, 2)
