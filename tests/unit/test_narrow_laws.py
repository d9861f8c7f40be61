"""Laws of one coefficient an axis are judged by what they explain of white readings, and found where wide kernels are
not; what noise and a healthy walk do is none."""

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy

from station.diagnosis.candidates.kernels import LAWS, law_kernel
from station.diagnosis.candidates.law_families import FamilyLaw, LawFamily, law_families
from station.diagnosis.candidates.rival_laws import covariates_of_law, rival_laws
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.linear.projection import DataColumns, ResidualSpace
from station.diagnosis.search import narrow_laws
from station.diagnosis.search.narrow_laws import find_laws, laws_to_find
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats, SampleTable
from station.model.model_file import Model
from tests.blind.bench import FULL, WHITE, Floor, Scaled, World, hide, q_back
from tests.blind.recipes import recipe, six_faces


def _problem(table: SampleTable) -> ScoringProblem:
    return initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))


@pytest.fixture(scope="module")
def quiet() -> ScoringProblem:
    return _problem(hide(recipe(), None, 61, units=2, floor=WHITE)[0])


def test_every_law_is_one_of_a_kernel(quiet: ScoringProblem) -> None:
    names = {law_kernel((law.covariates,)) for family in law_families(quiet.view) for law in family.laws}
    assert names <= set(LAWS)
    assert {"order/law", "time*order/law", "position*input/law"} <= names


def test_laws_that_causes_are_compared_with_are_looked_for(quiet: ScoringProblem) -> None:
    rivals = Counter(covariates_of_law(law.name) for law in rival_laws(quiet.view))
    families = law_families(quiet.view)
    assert rivals == Counter(
        tuple(law.covariates.split("*")) for f in families for _ in f.own for law in f.laws if not law.close
    )


@pytest.mark.parametrize("floor", [WHITE, FULL])
def test_what_a_law_explains_is_what_least_squares_leave_less(floor: Floor) -> None:
    """By all its columns, by those of one axis, or by those of one unit: of each the best, as often as there are."""
    problem = _problem(hide(recipe(), None, 61, units=2, floor=floor)[0])
    at = problem.fit().floor
    space = problem.space(at, moving=False)
    for whole in law_families(problem.view):
        family = whole._replace(laws=whole.laws[::191])
        found = narrow_laws._of_family(problem, family, [space], at)
        checked = [(own, law) for own in family.own for law in family.laws]
        for (own, law), chance in zip(checked, found.chance, strict=True):
            rows = _rows(problem, family, law)
            least = float(np.max(np.sum(rows.visit**2, axis=(0, 1, 2)))) / at.noise**2 * narrow_laws.LEAST_SHARE
            assert chance == pytest.approx(_chance(space, space.project(rows), least, own=own), rel=1e-6)


def _chance(space: ResidualSpace, columns: Floats, least: float, *, own: bool) -> float:
    """How often noise leaves no more beside white columns (U, M, c): all, those of one axis, or those of one unit, of
    which directions of fewer squares than the least are lost."""
    U, _, c = columns.shape
    groups = U if own else 1
    whole = np.einsum("umc,uw->umwc", columns, np.eye(U)) if own else columns
    place, chances = np.arange(groups * c).reshape(groups, c), []
    by_axis = [place[:, axis::3] for axis in range(3)] if c % 3 == 0 else []
    for extent in ([place], by_axis, list(place) if groups > 1 else []):
        each = []
        for some in extent:
            u, s, _ = np.linalg.svd(whole.reshape(space.residual.size, -1)[:, some.ravel()], full_matrices=False)
            shown = u[:, s**2 > least]
            left = 1 - float(np.sum((shown.T @ space.residual.ravel()) ** 2)) / space.rest
            numbers = shown.shape[1] / 2
            each.append(scipy.special.betainc(space.dof / 2 - numbers, numbers, left) if numbers else 1.0)
        chances += [min(1.0, len(each) * min(each))] if each else []
    return min(1.0, len(chances) * min(chances))


def _rows(problem: ScoringProblem, family: LawFamily, law: FamilyLaw) -> DataColumns:
    """The columns of a law as the data have them, those of each group in a place of their own."""
    parts = [family.columns * course[:, None] for course in law.courses]
    whole = np.concatenate(
        [np.where((family.code == g)[:, None, None], x, 0.0) for g in range(family.groups) for x in parts], axis=2
    )
    return problem.view.layout.rows(whole, None)


