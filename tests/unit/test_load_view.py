"""The five states of the operator's screen, from facts alone; the time line of a load; the tile of a verdict."""

import pytest

from station.domain.core.types import NestAssignment
from station.domain.run.progress import LoadStarted, Phase, PhaseEntered, VisitStarted, WarmUpStarted
from station.messages import Message, languages
from station.panel_protocol import timeline
from station.reporting.drawing.code128 import code128, symbols
from station.web.load_view import Facts, view_of
from station.web.plan import plan_document
from station.web.tile import tile_of
from station.wiring.jobs import load_job

NESTS = ("A", "B")
PASSED, FAILED, LOST = ({"nest": n, "outcome": o} for n, o in (("A", "PASS"), ("B", "FAIL"), ("B", "ERROR")))


@pytest.mark.parametrize(
    ("facts", "state", "why", "lamp"),
    [
        (Facts(NESTS), "scan", "", "white"),
        (Facts(NESTS, waiting={"A": "1"}), "scan", "", "white"),
        (Facts(NESTS, waiting={"A": "1", "B": "2"}), "ready", "", "white"),
        (Facts(NESTS, running=True), "running", "", "green"),
        (Facts(NESTS, running=True, question=True), "act", "question", "blue"),
        (Facts(NESTS, running=True, instruction=True), "act", "turn", "blue"),
        (Facts(NESTS, entries=[PASSED]), "done", "", "green"),
        (Facts(NESTS, entries=[PASSED, FAILED]), "done", "", "amber"),
        (Facts(NESTS, entries=[PASSED, LOST], fault=True), "act", "fault", "red"),
        (Facts(NESTS, entries=[PASSED, FAILED], fault=True), "done", "", "amber"),
        (Facts(NESTS, entries=[PASSED, FAILED], fault=True, binned=True), "act", "fault", "red"),
        (Facts(NESTS, entries=[PASSED, FAILED], fault=True, binned=True, cleared=True), "scan", "", "white"),
    ],
)
def test_the_state_follows_from_the_facts(facts: Facts, state: str, why: str, lamp: str) -> None:
    found = view_of(facts)
    assert (found.state, found.why, found.lamp) == (state, why, lamp)


def test_the_free_nest_is_scanned_next_and_failed_units_wait_for_the_bin() -> None:
    assert view_of(Facts(NESTS, waiting={"A": "1"})).turn == "B"
    found = view_of(Facts(NESTS, entries=[PASSED, FAILED]))
    assert (found.bin, found.again) == (("B",), ())
    assert view_of(Facts(NESTS, entries=[PASSED, LOST], cleared=True)).again == ("B",)


def test_the_time_line_learns_how_long_each_cell_takes() -> None:
    cells = timeline.cells_of(load_job("six-point")[0].recipe)
    line = timeline.Timeline(cells).after(LoadStarted((NestAssignment("SN1", "A", 17),), 8, 60.0), 100.0)
    assert sum(c.expected_s for c in line.cells if c.kind in ("stop", "verify")) == pytest.approx(60.0)
    for number in range(1, 7):
        line = line.after(VisitStarted(number, 6, "p"), 100.0 + 5.0 * number)
    line = line.after(PhaseEntered(Phase.WRITE), 135.5)
    line = line.after(VisitStarted(1, 2, "verify-x"), 136.0)
    assert [c.expected_s for c in line.cells[:7]] == pytest.approx([5.0] * 6 + [5.5])
    assert line.cells[line.at].kind == "write", "verification belongs to its own cell"
    again = timeline.learned(cells, line.document()["expected_s"])
    assert [c.expected_s for c in again[:7]] == pytest.approx([5.0] * 6 + [5.5])
    assert timeline.learned(cells, [1.0]) == cells, "the times of another recipe are nobody's"


def test_a_warm_up_and_a_turn_have_cells_of_their_own() -> None:
    recipe = load_job("tilt-24")[0].recipe
    cells = timeline.cells_of(recipe)
    kinds = [c.kind for c in cells if c.kind != "stop"]
    assert kinds[0] == "identify"
    assert "turn" in kinds
    line = timeline.Timeline(cells, at=3, since_s=1.0)
    waiting_for = line.waiting_for(Message("turn-units", number=2, angle_deg=180.0, axis="z", seating="turned"), 50.0)
    assert (cells[waiting_for.at].kind, cells[waiting_for.at].run) == ("turn", 1)
    assert waiting_for.cells == cells, "a person's time is no forecast"
    warm = next((i for i, c in enumerate(cells) if c.kind == "warm-up"), None)
    if warm is not None:
        heated = line.after(WarmUpStarted(cells[warm].run + 1, 600.0), 10.0)
        assert (heated.at, heated.warm_until_s) == (warm, 610.0)


def test_a_plan_draws_each_picture_once() -> None:
    plan = plan_document(timeline.cell_documents(timeline.cells_of(load_job("six-point")[0].recipe)))
    assert [c["up"] for c in plan["cells"] if c["kind"] == "stop"] == ["+z", "−z", "+x", "−x", "+y", "−y"]
    assert len(plan["pictures"]) <= 7
    assert len(set(plan["pictures"])) == len(plan["pictures"])


@pytest.mark.parametrize("code", languages())
def test_a_tile_says_value_deviation_and_limit(code: str) -> None:
    gain = {"what": "gain y", "value": 0.9476, "low": 0.95, "high": 1.05, "target": 1.0, "unit": "1"}
    tile = tile_of(gain, code)
    assert tile is not None
    assert "0.9476" in tile["head"]
    assert "5.2" in tile["line"]
    assert "±5" in tile["line"]
    bar = tile["bar"]
    assert bar["value"] < bar["low"] < bar["target"] < bar["high"]
    assert not bar["inside"]
    error = {"what": "output error", "value": 0.0011, "low": 0.0, "high": 0.005, "target": 0.0, "unit": "g"}
    small = tile_of(error, code)
    assert small is not None
    assert "1.1 mg" in small["head"]
    assert "5 mg" in small["line"]
    assert tile_of(None, code) is None


def test_a_card_is_code_128() -> None:
    # Of PJJ123C the literature gives check symbol 54 with start A (103), so with start B (104) it is 55.
    assert symbols("PJJ123C")[-2] == 55
    assert code128("START").count("M") == 3 * (len("START") + 2) + 4
    with pytest.raises(ValueError, match="ASCII"):
        code128("ä")
