"""Causes some hundred times above the noise, where a derivative of the simulation is no longer the simulation."""

import os
from typing import Any

import numpy as np

from station.domain.core.types import Floats
from tests.blind.bench import World, hide
from tests.blind.inspection import diagnosis_of, searched
from tests.blind.recipes import six_faces

SEED = int(os.environ.get("SEED", "1"))
FACES = six_faces("listed", "reversed", "listed", "reversed")


def askew(w: World, rng: Any) -> tuple[Floats, Floats]:
    """Packages turned by 60 mrad about an axis of each."""
    axis = rng.standard_normal((int(w.unit.max()) + 1, 3))
    turn = 6e-2 * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    return w.feel(device=turn[w.unit]), np.zeros_like(w.a)


def any_matrix(w: World, rng: Any) -> tuple[Floats, Floats]:
    """Each axis reads up to 3 % of the others, as it likes."""
    some = rng.uniform(-3e-2, 3e-2, (int(w.unit.max()) + 1, 3, 3)) * (1 - np.eye(3))
    return w.a, np.einsum("nij,nj->ni", some[w.unit], w.a)


def test_a_large_turn_is_named_though_a_matrix_follows_its_square_too() -> None:
    table, _ = hide(FACES, askew, 700 + SEED, units=2)
    found = searched(FACES, table)
    (cause,) = found.findings
    assert "package-rotation" in (cause.name, *cause.indistinguishable_from)
    assert cause.set_probability > 0.9
    assert not found.words


def test_a_tilt_of_nests_with_one_unit_each_and_skew_axes_are_the_formula_of_a_matrix() -> None:
    """Both together can do what the formula can, and are known physics."""
    table, _ = hide(FACES, any_matrix, 720 + SEED, units=2)
    found = diagnosis_of(FACES, table)
    named = [{c.finding.name, *c.finding.indistinguishable_from} for c in found.causes]
    assert found.verdict == "named"
    assert sorted(("cross-axis" in names, "package-rotation" in names) for names in named) == [
        (False, True),
        (True, False),
    ]
