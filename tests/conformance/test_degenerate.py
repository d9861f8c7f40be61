"""What no data of a recipe can tell apart is given as a set, never one member of it as certain."""

import numpy as np
import pytest

from station.config.recipes import load_recipe
from station.diagnosis.results.diagnose import Diagnosis
from station.domain.recipe.recipe import Recipe
from station.model.effects.axis_permutation import matrix_of
from station.model.simulate import SimulationJob, parse_effects, simulate
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import RATE_HZ, recipe
from tests.portion import one_of_each, portion

UNITS = ("A", "B", "C", "D")


def six() -> Recipe:
    """Six faces, one run."""
    whole = load_recipe("six-point")
    return whole.model_copy(update={"device": whole.device.model_copy(update={"rate_hz": RATE_HZ, "lsb": 0.0})})


def found(kind: Recipe, units: int, *requested: str, seed: int = 21) -> Diagnosis:
    """The diagnosis of a simulated campaign."""
    return diagnosis_of(kind, simulate(SimulationJob(kind, UNITS[:units], seed, parse_effects(requested, kind))).table)


def first(d: Diagnosis) -> set[str]:
    """What is named first, with all that it cannot be told from."""
    if d.faults:
        return {d.faults[0].effect, *d.faults[0].indistinguishable_from}
    return {d.causes[0].finding.name, *d.causes[0].finding.indistinguishable_from} if d.causes else set()


#: Recipe, units, what is hidden, and all that it looks like.
EQUAL: tuple[tuple[Recipe, int, str, set[str]], ...] = (
    (recipe(1), 4, "nest-tilt", {"nest-tilt", "package-rotation"}),
    (recipe(1), 1, "package-rotation", {"nest-tilt", "package-rotation"}),
    (recipe(3), 4, "base-tilt", {"base-tilt", "index-error"}),
    (recipe(1), 4, "base-tilt", {"base-tilt", "index-error"}),
    (recipe(1), 1, "index-error", {"index-error", "repeatability"}),
    (recipe(3), 1, "settling", {"settling", "filter-lag"}),
    (recipe(3), 1, "filter-lag", {"settling", "filter-lag"}),
    (six(), 4, "quadratic=0.001", {"quadratic", "asymmetry"}),
    (six(), 4, "asymmetry=0.001", {"quadratic", "asymmetry"}),
)


TRIED = one_of_each(EQUAL, lambda row: frozenset(row[3]))


@pytest.mark.parametrize(("kind", "units", "requested", "members"), TRIED)
def test_causes_that_look_exactly_alike_are_given_together(
    kind: Recipe, units: int, requested: str, members: set[str]
) -> None:
    assert members <= first(found(kind, units, requested))


@pytest.mark.parametrize(
    ("kind", "requested"),
    [
        (recipe(3), "local-gravity"),
        (six(), "cubic=0.001"),
        (six(), "cross-quadratic=0.001"),
        (six().model_copy(update={"runs": six().runs[:1]}), "group-offset"),
    ],
)
def test_what_looks_like_a_calibration_is_not_testable_and_nothing_is_named(kind: Recipe, requested: str) -> None:
    d = found(kind, 2, requested)
    assert (d.verdict, d.causes, d.faults) == ("none", (), ())
    assert requested.partition("=")[0] in d.not_testable


@pytest.mark.parametrize("mapping", portion(["-y,x,z", "y,z,x"]))
def test_a_proper_remap_may_be_a_part_mounted_turned(mapping: str) -> None:
    assert np.linalg.det(matrix_of(mapping)) > 0
    once = first(found(recipe(1), 4, f"axis-permutation={mapping}"))
    assert once == {"axis-permutation", "package-rotation", "nest-tilt"}
    # Turned in its seat between the runs, a part no longer looks like a nest that holds it turned.
    assert first(found(recipe(3), 4, f"axis-permutation={mapping}")) == {"axis-permutation", "package-rotation"}


@pytest.mark.parametrize("mapping", ["x,y,-z", "y,x,z"])
def test_a_mirror_image_can_only_be_the_decoding(mapping: str) -> None:
    assert np.linalg.det(matrix_of(mapping)) < 0
    assert first(found(recipe(1), 4, f"axis-permutation={mapping}")) == {"axis-permutation"}


@pytest.mark.parametrize("factor", [0.5, 9.80665, 0.001])
def test_a_wrong_scale_is_named_with_its_factor_and_nothing_beside_it(factor: float) -> None:
    d = found(recipe(1), 2, f"wrong-scale={factor}")
    assert [f.effect for f in d.faults] == ["wrong-scale"]
    assert [float(n.value) for n in d.faults[0].numbers] == pytest.approx([factor, factor])
    assert d.causes == ()
