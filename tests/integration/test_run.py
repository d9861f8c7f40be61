"""The run, end to end on the virtual bus: order of deeds, record, verdicts, several nests and loads."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.adapters.store.reader import SqliteLogReader
from station.cli.app import main
from station.domain.can import decode
from station.domain.core.types import Outcome
from station.domain.run.progress import (
    Identified,
    Judged,
    LoadDone,
    Notice,
    ObjectWritten,
    Phase,
    PhaseEntered,
    UnitDone,
    VisitDone,
    VisitStarted,
)
from station.messages import Message, render
from station.ports.log_reader import Query
from station.service.recompute import parse_recipe_and_product, recompute, refit_attempt, stored_visits
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran


@pytest.fixture(scope="module")
def four(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    return fixture_run.run(tmp_path_factory.mktemp("four"), units=4)


def test_every_nest_passes_with_a_calibration_of_its_own(four: Ran) -> None:
    assert [r.outcome for r in four.results.values()] == [Outcome.PASS] * 4
    assert all(r.written and r.verified for r in four.results.values())
    offsets = [tuple(r.fit.calibration.offset) for r in four.results.values() if r.fit and r.fit.calibration]
    assert len(set(offsets)) == 4
    assert four.fault is None
    assert four.parked


def test_phases_come_in_order_and_pass_is_said_last(four: Ran) -> None:
    phases = [e.phase for e in four.of(PhaseEntered)]
    assert phases == [p for p in Phase if p is not Phase.BEGIN]
    kinds = [type(e) for e in four.events]
    assert kinds.index(UnitDone) > max(i for i, k in enumerate(kinds) if k is VisitDone)
    assert kinds[-1] is LoadDone
    assert [len(four.of(k)) for k in (Identified, Judged, UnitDone)] == [4, 4, 4]
    assert len(four.of(VisitDone)) == len(four.of(VisitStarted)) == 8
    assert {e.number for e in four.of(ObjectWritten)} == set(range(1, max(e.total for e in four.of(ObjectWritten)) + 1))


def test_the_device_keeps_what_was_computed_to_the_last_bit(four: Ran) -> None:
    for serial, r in four.results.items():
        assert r.fit is not None
        assert r.fit.calibration is not None
        wanted = np.concatenate([r.fit.calibration.matrix.ravel(), r.fit.calibration.offset]).astype(np.float32)
        assert np.array(four.coefficients(serial), np.float32).tolist() == wanted.tolist()
        assert four.memory(serial)["2106:00"] == 1, "compensated output is what is saved"
        assert four.memory(serial)["2107:00"] == 1, "marked valid"
        assert four.memory(serial)["2100:00"] == r.attempt, "the device points back at its record"


def test_the_log_keeps_all_that_the_contract_lists(four: Ran) -> None:
    life = four.life("SN0003")
    assert life["outcome"] == "PASS"
    assert (life["nest"], life["recipe_name"], life["recipe_version"]) == ("C", "six-point", 1)
    assert [v["kind"] for v in life["visits"]] == ["tumble"] * 6 + ["verify"] * 2
    assert all(v["frame_count"] > 100 and v["statistics"]["kernel_drops"] == 0 for v in life["visits"])
    assert {r["name"] for r in life["results"]} >= {
        "identity", "old-calibration", "calibration", "write-plan", "device-state", "verification", "verdict",
    }  # fmt: skip
    assert four.stored("SN0003", "identity")["serial"] == 3
    assert four.stored("SN0003", "device-state") == {"state": "new"}
    assert four.stored("SN0003", "verdict")["outcome"] == "PASS"
    for row in life["writes"]:
        assert row["stage"] in ("intent", "written", "verified")
        assert row["read_back"] in (None, row["written"])


def test_every_write_is_an_intent_first(four: Ran) -> None:
    rows = four.life("SN0001")["writes"]
    for intent, fact in zip(rows[::2], rows[1::2], strict=True):
        assert intent["stage"] == "intent"
        assert fact["stage"] in ("written", "verified")
        assert (intent["object"], intent["name"], intent["written"]) == (fact["object"], fact["name"], fact["written"])
    assert rows[-1]["name"] == "save"
    assert rows[-1]["stage"] == "written"


def test_coefficients_are_the_truth_within_their_uncertainty(four: Ran, tmp_path: Path) -> None:
    from station.config.recipes import load_recipe
    from station.domain.recipe.recipe import Recipe
    from station.model.simulate import SimulationJob

    recipe: Recipe = load_recipe("six-point")
    base = SimulationJob(recipe, tuple(four.results), 1).base(tuple(four.results))
    z = []
    for u, r in enumerate(four.results.values()):
        assert r.fit is not None
        assert r.fit.calibration is not None
        found = np.concatenate([r.fit.calibration.offset, r.fit.calibration.matrix.ravel()])
        true = np.concatenate([base.offset[u], base.matrix[u].ravel()])
        z.append((found - true) / np.sqrt(np.diagonal(r.fit.calibration.covariance)))
    # 48 coefficients, some of them correlated; beyond 5 sigma is one in a million each. Pose errors of the
    # simulated positioner (0.01 degrees) are in the budget only through the residuals.
    assert np.abs(np.array(z)).max() < 5


def test_verification_is_of_the_devices_own_output(four: Ran) -> None:
    shown = four.stored("SN0002", "verification")
    assert [p["name"] for p in shown["positions"]] == ["verify-x", "verify-tilt"]
    assert all(p["error"] < shown["limit"] for p in shown["positions"])
    np.testing.assert_allclose(shown["positions"][1]["mean"], [0, 2**-0.5, 2**-0.5], atol=0.002)


def test_more_units_than_nests_are_several_loads(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, units=5)
    assert [r.outcome for r in ran.results.values()] == [Outcome.PASS] * 5
    assert len(ran.of(LoadDone)) == 2
    assert ran.results["SN0005"].seat.nest == "A"
    assert ran.stored("SN0005", "identity")["serial"] == 5


def test_one_unit_is_no_other_path(four: Ran, tmp_path: Path) -> None:
    alone = fixture_run.run(tmp_path, units=1)
    assert [type(e) for e in alone.events if not isinstance(e, Identified | Judged | ObjectWritten | UnitDone)] == [
        type(e) for e in four.events if not isinstance(e, Identified | Judged | ObjectWritten | UnitDone)
    ]


def test_equal_seeds_give_equal_coefficients_and_another_seed_others(tmp_path: Path) -> None:
    found = []
    for i, seed in enumerate((7, 7, 8)):
        (tmp_path / str(i)).mkdir()
        ran = fixture_run.run(tmp_path / str(i), units=1, seed=seed)
        found.append(ran.coefficients("SN0001"))
    assert found[0] == found[1] != found[2]
    assert len(found[0]) == 12


def test_a_second_run_reads_the_first_ones_values_as_old(tmp_path: Path) -> None:
    fixture_run.run(tmp_path)
    before = fixture_run.Ran(tmp_path).memory("SN0001")
    ran = fixture_run.run(tmp_path, seed=2)
    assert ran.results["SN0001"].outcome is Outcome.PASS
    old = ran.stored("SN0001", "old-calibration")["objects"]
    assert np.frombuffer(bytes.fromhex(old["2101:01"]), "<f4")[0] == np.float32(before["2101:01"])
    assert bytes.fromhex(old["2100:00"]).decode() == before["2100:00"]
    assert len(ran.lives("SN0001")) == 2


def test_several_runs_and_seatings_ask_for_reseating_once(tmp_path: Path) -> None:
    requested: list[Message] = []
    name = fixture_run.recipe(
        tmp_path,
        seatings={"turned": {"axis": [0, 0, 1], "angle_deg": 180}},
        runs=[
            {"seating": "home"},
            {
                "seating": "turned",
                "order": "reversed",
                "prewarm_s": 5,
                "motors": "off",
                "base_turn_deg": 180,
                "filter": "off",
                "temperature_swing_degC": 5,
            },
        ],
        method="n-point",
    )
    ran = fixture_run.run(tmp_path, recipe=name, confirm=requested.append)
    assert ran.results["SN0001"].outcome is Outcome.PASS, ran.results["SN0001"].reasons
    turn = "Pass 2: turn each unit 180° about z (seating 'turned')"
    about = "turn the whole rig about the vertical to {}° from how it usually stands"
    rig = [f"Pass 1: {about.format(0)}", f"Pass 2: {about.format(180)}"]
    filters = [
        "Pass 1: set the units' own filter as it usually is",
        "Pass 2: switch the units' own filter off, or to its fastest",
    ]
    swing = "Pass 2: change the temperature by +5 °C from its start to its middle, and back by its end"
    asked = [rig[0], filters[0], turn, rig[1], swing, filters[1], "Pass 2: switch the line's motors off"]
    assert [render(m) for m in requested] == asked, "nothing goes on before a person has done it"
    report = [render(e.message) for e in ran.of(Notice)]
    assert any("motors off" in t for t in report)
    visits = [v for v in ran.life("SN0001")["visits"] if v["kind"] == "tumble"]
    assert [(v["run"], v["seating"]) for v in visits] == [(0, "home")] * 6 + [(1, "turned")] * 6


def test_dwells_end_when_the_coefficients_are_good_enough(tmp_path: Path) -> None:
    """Gains of six faces: noise of 100 ug/rtHz needs (1e-4)^2 / 2 / (2 * std^2) s a stop, more while it is learnt."""
    observed = {}
    for name, until_std in (("short", 5e-4), ("long", 5e-5)):
        (tmp_path / name).mkdir()
        recipe = fixture_run.recipe(tmp_path, dwell={"until_std": until_std, "min_s": 0.2, "max_s": 5})
        observed[name] = fixture_run.run(tmp_path / name, recipe=recipe)
    assert dwelt_s(observed["short"], "tumble") == pytest.approx([0.2] * 6, abs=0.02)
    long_s = dwelt_s(observed["long"], "tumble")
    assert 0.8 < np.mean(long_s) < 2.0 and max(long_s) < 4
    assert dwelt_s(observed["long"], "verify") == pytest.approx([np.mean(long_s)] * 2, abs=0.02)
    fit = observed["long"].results["SN0001"].fit
    assert fit is not None and fit.budget is not None and fit.calibration is not None
    assert fit.budget.std("noise").max() < 5e-5 * 1.05
    assert not any(note.id == "dwell-too-short" for note in fit.calibration.notes)


def test_dwells_of_different_length_are_computed_again_bit_for_bit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe = fixture_run.recipe(tmp_path, dwell={"until_std": 8e-5, "min_s": 0.2, "max_s": 5})
    ran = fixture_run.run(tmp_path, units=2, recipe=recipe)
    assert len(set(dwelt_s(ran, "tumble"))) > 1
    with SqliteLogReader(tmp_path / "station.db") as log:
        for attempt in log.attempts(Query()):
            again = recompute(log, attempt)
            assert again.identical and again.compared > 100, again.differences
    with pytest.raises(SystemExit):
        main(["audit", "SN0001", "--db", str(tmp_path / "station.db")])
    assert f"dwells until good enough: {sum(dwelt_s(ran, 'tumble')):.1f} s" in capsys.readouterr().out


def test_earlier_units_tell_the_noise_of_the_next(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A load of two, then one unit: it knows their noise, its record says so, and is enough to compute from."""
    recipe = fixture_run.recipe(tmp_path, dwell={"until_std": 8e-5, "min_s": 0.2, "max_s": 5})
    first = fixture_run.run(tmp_path, units=2, recipe=recipe)
    then = fixture_run.run(tmp_path, ["SN0003"], recipe=recipe)
    assert [first.stored(serial, "dwell")["prior"] for serial in ("SN0001", "SN0002")] == [None, None]
    assert then.stored("SN0003", "dwell")["prior"]["units"] == 2
    with SqliteLogReader(tmp_path / "station.db") as log:
        for attempt in log.attempts(Query()):
            again = recompute(log, attempt)
            assert again.identical and again.compared > 100, again.differences
        (third,) = log.attempts(Query(serial="SN0003"))
        life, (as_used, product, layout) = log.attempt(third), parse_recipe_and_product(*log.recipe_and_product(third))
        forgot = life | {"results": [r for r in life["results"] if r["name"] != "dwell"]}
        alone = refit_attempt(
            third, stored_visits(life["visits"], log.frames(third)), as_used, (product, layout), forgot
        )
    report = then.results["SN0003"].fit
    assert report is not None and report.calibration is not None and alone.calibration is not None
    assert not np.array_equal(report.calibration.covariance, alone.calibration.covariance)
    with pytest.raises(SystemExit):
        main(["audit", "SN0003", "--db", str(tmp_path / "station.db")])
    assert "noise known beforehand from 2 units" in capsys.readouterr().out


