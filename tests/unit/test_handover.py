"""What to do next with a load, from the journal, the log's verdicts and the cell."""

from collections.abc import Sequence

import pytest

from station.domain.cell.handover import (
    Bin,
    CellView,
    Close,
    Entry,
    Hold,
    LoadJournal,
    Measure,
    Offer,
    Place,
    Step,
    Take,
    Wait,
    decide,
    pack_bins,
    unpack_bins,
    verdict,
)
from tests.fakes import crashing_cell

A, B = Place(0, "A", "SN1"), Place(1, "B", "SN2")
TAKEN = Entry(5, "taken", 7, (A, B))
GOOD = {0: 1, 1: 2}
OFFERED = Entry(9, "offered", 7, bins=GOOD)
DECIDED = {0: ["PASS"], 1: ["INTERRUPTED", "FAIL"]}


def cell(
    load: int = 7, taken: int = 6, bins: dict[int, int] | None = None, *places: int, ready: bool = True
) -> CellView:
    return CellView(load, ready, frozenset(places or (0, 1)), taken, bins or {})


@pytest.mark.parametrize(
    ("entries", "view", "outcomes", "step"),
    [
        ([], cell(ready=False), {}, Wait()),
        ([], cell(), {}, Take(7, frozenset({0, 1}))),
        ([TAKEN], cell(), {}, Measure(7, (A, B))),
        ([TAKEN], cell(), {0: ["PASS"]}, Measure(7, (B,))),
        ([TAKEN], cell(), {0: ["PASS"], 1: ["INTERRUPTED"]}, Measure(7, (B,))),
        ([TAKEN], cell(), {0: ["PASS"], 1: ["INTERRUPTED"] * 2}, Offer(7, {0: 1, 1: 3}, record=True)),
        ([TAKEN], cell(), DECIDED, Offer(7, GOOD, record=True)),
        ([TAKEN, OFFERED], cell(), DECIDED, Offer(7, GOOD, record=False)),
        ([TAKEN, OFFERED], cell(7, 7, GOOD, ready=False), DECIDED, Close(7, GOOD)),
        ([TAKEN, OFFERED, Entry(10, "handed", 7, bins=GOOD)], cell(8, 7, GOOD), {}, Take(8, frozenset({0, 1}))),
        ([Entry(4, "taken", 7, (A, Place(1, "B", "")))], cell(), {0: ["ERROR"]}, Offer(7, {0: 3, 1: 3}, record=True)),
    ],
)
def test_the_next_step(entries: list[Entry], view: CellView, outcomes: dict[int, Sequence[str]], step: Step) -> None:
    assert decide(LoadJournal.of(entries), view, outcomes) == step


@pytest.mark.parametrize(
    ("entries", "view", "why"),
    [
        ([TAKEN], cell(8), "cell-load-gone"),
        ([TAKEN], cell(7, 6, None, 0), "cell-parts-changed"),
        ([TAKEN], cell(7, 7, GOOD), "cell-taken-unasked"),
        ([TAKEN, OFFERED], cell(7, 7, {0: 1, 1: 1}), "cell-bins-differ"),
        ([TAKEN, Entry(9, "offered", 7, bins={0: 1, 1: 1})], cell(), "cell-verdict-changed"),
        ([TAKEN, OFFERED, Entry(10, "handed", 7)], cell(), "cell-load-repeated"),
    ],
)
def test_a_person_must_look(entries: list[Entry], view: CellView, why: str) -> None:
    step = decide(LoadJournal.of(entries), view, DECIDED)
    assert isinstance(step, Hold)
    assert step.why.id == why


def test_only_a_pass_goes_to_the_good_ones() -> None:
    for outcome in ("FAIL", "ERROR", "ABORTED"):
        step = decide(LoadJournal.of([Entry(1, "taken", 7, (A,))]), cell(7, 6, None, 0), {0: [outcome]})
        assert isinstance(step, Offer)
        assert step.bins[0] != Bin.GOOD


def test_the_first_verdict_counts() -> None:
    assert verdict(["INTERRUPTED", "FAIL", "PASS"]) == "FAIL"
    assert verdict([]) is None


def test_an_entry_comes_back_from_the_log() -> None:
    for entry in (TAKEN, OFFERED):
        assert Entry.of(entry.number, entry.document()) == entry


def test_bins_come_back_from_their_word() -> None:
    bins = {0: 1, 3: 2, 15: 3}
    assert unpack_bins(pack_bins(bins)) == bins


@pytest.mark.parametrize("seed", range(4))
def test_crashes_at_random_instants_spoil_nothing(seed: int) -> None:
    judged = crashing_cell.endure(120, seed)
    assert judged.faults == 0, judged
    assert judged.units > 30


def test_the_judge_notices_a_station_that_forgets_its_verdicts(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = crashing_cell.DurableLog.outcomes

    def forgetful(log: crashing_cell.DurableLog, serial: str, nest: str, beyond: int) -> list[str]:
        found = honest(log, serial, nest, beyond)
        return [] if log.chance.rng.random() < 0.2 else found

    monkeypatch.setattr(crashing_cell.DurableLog, "outcomes", forgetful)
    assert crashing_cell.endure(60, 1).twice > 0
