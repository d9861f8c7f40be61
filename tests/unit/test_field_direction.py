"""A field that points elsewhere than the recipe says is found beside any hard iron, and said with its direction."""

import numpy as np
import pytest

from station.diagnosis.data import preflight
from station.domain.core.types import Floats
from tests.fakes import tumble

#: What the recipe of the fake tumble states, uT.
STATED = np.array([20.0, 0.0, -44.0])


def said(field: Floats, rng: np.random.Generator, mirrored: bool = False) -> list[str]:
    """Remarks on two units with hard and soft iron that were tumbled in a field (3)."""
    recipe = tumble.recipe("n-point", "magnetometer")
    turn = np.array([p.matrix().T for p in recipe.positions])
    theta = tumble.units(rng, 2) + np.r_[rng.normal(0, 30, 3), np.zeros(9)]
    if mirrored:
        theta[0, 3:] = np.diag([1.0, -1.0, 1.0]).ravel()
    table = tumble.table(recipe, tumble.readings(theta, turn @ field), 0.1, 20, rng)
    found, _ = preflight.inspect(recipe, table)
    return [str(m.parameters) for m in found.remarks if m.id == "field-points-elsewhere"]


@pytest.mark.parametrize("field", [(0.0, 20.0, -44.0), (-20.0, 0.0, 44.0), (24.0, 0.0, -44.0)])
def test_a_field_that_points_elsewhere_is_said(field: tuple[float, float, float], rng: np.random.Generator) -> None:
    assert len(said(np.array(field), rng)) == 1


@pytest.mark.parametrize(("size", "mirrored"), [(1.0, False), (1.2, False), (1.0, True)])
def test_a_stronger_field_and_a_mirrored_unit_point_nowhere_else(
    size: float, mirrored: bool, rng: np.random.Generator
) -> None:
    assert said(size * STATED, rng, mirrored) == []