def test_an_uncertainty_out_of_reach_is_told(tmp_path: Path) -> None:
    recipe = fixture_run.recipe(tmp_path, dwell={"until_std": 1e-5, "min_s": 0.2, "max_s": 0.5})
    ran = fixture_run.run(tmp_path, recipe=recipe)
    # The last tenth of the variance would cost the longest dwell at every stop.
    assert all(0.4 < s < 0.52 for s in dwelt_s(ran, "tumble"))
    notes = ran.stored("SN0001", "calibration")["notes"]
    assert any("times the target of dwell.until_std 1e-05 g: raise dwell.max_s (0.5 s)" in note for note in notes)


def test_all_nests_dwell_together_and_each_is_told_what_it_alone_would_need(tmp_path: Path) -> None:
    recipe = fixture_run.recipe(tmp_path, dwell={"until_std": 5e-5, "min_s": 0.2, "max_s": 5})
    ran = fixture_run.run(tmp_path, units=2, recipe=recipe)
    one, two = (ran.stored(serial, "dwell") for serial in ("SN0001", "SN0002"))
    assert one["dwell_s"] == two["dwell_s"] == pytest.approx(dwelt_s(ran, "tumble"), abs=0.02)
    assert one["alone_s"] != two["alone_s"]
    assert max(sum(d["alone_s"]) for d in (one, two)) < sum(one["dwell_s"]) * 1.1


