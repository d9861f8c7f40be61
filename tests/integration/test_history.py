"""A run learns process and reproducibility from the station's log, keeps what it learnt, and is refitted by it."""

import json
from typing import Any

import numpy as np
import pytest

from station.adapters.store.reader import SqliteLogReader
from station.cli.app import main
from station.domain.methods import coefficients, uncertainty
from station.domain.records import stored_attempt
from station.domain.run.progress import Event, LoadStarted
from station.messages import Message
from station.ports.log_reader import Attempt, Query
from station.ports.store import AttemptStart
from station.service.recompute import recompute
from station.service.stop_request import StopRequest
from station.wiring.bench import Bench
from tests.fakes import fixture_run

GOLDEN, SCATTER, SOFTWARE = "SN9001", 0.002, "0+simulated"


def past(bench: Bench, serial: str, number: int, rng: np.random.Generator) -> None:
    """A finished attempt with the bench's recipe, its coefficients drawn here."""
    store, job = bench.station.store, bench.job
    attempt = store.begin(
        AttemptStart(
            serial, "S", "ABCD"[number % 4], 17, job.recipe.name, 1, job.recipe_hash, job.recipe_json, "",
            SOFTWARE, "", bench.station.clock.epoch_ns() - 86_400_000_000_000 * (30 - number),
        )
    )  # fmt: skip
    theta = coefficients.NOMINAL + SCATTER * rng.standard_normal(12)
    budget = [{"coefficient": n, "parts": {"noise": 1e-5}} for n in coefficients.NAMES]
    fit: dict[str, Any] = {"offset": theta[:3].tolist(), "matrix": theta[3:].reshape(3, 3).tolist(), "budget": budget}
    fit |= {"residuals": {"ratio": rng.chisquare(6) / 6, "dof": 6.0}, "rules": uncertainty.RULES}
    store.result(attempt, "calibration", fit)
    store.finish(attempt, "PASS", bench.station.clock.epoch_ns())


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> fixture_run.Ran:
    folder = tmp_path_factory.mktemp("history")
    register = {
        "serial": GOLDEN,
        "kind": "golden",
        "recipe": "",
        "outcome": "PASS",
        "values": {},
        "checks": [],
        "due": "",
    }
    (folder / "golden.json").write_text(json.dumps({"units": [register]}))
    golden = {"file": str(folder / "golden.json"), "every_h": 8}
    config = fixture_run.config(folder, golden=golden, database=str(folder / "station.db"))
    rng = np.random.default_rng(5)

    def teach(event: Event, _stop: StopRequest, bench: Bench) -> None:
        if isinstance(event, LoadStarted):
            for number in range(30):
                past(bench, GOLDEN if number < 10 else f"P{number}", number, rng)

    return fixture_run.run(folder, [GOLDEN], config=config, hook=teach)


def test_the_budget_holds_what_golden_units_showed(ran: fixture_run.Ran) -> None:
    """Ten results of one unit on ten days in four nests, 2e-3 apart: 9 degrees of freedom."""
    own = next(life for life in ran.lives(GOLDEN) if life["software"] != SOFTWARE)
    history, fit = stored_attempt.result(own, "history"), stored_attempt.result(own, "calibration")
    again = history["reproducibility"]
    # σ of 27 squares: 2e-3 · (1 ± 3/√54).
    assert again["dof"] == 9 and again["offset"] == pytest.approx(SCATTER, rel=3 / 54**0.5)
    assert (history["repeats"], history["golden"], history["days"], history["nests"]) == (10, 1, 10, 4)
    assert history["units"] == 20 and history["process"]["of_results"]
    # Residuals of 20 units are as noise makes them: they count with up to 20 · 6 degrees of freedom.
    assert 1 <= history["residuals"]["ratio"] < 1.6 and 6 < history["residuals"]["dof"] <= 120
    assert {b["parts"]["reproducibility"] for b in fit["budget"][:3]} == {again["offset"]}


def test_the_refit_knows_what_the_run_knew(ran: fixture_run.Ran) -> None:
    with SqliteLogReader(ran.folder / "station.db") as log:
        own = next(a for a in log.attempts(Query(serial=GOLDEN)) if a.software != SOFTWARE)
        found = recompute(log, own)
    assert found.compared > 500 and found.identical


class OlderRules(SqliteLogReader):
    """The log as an older version wrote it, which left out readings that this one does not."""

    def attempt(self, attempt: Attempt) -> dict[str, Any]:
        """The record."""
        record = super().attempt(attempt)
        fit = stored_attempt.result(record, "calibration")
        note = Message("readings-left-out", left_out=3, count=600, place="", left_out_there=3, count_there=100)
        fit |= {"rules": uncertainty.RULES - 1, "note_messages": [note.document()]}
        fit["offset"][0] += 1e-5
        return record


def test_readings_that_older_rules_left_out_are_no_forgery(ran: fixture_run.Ran) -> None:
    with OlderRules(ran.folder / "station.db") as log:
        own = next(a for a in log.attempts(Query(serial=GOLDEN)) if a.software != SOFTWARE)
        found = recompute(log, own)
    assert found.identical and "left out other readings" in found.skipped


def test_a_backtest_judges_by_what_the_run_had_learnt(ran: fixture_run.Ran, capsys: pytest.CaptureFixture[str]) -> None:
    """With the limit of 4 mg no offset is decided under a reproducibility of 2 mg; without it each would be."""
    tight = fixture_run.recipe(ran.folder, limits={"offset": 0.004, "rule": "guard-band"})
    words = ["backtest", "--db", str(ran.folder / "station.db"), "--processes", "1", "--json", "--recipe"]
    found = {}
    for name in ("six-point", tight):
        with pytest.raises(SystemExit) as ended:
            main([*words, name])
        assert ended.value.code == 0
        found[name] = json.loads(capsys.readouterr().out)
    assert found["six-point"]["judged_with_history"] == 1 and found["six-point"]["changed"] == []
    (change,) = found[tight]["changed"]
    assert sum("this recipe cannot decide it" in reason for reason in change["reasons"]) == 3


def test_check_shows_it(ran: fixture_run.Ran, capsys: pytest.CaptureFixture[str]) -> None:
    where = ("--db", str(ran.folder / "station.db"), "--config", str(ran.folder / "config.yaml"))
    with pytest.raises(SystemExit) as ended:
        main(["check", "six-point", *where])
    shown = " ".join(capsys.readouterr().out.split())
    assert ended.value.code == 0
    assert "the newest results of 20 units" in shown and "11 results of 1 golden unit, 11 days, 5 nests" in shown
    assert "reproducibility, % of u²" in shown and "residuals of earlier units have" in shown


def test_a_reference_past_its_due_date_stops_check_and_run(
    ran: fixture_run.Ran, capsys: pytest.CaptureFixture[str]
) -> None:
    late = {"item": "fixture", "number": "C-1", "due": "2026-01-31"}
    reference = {"source": "gravity", "magnitude": 1.0, "magnitude_std": 0.001, "certificates": [late]}
    recipe = fixture_run.recipe(ran.folder, reference=reference)
    for words in (("check", recipe), ("run", "--simulate", "--units", "1", "--recipe", recipe)):
        with pytest.raises(SystemExit) as ended:
            main([*words, "--db", str(ran.folder / "station.db"), "--config", str(ran.folder / "config.yaml")])
        assert ended.value.code == 3
        assert "was due on 2026-01-31" in capsys.readouterr().err
