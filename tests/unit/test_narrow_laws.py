"""Laws of one coefficient an axis are judged by what they explain of white readings, and found where wide kernels are
not; what noise and a healthy walk do is none."""

from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pytest
import scipy

from station.diagnosis.candidates.bank import build_bank
from station.diagnosis.candidates.course_laws import course_laws
from station.diagnosis.candidates.kernels import LAWS, law_kernel
from station.diagnosis.candidates.rival_laws import covariates_of_law, rival_laws
from station.diagnosis.data.reduce import reduce_samples
from station.diagnosis.search import narrow_laws
from station.diagnosis.search.narrow_laws import find_laws, law_banks
from station.diagnosis.search.problem import FloorAllowance, initial_problem
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import SampleTable
from station.model.model_file import Model
from tests.blind.bench import FULL, WHITE, Scaled, World, hide, q_back
from tests.blind.recipes import recipe, six_faces


def _problem(table: SampleTable) -> ScoringProblem:
    return initial_problem(reduce_samples(recipe(), table), FloorAllowance.of(recipe(), Model()))


@pytest.fixture(scope="module")
def quiet() -> ScoringProblem:
    return _problem(hide(recipe(), None, 61, units=2, floor=WHITE)[0])


def test_every_law_is_one_of_a_kernel(quiet: ScoringProblem) -> None:
    laws = chain(rival_laws(quiet.view), course_laws(quiet.view))
    names = {law_kernel(covariates_of_law(law.name)) for law in laws}
    assert names <= set(LAWS)
    assert {"order/law", "time*order/law", "position*input/law"} <= names


def test_what_a_law_explains_is_what_least_squares_leave_less(quiet: ScoringProblem) -> None:
    """By all its columns, by those of one axis, or by those of one unit: of each the best, as often as there are."""
    floor, laws = quiet.fit().floor, list(rival_laws(quiet.view))[::97]
    space, bank = quiet.space(floor, moving=False), build_bank(laws, quiet.view.layout, moving=False)
    found = narrow_laws._explained(quiet, bank, [space], floor)
    rows = space.project(bank.rows(quiet.view.layout, slice(0, 2)))
    known, y = space.shared_basis.reshape(space.residual.size, -1), space.residual.ravel()
    for i, (law, at) in enumerate(zip(laws, bank.place, strict=True)):
        columns = rows[..., at]
        U, _, c = columns.shape
        if law.pattern == "own":
            columns = np.einsum("umc,uw->umwc", columns, np.eye(U))
        else:
            columns, U = columns[:, :, None], 1
        flat = columns.reshape(space.residual.size, -1)
        flat = flat - known @ (known.T @ flat)
        place = np.arange(U * c).reshape(U, c)
        extents = [[place], [place[:, axis::3] for axis in range(3)], list(place) if U > 1 else []]
        chances = []
        for each in filter(None, extents):
            every = []
            for some in each:
                chosen = flat[:, some.ravel()]
                left = y - chosen @ np.linalg.lstsq(chosen, y, rcond=1e-6)[0]
                a, b = (space.dof - chosen.shape[1]) / 2, chosen.shape[1] / 2
                every.append(scipy.special.betainc(a, b, float(left @ left) / float(y @ y)))
            chances.append(len(every) * min(every))
        assert found.chance[i] == pytest.approx(min(1.0, len(chances) * min(1.0, *chances)), rel=1e-6)


@pytest.mark.parametrize("alone", ["axis", "unit"])
def test_what_is_on_one_axis_or_in_one_unit_is_told_sooner(quiet: ScoringProblem, alone: str) -> None:
    """The same law of the same size is rarer by noise where it has fewer numbers."""
    floor = quiet.fit().floor
    law = next(x for x in rival_laws(quiet.view) if x.pattern == "own" and covariates_of_law(x.name) == ("motor",))
    space = quiet.space(floor, moving=False)
    bank = build_bank([law], quiet.view.layout, moving=False)
    columns = space.project(bank.rows(quiet.view.layout, slice(0, 2)))
    chance = []
    for size in (
        np.ones((2, 3)),
        np.eye(3)[:1] * np.ones((2, 1)) if alone == "axis" else np.eye(2)[:, :1] * np.ones(3),
    ):
        signal = np.einsum("umc,uc->um", columns, size)
        grown = replace(space, data=space.data + 8.0 * signal / np.linalg.norm(signal))
        chance.append(narrow_laws._explained(quiet, bank, [grown], floor).chance[0])
    assert chance[1] < 0.5 * chance[0]


def _changes_sign(w: World, rng: Scaled) -> tuple[Any, Any]:
    """Every second visit is off to the other side, the later the more."""
    sign = np.where(w.visit % 2, 1.0, -1.0) * w.t / w.t.max()
    return w.a, sign[:, None] * rng.amplitude(1e-4, (2, 3))[w.unit]


def test_a_law_that_no_wide_kernel_follows_is_found() -> None:
    problem = _problem(hide(recipe(), _changes_sign, 62, units=2, d=11.0, floor=FULL)[0])  # type: ignore[arg-type]
    found = find_laws(problem, problem.fit().floor, law_banks(problem.view))
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
    found = find_laws(problem, problem.fit().floor, law_banks(problem.view))
    assert found[name].surprise == max(f.surprise for f in found.values()) > 5.0


def test_noise_and_a_healthy_rig_are_no_law() -> None:
    for seed in range(4):
        problem = _problem(hide(recipe(), None, seed, units=2, floor=FULL)[0])
        # Noise goes beyond this in one of 10,000 sets.
        assert max(f.surprise for f in find_laws(problem, problem.fit().floor, law_banks(problem.view)).values()) < 4.0


def test_six_visits_that_what_is_known_takes_up_show_no_law() -> None:
    """Of one unit on six faces laws of two phases have as many numbers as are left."""
    faces = six_faces("listed")
    table, _ = hide(faces, None, 3, units=1, floor=WHITE)
    problem = initial_problem(reduce_samples(faces, table), FloorAllowance.of(faces, Model()))
    found = find_laws(problem, problem.fit().floor, law_banks(problem.view))
    assert all(np.isfinite(f.nats) and f.surprise < 4.0 for f in found.values())