def dwelt_s(ran: Ran, kind: str) -> list[float]:
    """How long each stop of that kind lasted, s."""
    observed = [v["statistics"] for v in ran.life("SN0001")["visits"] if v["kind"] == kind]
    return [(s["to_ns"] - s["from_ns"]) / 1e9 for s in observed]


def test_recipe_and_product_in_the_log_are_enough_to_refit(four: Ran) -> None:
    from station.domain.product import product_record
    from station.domain.recipe.recipe import Recipe
    from station.ports.log_reader import Query

    with SqliteLogReader(four.folder / "station.db") as log:
        (attempt,) = log.attempts(Query(serial="SN0001"))
        recipe_json, product_json = log.recipe_and_product(attempt)
    assert Recipe.model_validate(json.loads(recipe_json)).name == "six-point"
    product, layout = product_record.load(product_json)
    assert product.name == "accelerometer"
    assert layout.ids(17) == (0x191, 0x291)
    assert product_record.dump(product, layout) == product_json


@pytest.mark.parametrize("dwell", [{"time_s": 0.5}, {"until_std": 8e-5, "min_s": 0.2, "max_s": 2}])
def test_each_frame_of_a_run_is_decoded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dwell: dict[str, float]
) -> None:
    """From the wire to the verdict: what is in the record's visits was decoded, and decoded a single time."""
    decoded: list[int] = []
    payloads_to_physical = decode._physical

    def counting(data: Any, axes: Any) -> Any:
        decoded.append(len(data))
        return payloads_to_physical(data, axes)

    monkeypatch.setattr(decode, "_physical", counting)
    ran = fixture_run.run(tmp_path, units=2, recipe=fixture_run.recipe(tmp_path, dwell=dwell))
    assert [r.outcome for r in ran.results.values()] == [Outcome.PASS] * 2
    recorded = 0
    with SqliteLogReader(tmp_path / "station.db") as log:
        for attempt in log.attempts(Query()):
            _, _, layout = parse_recipe_and_product(*log.recipe_and_product(attempt))
            sample_id = layout.id_of(layout.sample, attempt.node)
            recorded += sum(int(np.count_nonzero(frames.can_id == sample_id)) for frames in log.frames(attempt))
    assert sum(decoded) == recorded > 0
