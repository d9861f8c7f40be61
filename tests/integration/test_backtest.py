"""`station backtest`: nothing changes where nothing was changed, and every change is shown."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from station.adapters.store.reader import SqliteLogReader
from station.cli.app import main
from station.config.recipes import load_recipe
from station.domain.core.types import ReducedVisits
from station.domain.evaluation import backtest
from station.domain.evaluation.reduced_visits_document import from_document, to_document
from station.errors import LogError, RecipeError
from station.ports.log_reader import Query
from station.service.backtest import check
from tests.fakes import fixture_run

Out = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("backtest")
    fixture_run.run(made, units=4)
    return made


def requested(capsys: Out, folder: Path, *args: str, code: int = 0) -> Any:
    with pytest.raises(SystemExit) as ended:
        main(["backtest", "--db", str(folder / "station.db"), "--processes", "1", *args])
    shown = capsys.readouterr()
    assert ended.value.code == code, shown.err
    return json.loads(shown.out) if "--json" in args else shown.out if code == 0 else shown.err


@pytest.mark.parametrize("source", [[], ["--from-frames"]])
def test_the_same_recipe_gives_the_same_bits(folder: Path, source: list[str], capsys: Out) -> None:
    report = requested(capsys, folder, "--recipe", "six-point", "--json", *source)
    assert report["verdicts"] == [{"before": "PASS", "after": "PASS", "count": 4}]
    assert report["changed"] == []
    assert all(c["max_change"] == 0 for c in report["coefficients"])
    assert report["computed_from"] == ("frames" if source else "stops")


def test_tighter_limits_fail_the_units_beyond_them_and_say_why(folder: Path, capsys: Out) -> None:
    tight = fixture_run.recipe(folder, limits={"offset": 0.03})
    report = requested(capsys, folder, "--recipe", tight, "--json")
    beyond = {r["serial"] for r in stored(folder) if np.abs(r["offset"]).max() > 0.03}
    assert 0 < len(beyond) < 4
    assert {c["serial"] for c in report["changed"]} == beyond
    assert all(c["after"] == "FAIL" and "beyond 0.03" in c["reasons"][0] for c in report["changed"])
    text = requested(capsys, folder, "--recipe", tight)
    assert f"{len(beyond)}  PASS become FAIL" in text


def stored(folder: Path) -> list[dict[str, Any]]:
    with SqliteLogReader(folder / "station.db") as log:
        lives = [log.life(Query(serial=a.serial))[0] for a in log.attempts(Query())]
    return [{"serial": k["serial"], **_calibration(k)} for k in lives]


def _calibration(life: dict[str, Any]) -> dict[str, Any]:
    return next(r["document"] for r in life["results"] if r["name"] == "calibration")


def test_another_method_is_computed_from_the_kept_stops(folder: Path, capsys: Out) -> None:
    """Six faces equally noisy: the weights of n-point are all alike, and it is six-point."""
    report = requested(capsys, folder, "--recipe", fixture_run.recipe(folder, method="n-point"), "--json")
    assert report["computed_from"] == "stops"
    assert max(c["max_change_in_std"] for c in report["coefficients"]) < 1e-6
    # That the method is taken at all shows where it cannot work: six magnitudes do not hold nine coefficients.
    refused = requested(capsys, folder, "--recipe", fixture_run.recipe(folder, method="norm"), code=2)
    assert "norm on these 6 positions leaves cross-axis xy" in refused


def test_another_truth_moves_the_gains_by_as_much(folder: Path, capsys: Out) -> None:
    heavier = fixture_run.recipe(folder, reference={"source": "gravity", "magnitude": 1.001})
    report = requested(capsys, folder, "--recipe", heavier, "--json")
    moved = {c["name"]: c["max_change"] for c in report["coefficients"]}
    # Gains of 1 ± 3 % at most, over 1.001.
    assert all(moved[f"gain {axis}"] == pytest.approx(0.001, rel=0.035) for axis in "xyz")
    assert moved["offset x"] == pytest.approx(0.0, abs=1e-9)


def test_other_dwells_are_computed_from_frames_by_themselves(folder: Path, capsys: Out) -> None:
    shorter = fixture_run.recipe(folder, settle={"time_s": 0.5}, dwell={"time_s": 0.5})
    report = requested(capsys, folder, "--recipe", shorter, "--json")
    assert report["computed_from"] == "frames"
    assert report["compared"] == 4
    assert max(c["max_change"] for c in report["coefficients"]) > 0


def test_wrong_orders_end_in_one_sentence(folder: Path, capsys: Out) -> None:
    assert "name the recipe of the attempts with --of" in requested(capsys, folder, "--recipe", "tilt-24", code=2)
    few = load_recipe("six-point").model_copy(update={"positions": load_recipe("six-point").positions[:2]})
    with pytest.raises(RecipeError):
        check(few)


def test_reduced_stops_come_back_bit_for_bit_and_without_what_the_recipe_leaves_out() -> None:
    recipe = load_recipe("six-point")
    names = tuple(p.name for p in recipe.positions)
    rng = np.random.default_rng(5)
    stops = ReducedVisits(
        position=names,
        seating=("home",) * 6,
        run=np.zeros(6, np.int32),
        visit=np.arange(6, dtype=np.int32),
        mean=rng.normal(size=(6, 3)),
        cov=rng.normal(size=(6, 3, 3)),
        quantisation=rng.normal(size=(6, 3)),
        dof=rng.normal(size=(6, 3)),
        true=np.array([recipe.true_vector(p) for p in recipe.positions]),
        std=rng.normal(size=(6, 3)),
        count=np.full(6, 100),
        effective=rng.normal(size=6),
        time_s=rng.normal(size=6),
        temperature_degC=np.array([20.0, np.nan, 21, 22, 23, 24]),
    )
    document = json.loads(json.dumps(to_document(stops)).replace("NaN", "null"))
    again = from_document(document, recipe)
    for name in ("mean", "cov", "true", "count", "temperature_degC", "run"):
        assert getattr(again, name).tobytes() == getattr(stops, name).tobytes(), name
    fewer = recipe.model_copy(update={"positions": recipe.positions[:4]})
    assert from_document(document, fewer).position == names[:4]
    with pytest.raises(LogError, match="use --from-frames"):
        from_document({}, recipe)
    with pytest.raises(LogError, match="rows of 2 and of 3 values"):
        from_document({**document, "mean": [*document["mean"][:5], [0.0, 1.0]]}, recipe)


def test_a_longer_settling_cuts_later_and_never_before_the_arrival() -> None:
    from station.domain.capture.visit import CapturedVisit
    from station.domain.core.types import Frames

    recipe = load_recipe("six-point")
    visit = CapturedVisit(0, 0, "z-up", "home", 100, 100 + 300_000_000, 100 + 1_300_000_000, Frames.empty())

    def window(settle_s: float, dwell_s: float) -> tuple[int, int]:
        parts = {"settle": {"time_s": settle_s}, "dwell": {"time_s": dwell_s}}
        new = type(recipe).model_validate({**recipe.model_dump(by_alias=True), **parts})
        (made,) = backtest.recut_dwells([visit], recipe, new)
        return made.from_ns - 100, made.to_ns - 100

    assert window(0.3, 1.0) == (300_000_000, 1_300_000_000)
    assert window(0.5, 0.5) == (500_000_000, 1_000_000_000)
    assert window(0.0, 1.0) == (0, 1_000_000_000)
