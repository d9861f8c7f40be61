"""The sizes of the causes found, with standard deviations that cover."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from station.diagnosis.candidates.bank import Candidate, build_bank
from station.diagnosis.candidates.nuisance import AcceptedCause, accept_candidate
from station.diagnosis.candidates.shape import (
    FormEstimate,
    evidence_of,
    evidences_of,
    likely_ringings,
    log_range,
    tunable_parameters,
    tune_form,
    with_form_value,
)
from station.diagnosis.candidates.solve import WhiteRows, solve, whitened, with_priors
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.noise_floor import FittedFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.results.covariate_posterior import sizes_beside_error
from station.diagnosis.results.form_posterior import LAST_NATS, form_posterior
from station.diagnosis.results.joint_form import JointForm, weigh_together
from station.diagnosis.search.problem import refined, visit_interval_s
from station.diagnosis.search.scoring import AmplitudeLikelihood, ScoringProblem, score_bank
from station.domain.core.types import Floats

#: Amplitudes and forms less likely than this are left out of an interval.
NEGLIGIBLE = 1e-3
#: Directions in which a cause shows, from which on any usual size is as likely beforehand. By fewer, so wide a prior
#: makes sizes that only the usual size bounds much too uncertain.
DIRECTIONS_FOR_EVEN_PRIOR = 6
#: Probability below the upper end of a 95 % interval.
COVERED = 0.975


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
    """The problem with every form fitted beside the other causes, and the estimates of all accepted causes."""
    forms: list[JointForm | None] = []
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
    sized = [_size(problem, i, *found[i], forms[i], fitted) for i in range(len(items))]
    return problem, tuple(
        Estimate(item, value, std, () if form is None else form.estimates, gap_s)
        for item, (value, std), form in zip(problem.accepted, sized, forms, strict=True)
    )


def _tuned(problem: ScoringProblem, i: int, fitted: FittedFloor) -> tuple[AcceptedCause, JointForm | None]:
    """A cause with its form fitted, the others as they are."""
    item = problem.accepted[i]
    parameters = tunable_parameters(item.candidate.effect)
    if not parameters:
        return item, None
    bare = problem.without(i)
    space = bare.space(fitted.floor, moving=item.candidate.moving)
    candidate, best = tune_form(item.candidate, bare.view, space)
    if len(best) == 1:
        found = JointForm.of_one(form_posterior(candidate, best[0], parameters[0], bare.view, space))
    else:
        found = _peaks(candidate, best, bare.view, space)
    fields, values = [e.field for e in found.estimates], np.array([e.value for e in found.estimates])
    return replace(item, candidate=_shaped(candidate, fields, values, bare.view)), found


def _peaks(candidate: Candidate, best: Sequence[FormEstimate], view: ResidualView, space: ResidualSpace) -> JointForm:
    """What a wave may be: the peak at its best form, and others that explain nearly as much."""
    fields = [b.field for b in best]
    bounds = [log_range(p) for p in tunable_parameters(candidate.effect)]

    def evidence_at(logs: Floats) -> Floats:
        return evidences_of([_shaped(candidate, fields, x, view) for x in np.exp(logs)], view, space)

    peaks = [weigh_together(best, bounds, evidence_at)]
    for start in likely_ringings(candidate, view, space):
        other, at = tune_form(start, view, space)
        if evidence_of(other, view, space) < evidence_of(candidate, view, space) - LAST_NATS:
            continue
        if not any(peak.holds(np.array([b.value for b in at])) for peak in peaks):
            peaks.append(weigh_together(at, bounds, evidence_at))
    return JointForm.of_peaks(peaks)


def _shaped(candidate: Candidate, fields: Sequence[str], values: Floats, view: ResidualView) -> Candidate:
    """The candidate with other values (p) of parameters of its form."""
    for field, value in zip(fields, values, strict=True):
        candidate = with_form_value(candidate, field, float(value), view)
    return candidate


def joint_coefficients(
    problem: ScoringProblem, items: Sequence[AcceptedCause], fitted: FittedFloor
) -> list[tuple[Floats, Floats]]:
    """Coefficients and their standard deviations (groups, axes) of accepted causes."""
    joint = problem.with_accepted(items)
    solved = solve(_white(joint, fitted))
    found = (solved.at(place) for place in joint.places)
    return [(item.coefficient + step, std) for item, (step, std) in zip(items, found, strict=True)]


def _white(problem: ScoringProblem, fitted: FittedFloor) -> WhiteRows:
    """All that is known and the readings under a floor."""
    readings, _ = problem.readings(moving=problem.known.moving)
    return whitened(fitted.space.covariance, problem.known, readings)


def _size(
    problem: ScoringProblem, i: int, value: Floats, std: Floats, form: JointForm | None, fitted: FittedFloor
) -> tuple[Floats, Floats]:
    """A cause's coefficients (groups, axes) and standard deviations of which 1.96 cover 95 %. They include the
    uncertainty of the usual size, which shrinks the coefficients, of the covariate, of the form and of the noise.
    value, std: with all of these as estimated."""
    item = problem.accepted[i]
    if item.candidate.effect is None or np.any(item.mean):
        # Of a kernel, or of a cause that a model file states with deviations of its own.
        return value, std
    widened, bare = students_share(fitted.space.dof), problem.without(i)
    usual = _usual_sizes(bare, item, fitted)
    if (beside := sizes_beside_error(bare, item, value, usual.spread, fitted)) is not None:
        return beside[0], widened * beside[1]
    variance = _second_moment(bare, i, item, value, fitted, usual)
    if form is not None:
        fields = [e.field for e in form.estimates]
        likely = form.weights > NEGLIGIBLE
        each = [
            w * _second_moment(bare, i, other, value, fitted, _usual_sizes(bare, other, fitted))
            for w, values in zip(form.weights[likely], form.values[likely], strict=True)
            for other in (replace(item, candidate=_shaped(item.candidate, fields, values, problem.view)),)
        ]
        variance = np.maximum(variance, np.sum(each, axis=0))
    return value, np.asarray(widened * np.sqrt(variance))


def students_share(dof: int) -> float:
    """The 97.5 % quantile of Student's t over that of the normal distribution, for a noise known from so many
    numbers."""
    return float(scipy.special.stdtrit(max(dof, 1), COVERED) / scipy.special.ndtri(COVERED))


def _usual_sizes(bare: ScoringProblem, item: AcceptedCause, fitted: FittedFloor) -> AmplitudeLikelihood:
    """The deviations that a cause's coefficients may have, and how likely each is.

    The grid of deviations is even in their logarithm, which beforehand makes it likely that there is hardly anything,
    and intervals of what is weak too short. A prior that is even in the deviation does not; it needs several numbers
    (Gelman, Prior distributions for variance parameters in hierarchical models, Bayesian Analysis 1 (2006) 515).
    """
    candidate, even = item.candidate, item.candidate.even
    own = score_bank(bare, [build_bank([even], bare.view.layout, moving=even.moving)], fitted.floor)
    found = own.amplitudes(even, bare.view, item.hit)
    usual = np.array(candidate.axis_scale) if candidate.axis_scale else 1.0
    spread = np.minimum(found.spread, max(candidate.usual_most, float((item.std / usual).min())))
    even_prior = np.log(spread) if found.directions >= DIRECTIONS_FOR_EVEN_PRIOR else 0.0
    return found._replace(spread=spread, likelihood=found.likelihood + even_prior)


def _second_moment(
    bare: ScoringProblem, i: int, item: AcceptedCause, value: Floats, fitted: FittedFloor, usual: AmplitudeLikelihood
) -> Floats:
    """Mean square (groups, axes) of the coefficients about value, over the usual sizes that they may have."""
    weights = np.exp(usual.likelihood - usual.likelihood.max())
    weights /= weights.sum()
    moment, white = np.zeros(value.shape), None
    for spread, weight in zip(usual.spread, weights, strict=True):
        if weight > NEGLIGIBLE:
            other = accept_candidate(item.candidate, item.hit, float(spread))
            joint = bare.with_accepted([*bare.accepted[:i], other, *bare.accepted[i:]])
            white = _white(joint, fitted) if white is None else with_priors(white, joint.known)
            mean, std = solve(white).at(joint.places[i])
            moment += weight * (std**2 + (mean - value) ** 2)
    return moment
