"""Every shipped recipe with a product runs end to end on simulated units of it, and a good unit passes."""

from pathlib import Path

import numpy as np
import pytest

from station.config.products import load_product
from station.config.recipes import load_recipe
from station.config.search_path import shipped_folder
from station.domain.core.types import Outcome
from station.model.simulate import SimulationJob
from tests.fakes import fixture_run

PRODUCTS = {p.stem: load_recipe(p).product for p in (shipped_folder() / "recipes").glob("*.yaml")}
#: Those whose product keeps every coefficient of its axes; test_gallery runs the others.
RECIPES = sorted(name for name, product in PRODUCTS.items() if product and load_product(product).map.matrix is not None)


@pytest.mark.parametrize("name", RECIPES)
def test_a_good_unit_passes_and_keeps_its_calibration(tmp_path: Path, name: str) -> None:
    ran = fixture_run.run(tmp_path, recipe=name)
    r = ran.results["SN0001"]
    assert r.outcome is Outcome.PASS, [x.sentence for x in r.reasons]
    assert (r.written, r.verified) == (True, True)
    assert r.fit is not None
    assert r.fit.calibration is not None
    axes = load_recipe(name).axes
    assert len([place for place in ran.memory("SN0001") if place[:4] in ("2101", "2102")]) == axes + axes**2
    found = r.fit.calibration
    base = SimulationJob(load_recipe(name), ("SN0001",), 1).base(("SN0001",))
    std = np.sqrt(np.diagonal(found.covariance))
    estimated = std > 0
    found_all = np.concatenate([found.offset, found.matrix.ravel()])
    true = np.concatenate([base.offset[0], base.matrix[0].ravel()])
    if load_recipe(name).method in ("six-point", "n-point"):
        # Methods that estimate all twelve: the truth lies within 5 standard deviations, one in a million each.
        assert np.abs(found_all - true)[estimated].max() < 5 * std[estimated].max()


def test_there_is_a_recipe_for_every_method_and_sensor() -> None:
    observed = {(load_recipe(n).sensor, load_recipe(n).method) for n in RECIPES}
    assert {s for s, _ in observed} == {"accelerometer", "magnetometer", "gyroscope", "inclinometer"}
    assert {m for s, m in observed if s == "accelerometer"} == {
        "one-point",
        "three-point",
        "six-point",
        "n-point",
        "norm",
    }
