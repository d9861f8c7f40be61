"""The fault table: each fault, injected into a whole run, has its outcome, its sentence and its exit code."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from station.cli._run import exit_code
from station.domain.run.progress import LoadDone, UnitDone
from station.errors import StationError
from tests.fakes.fixture_run import Ran
from tests.faults.document import PAGE, document
from tests.faults.inject import injected
from tests.faults.table import ROWS, Row
from tests.portion import one_of_each

SERIAL = "SN0001"
_OPENING = ("log garbage", "log newer", "log nowhere", "log in use", "gold due=2020-01-31")

#: Of what happens in a run `make test` tries one row of each kind.
RUNNING = one_of_each([row for row in ROWS if row.inject not in _OPENING], lambda row: row.kind)


def held(ran: Ran) -> str:
    """What the flash holds of the calibration that the run computed."""
    memory = ran.memory(SERIAL)
    if not memory:
        return "nothing new"
    fit = ran.results[SERIAL].fit
    assert fit is not None
    assert fit.calibration is not None, "something was saved although nothing was computed"
    assert ran.stored(SERIAL, "write-plan") is not None, "something was saved although nothing was planned"
    wanted = [*fit.calibration.matrix.ravel(), *fit.calibration.offset]
    same = [abs(a - b) < 1e-6 for a, b in zip(ran.coefficients(SERIAL), wanted, strict=False)]
    return "new" if same and all(same) else "mixed"


@pytest.mark.parametrize("row", RUNNING, ids=lambda r: r.inject)
def test_one_outcome_one_sentence_and_nothing_half_written(tmp_path: Path, row: Row) -> None:
    ran = injected(row.inject, tmp_path).run(tmp_path)
    r = ran.results[SERIAL]
    assert str(r.outcome) == row.outcome, r.reasons
    assert exit_code(list(ran.results.values()), ran.fault) == row.code
    assert row.says in (r.reasons[0].sentence if r.reasons else "")
    assert bool(r.reasons) is (row.outcome != "PASS")
    assert all(reason.sentence.isprintable() and len(reason.sentence) < 500 for reason in r.reasons)
    assert held(ran) == row.flash
    assert ran.parked is row.parked
    check_record(ran, row)


def sentences(life: dict[str, Any]) -> Iterator[str]:
    """Everything that the record says in words beside the verdict; '' where it says nothing."""
    yield ""
    yield from (e["detail"].get("sentence", "") for e in life["events"])
    for visit in life["visits"]:
        yield from (*visit["statistics"]["bus_errors"], *visit["statistics"]["reasons"])


def check_record(ran: Ran, row: Row) -> None:
    """The log says the same as the page; where it could not be written any more, the attempt is left open."""
    r, life = ran.results[SERIAL], ran.life(SERIAL)
    if row.area == "The log":
        assert life["outcome"] in (None, row.outcome)  # a full disk may still take a short record
        return
    assert life["outcome"] == row.outcome
    stored = ran.stored(SERIAL, "verdict")
    assert [x["sentence"] for x in stored["reasons"]] == [x.sentence for x in r.reasons]
    assert r.verified is (row.outcome == "PASS")
    assert any(row.keeps in sentence for sentence in sentences(life)), list(sentences(life))
    if row.flash == "mixed":
        assert (ran.stored(SERIAL, "device-state") or {}).get("state") != "new"


@pytest.mark.parametrize("row", [r for r in ROWS if r.inject in _OPENING], ids=lambda r: r.inject)
def test_a_station_that_cannot_keep_a_record_does_not_start(tmp_path: Path, row: Row) -> None:
    with pytest.raises(StationError) as refused:
        injected(row.inject, tmp_path).run(tmp_path)
    assert (refused.value.outcome, refused.value.exit_code) == (row.outcome, row.code)
    assert row.says in refused.value.sentence
    assert not (tmp_path / "devices").exists()


def test_nothing_is_told_twice_and_the_last_word_follows_the_units(tmp_path: Path) -> None:
    ran = injected("device save-fails", tmp_path).run(tmp_path)
    assert len(ran.of(UnitDone)) == len(ran.of(LoadDone)) == 1


def test_the_table_is_large_and_says_nothing_twice() -> None:
    assert len(ROWS) >= 220
    assert len({row.inject for row in ROWS}) == len(ROWS)
    assert len({(row.area, row.fault) for row in ROWS}) == len(ROWS)


def test_the_page_is_the_table() -> None:
    assert PAGE.read_text(encoding="utf-8") == document(), "docs/faults.md is stale: python -m tests.faults.document"