@pytest.mark.parametrize("alone", ["axis", "unit"])
def test_what_is_on_one_axis_or_in_one_unit_is_told_sooner(quiet: ScoringProblem, alone: str) -> None:
    """The same law of the same size is rarer by noise where it has fewer numbers."""
    floor = quiet.fit().floor
    offsets = next(law_families(quiet.view))
    law = next(law for law in offsets.laws if law.covariates == "motor")
    space = quiet.space(floor, moving=False)
    columns = space.project(_rows(quiet, offsets, law))
    chance = []
    for size in (
        np.ones((2, 3)),
        np.eye(3)[:1] * np.ones((2, 1)) if alone == "axis" else np.eye(2)[:, :1] * np.ones(3),
    ):
        signal = np.einsum("umc,uc->um", columns, size)
        grown = replace(space, data=space.data + 8.0 * signal / np.linalg.norm(signal))
        found = narrow_laws._of_family(quiet, offsets._replace(own=(True,), laws=(law,)), [grown], floor)
        chance.append(found.chance[0])
    assert chance[1] < 0.5 * chance[0]


def _changes_sign(w: World, rng: Scaled) -> tuple[Any, Any]:
    """Every second visit is off to the other side, the later the more."""
    sign = np.where(w.visit % 2, 1.0, -1.0) * w.t / w.t.max()
    return w.a, sign[:, None] * rng.amplitude(1e-4, (2, 3))[w.unit]


def _of_one_nest(w: World, rng: Scaled) -> tuple[Any, Any]:
    """A nest that drags at what comes into it, whichever unit it is."""
    return w.a, (w.nest == 1)[:, None] * (w.before - w.a) * rng.amplitude(1e-4, (3,))


def test_what_one_nest_does_to_any_unit_is_found_as_that() -> None:
    problem = _problem(hide(recipe(), _of_one_nest, 63, units=2, d=14.0)[0])  # type: ignore[arg-type]
    found = find_laws(problem, problem.fit().floor, laws_to_find(problem.view))
    assert found["order*group/law"].nats == max(f.nats for f in found.values())


def test_a_law_that_no_wide_kernel_follows_is_found() -> None:
    problem = _problem(hide(recipe(), _changes_sign, 62, units=2, d=11.0, floor=FULL)[0])  # type: ignore[arg-type]
    found = find_laws(problem, problem.fit().floor, laws_to_find(problem.view))
    assert found["time*order/law"].surprise == max(f.surprise for f in found.values()) > 4.0


def _passes_by(w: World, rng: Scaled) -> tuple[Any, Any]:
    """The base leans while something heavy passes by, once in the whole campaign."""
    clock = w.started + w.t
    near = np.exp(-0.5 * ((clock - np.quantile(clock, 0.37)) / (0.03 * np.ptp(clock))) ** 2)
    return w.feel(station=rng.amplitude(1e-4, (2,)) @ np.eye(2, 3) * near[:, None]), 0.0


def _slides(w: World, rng: Scaled) -> tuple[Any, Any]:
    """Something loose in the nests lies on the side that was down last."""
    lies = q_back(w.nest_q, w.up)[:, 2]
    up = np.sign(lies) * (np.abs(lies) > 0.4)
    last = np.maximum.accumulate(np.where((up != 0) | (w.visit == 0), np.arange(len(up)), 0))
    return w.feel(nest=rng.amplitude(1e-4, (2, 3))[w.nest] * up[last][:, None]), 0.0


@pytest.mark.parametrize(("law", "name"), [(_passes_by, "time*input/law"), (_slides, "order*input/law")])
def test_what_leans_or_turns_by_any_course_is_found(law: Any, name: str) -> None:
    problem = _problem(hide(recipe(), law, 5, units=2, d=9.0, floor=WHITE)[0])
    found = find_laws(problem, problem.fit().floor, laws_to_find(problem.view))
    assert found[name].surprise == max(f.surprise for f in found.values()) > 5.0


def test_noise_and_a_healthy_rig_are_no_law() -> None:
    for seed in range(4):
        problem = _problem(hide(recipe(), None, seed, units=2, floor=FULL)[0])
        # Noise goes beyond this in one of 10,000 sets.
        assert (
            max(f.surprise for f in find_laws(problem, problem.fit().floor, laws_to_find(problem.view)).values()) < 4.0
        )


def test_six_visits_that_what_is_known_takes_up_show_no_law() -> None:
    """Of one unit on six faces laws of two phases have as many numbers as are left."""
    faces = six_faces("listed")
    table, _ = hide(faces, None, 3, units=1, floor=WHITE)
    problem = initial_problem(reduce_samples(faces, table), FloorAllowance.of(faces, Model()))
    found = find_laws(problem, problem.fit().floor, laws_to_find(problem.view))
    assert all(np.isfinite(f.nats) and f.surprise < 4.0 for f in found.values())
