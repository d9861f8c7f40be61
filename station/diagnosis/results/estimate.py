"""How large the found causes are, with standard deviations that cover."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.shape import FormEstimate, tunable_parameters, tune_form, with_form_value
from station.diagnosis.candidates.solve import solve, whitened
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.search.problem import refined, visit_interval_s
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """value and std (groups, axes) of a cause's coefficients, and the parameters of its form."""

    item: AcceptedCause
    value: Floats
    std: Floats
    form: tuple[FormEstimate, ...]
    visit_interval_s: float = 0.0

    def form_std(self, field: str) -> float:
        """Standard deviation of a parameter of the form that was not tuned: of a jump, the gap it lies in."""
        return self.visit_interval_s / float(np.sqrt(12)) if field == "at_s" else 0.0


def estimate_causes(problem: ScoringProblem) -> tuple[ScoringProblem, tuple[Estimate, ...]]:
    """The problem with every form at its best beside the other causes, and the estimates of all accepted causes."""
    forms: list[tuple[FormEstimate, ...]] = []
    items = list(problem.accepted)
    fitted = problem.fit()
    for i in range(len(items)):
        items[i], form = _tuned(problem, i, fitted)
        forms.append(form)
    if any(forms):
        problem = refined(problem.with_accepted(items), rounds=3)
        fitted = problem.fit()
    found = joint_coefficients(problem, problem.accepted, fitted)
    return problem, tuple(
        Estimate(
            item, value, np.hypot(std, _std_from_form(problem, i, form, fitted)), form, visit_interval_s(problem.view)
        )
        for i, (item, (value, std), form) in enumerate(zip(problem.accepted, found, forms, strict=True))
    )


def _tuned(problem: ScoringProblem, i: int, fitted: FittedFloor) -> tuple[AcceptedCause, tuple[FormEstimate, ...]]:
    """A cause with its form at its best, the others as they are."""
    item = problem.accepted[i]
    if not tunable_parameters(item.candidate.effect):
        return item, ()
    bare = problem.without(i)
    space = bare.space(fitted.floor, moving=item.candidate.dwell is not None)
    candidate, form = tune_form(item.candidate, bare.view, space)
    return replace(item, candidate=candidate), form


def joint_coefficients(
    problem: ScoringProblem, items: Sequence[AcceptedCause], fitted: FittedFloor
) -> list[tuple[Floats, Floats]]:
    """Coefficients and their standard deviations (groups, axes) of accepted causes."""
    joint = problem.with_accepted(items)
    readings, _ = joint.readings(moving=joint.known.moving)
    solved = solve(whitened(fitted.space.covariance, joint.known, readings))
    found = (solved.at(place) for place in joint.places)
    return [(item.coefficient + step, std) for item, (step, std) in zip(items, found, strict=True)]


def _std_from_form(problem: ScoringProblem, i: int, form: Sequence[FormEstimate], fitted: FittedFloor) -> Floats:
    """Standard deviation (groups, axes) that the uncertainty of the form adds to the coefficients of a cause."""
    item = problem.accepted[i]
    bare = problem.without(i)
    total = np.zeros(item.coefficient.shape)
    for t in form:
        ends = []
        for sign in (-1, 1):
            moved = with_form_value(
                item.candidate, t.field, t.value * float(np.exp(sign * t.std / t.value)), problem.view
            )
            other = replace(item, candidate=moved, coefficient=np.zeros(item.coefficient.shape))
            items = [*problem.accepted[:i], other, *problem.accepted[i + 1 :]]
            ends.append(joint_coefficients(bare, items, fitted)[i][0])
        total = np.hypot(total, (ends[1] - ends[0]) / 2)
    return total
