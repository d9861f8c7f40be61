"""How large the found causes are, with standard deviations that cover."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.shape import FormEstimate, tunable_parameters, tune_form, with_form_value
from station.diagnosis.candidates.solve import solve, whitened
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.results.form_posterior import FormPosterior, form_posterior
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
    forms: list[tuple[FormPosterior, ...]] = []
    items = list(problem.accepted)
    fitted = problem.fit()
    for i in range(len(items)):
        items[i], form = _tuned(problem, i, fitted)
        forms.append(form)
    if any(forms):
        problem = refined(problem.with_accepted(items), rounds=3)
        fitted = problem.fit()
    found = joint_coefficients(problem, problem.accepted, fitted)
    gap_s = visit_interval_s(problem.view)
    return problem, tuple(
        Estimate(item, value, np.hypot(std, _std_from_form(problem, i, value, form, fitted)), _estimates(form), gap_s)
        for i, (item, (value, std), form) in enumerate(zip(problem.accepted, found, forms, strict=True))
    )


def _estimates(form: Sequence[FormPosterior]) -> tuple[FormEstimate, ...]:
    return tuple(p.estimate for p in form)


def _tuned(problem: ScoringProblem, i: int, fitted: FittedFloor) -> tuple[AcceptedCause, tuple[FormPosterior, ...]]:
    """A cause with its form as the data say, the others as they are."""
    item = problem.accepted[i]
    parameters = tunable_parameters(item.candidate.effect)
    if not parameters:
        return item, ()
    bare = problem.without(i)
    space = bare.space(fitted.floor, moving=item.candidate.moving)
    candidate, best = tune_form(item.candidate, bare.view, space)
    found = tuple(form_posterior(candidate, b, p, bare.view, space) for b, p in zip(best, parameters, strict=True))
    for p in found:
        candidate = with_form_value(candidate, p.estimate.field, p.estimate.value, bare.view)
    return replace(item, candidate=candidate), found


def joint_coefficients(
    problem: ScoringProblem, items: Sequence[AcceptedCause], fitted: FittedFloor
) -> list[tuple[Floats, Floats]]:
    """Coefficients and their standard deviations (groups, axes) of accepted causes."""
    joint = problem.with_accepted(items)
    readings, _ = joint.readings(moving=joint.known.moving)
    solved = solve(whitened(fitted.space.covariance, joint.known, readings))
    found = (solved.at(place) for place in joint.places)
    return [(item.coefficient + step, std) for item, (step, std) in zip(items, found, strict=True)]


def _std_from_form(
    problem: ScoringProblem, i: int, value: Floats, form: Sequence[FormPosterior], fitted: FittedFloor
) -> Floats:
    """Standard deviation (groups, axes) that the uncertainty of the form adds to the coefficients of a cause."""
    item = problem.accepted[i]
    bare = problem.without(i)
    variance = np.zeros(value.shape)
    for p in form:
        for at, weight in zip(p.values, p.weights, strict=True):
            moved = with_form_value(item.candidate, p.estimate.field, float(at), problem.view)
            other = replace(item, candidate=moved, coefficient=np.zeros(value.shape))
            items = [*problem.accepted[:i], other, *problem.accepted[i + 1 :]]
            variance += weight * (joint_coefficients(bare, items, fitted)[i][0] - value) ** 2
    return np.sqrt(variance)
