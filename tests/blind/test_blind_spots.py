"""What a diagnosis that found nothing says of what it could not have found."""

from dataclasses import replace
from typing import Any

from station.config.recipes import load_recipe
from station.diagnosis.results.blind_spots import BlindSpots
from station.diagnosis.results.diagnose import diagnose
from station.diagnosis.results.diagnosis_document import document
from station.diagnosis.search.search_state import NullFactory
from station.model.model_file import Model
from station.model.simulate import SimulationJob, parse_effects, simulate
from tests.blind.inspection import diagnosis_of, null_of

#: Three faces of one unit once, beside six coefficients of its own: three numbers are left for everything else.
THREE = load_recipe("three-point")


def test_three_faces_say_what_they_cannot_show_and_what_would_show_it() -> None:
    found = diagnosis_of(THREE, simulate(SimulationJob(THREE, ("A",), 3, ())).table)
    blind = BlindSpots.of_diagnosis(found)
    assert {"cubic", "quadratic", "turn-on-offset", "offset-temperature"} <= set(blind.causes)
    assert not {"local-gravity", "gold-drift"} & set(blind.causes)
    shown = document(found)
    assert shown["verdict"] == "none"
    assert f"{len(blind.causes)} of {blind.of} causes cannot show" in shown["sentence"]
    assert "add a run 10 °C warmer" in shown["sentence"]
    assert "scatter" not in shown["sentence"]


def three_faces(seed: int, null_of: NullFactory = null_of) -> dict[str, Any]:
    """One per cent of the next axis, a hundred times the noise of a mean, in three faces of one unit."""
    effects = parse_effects(("cross-axis=0.01",), THREE)
    table = simulate(SimulationJob(THREE, ("A",), seed, effects)).table
    return document(diagnose(THREE, table, Model(), null_of))


def test_scatter_that_nothing_explains_is_not_passed_over() -> None:
    """Three faces name nothing; its statistic lies far below the threshold, which is drawn."""
    shown = three_faces(5)
    assert shown["verdict"] == "none"
    assert "times what the samples in them explain" in shown["sentence"]
    assert "cross-axis" in shown["sentence"]


def test_three_positions_confirm_no_cause() -> None:
    """As many are needed to tell the calibration: what alarms there may be looked for, and is not named."""
    shown = three_faces(1, lambda *found: replace(null_of(*found), threshold=1.0))
    assert shown["alarm"]["statistic"] > 1.0
    assert shown["verdict"] == "incomplete"
    assert not any(cause["gain"]["accepted"] for cause in shown["causes"])
