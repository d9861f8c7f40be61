"""The gallery: each published device's map, run against a simulated twin built from its EDS and DBC."""

from pathlib import Path

import pytest

from station.config.products import load_product
from station.config.search_path import shipped_folder
from station.wiring.jobs import load_job
from tests.fakes import fixture_run

NAMES = sorted(path.stem for path in (shipped_folder() / "dbc" / "examples").glob("*.yaml"))
RECIPES = {"accelerometer": "six-point", "gyroscope": "gyroscope-six-point", "inclinometer": "inclinometer-zero"}


def test_each_has_its_three_files() -> None:
    assert len(NAMES) >= 8
    for name in NAMES:
        assert all((shipped_folder() / "dbc" / "examples" / f"{name}.{end}").is_file() for end in ("dbc", "eds"))


@pytest.mark.parametrize("name", NAMES)
def test_its_twin_is_measured_judged_and_left_as_it_was(tmp_path: Path, name: str) -> None:
    """Its sheet is not the recipe's, so only the way from frames to a calibration is asked about, not the limits."""
    base = RECIPES[load_product(name).sensor]
    recipe = fixture_run.recipe(tmp_path, base, product=name, limits={}, verify=None, runs=None)
    job, _ = load_job(recipe)
    ran = fixture_run.run(tmp_path, recipe=recipe)
    found = ran.results["SN0001"]
    assert (str(found.outcome), found.reasons) == ("PASS", ())
    assert found.fit is not None and found.fit.calibration is not None
    assert found.written is job.product.map.writes
    assert bool(ran.memory("SN0001")) is job.product.map.writes
