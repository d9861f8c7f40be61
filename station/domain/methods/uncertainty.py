"""The uncertainty budget of every coefficient (GUM, JCGM 100): every cause, its covariance, its degrees of freedom."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np

from station.domain.core.types import Floats, ReducedVisits
from station.domain.methods import (
    coefficients,
    contributions,
    coverage,
    hidden_scatter,
    quantisation,
    residual_scatter,
    scatter,
    stated_poses,
    stated_runs,
    tilt,
)
from station.domain.methods.method import Fit, FitProblem
from station.domain.methods.scatter import LackOfFit
from station.domain.noise import noise
from station.domain.recipe import assumptions, references
from station.domain.recipe.recipe import Recipe

#: The budget line for what visits differ by beyond noise and declared pose errors (station.domain.methods.scatter).
SCATTER = "scatter"
#: A squared misfit below this share of its variance is rounding: the fit goes through that reading whatever it is.
ROUNDING = 1e-12
#: Edition of the rules by which budgets are made; it stands in every record, because another edition gives other bits.
RULES = 12
#: Editions whose `residuals` are ratios in the same units.
SAME_RATIOS = (9, 10, 11, RULES)


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """Covariances (12, 12) of one unit by cause, their sum, and the effective degrees of freedom (12) of its diagonal.

    part_dof: degrees of freedom (12) of the causes that are estimates; what is not there is taken as known. scatter:
    standard deviation, in the recipe's unit, of what visits clearly differ by beyond noise and declared pose errors; 0
    when those explain the residuals, although the budget then still holds what residuals leave possible. residuals:
    χ²/ν and ν of what poses differ by, for the budgets of later units; ν is 0 where no reading is left over.
    rectangle, shift (12): of the error's distribution (coverage.ErrorDistribution).
    """

    parts: Mapping[str, Floats]
    total: Floats
    dof: Floats
    scatter: float
    part_dof: Mapping[str, Floats]
    residuals: tuple[float, float] = (0.0, 0.0)
    rectangle: Floats = field(default_factory=lambda: np.zeros(12))
    shift: Floats = field(default_factory=lambda: np.zeros(12))

    def std(self, cause: str | None = None) -> Floats:
        """Standard uncertainties u (12), of one cause or of all."""
        of = self.total if cause is None else self.parts[cause]
        return np.asarray(np.sqrt(np.maximum(np.diagonal(of), 0.0)))

    def error(self) -> coverage.ErrorDistribution:
        """Distribution of each coefficient's error (12)."""
        return coverage.ErrorDistribution(self.std(), self.dof, self.rectangle, self.shift)

    def expanded(self) -> Floats:
        """Expanded uncertainties U (12), each of which holds the error with coverage.PROBABILITY."""
        return self.error().expanded()

    def factor(self) -> Floats:
        """Coverage factors k = U/u (12); Student's quantile where there is no u."""
        return np.asarray(_factor(self.error()))

    def covering(self) -> Floats:
        """The covariance (12, 12) scaled so that ± 1.96 of its standard deviations are U: what is handed on to those
        who take it as known."""
        return np.asarray(covering([self])[0])

    def covering_std(self, cause: str) -> Floats:
        """Standard uncertainties (12) of a cause, scaled so that ± 1.96 of them hold coverage.PROBABILITY."""
        own = self.part_dof.get(cause)
        return self.std(cause) * (1.0 if own is None else coverage.factor(own) / coverage.NORMAL)

    def document(self, unit: str) -> list[dict[str, object]]:
        """One entry a coefficient: standard uncertainty u and its share by cause, ν_eff, rectangle and shift of the
        error's distribution, k, and U = k·u."""
        std, error = self.std(), self.error()
        factor, expanded = _factor(error), error.expanded()
        by_cause = {cause: self.std(cause) for cause in self.parts}
        return [
            {
                "coefficient": name,
                "unit": coefficients.unit_of(i, unit),
                "std": float(std[i]),
                "dof": float(self.dof[i]),
                "rectangle": float(self.rectangle[i]),
                "shift": float(self.shift[i]),
                "k": float(factor[i]),
                "expanded": float(expanded[i]),
                "coverage_probability": coverage.PROBABILITY,
                "parts": {cause: float(s[i]) for cause, s in by_cause.items()},
            }
            for i, name in enumerate(coefficients.NAMES)
        ]


def covering(of: Sequence[Budget]) -> Floats:
    """Covariances (u, 12, 12) as `Budget.covering` has them."""
    total = np.array([budget.total for budget in of])
    std = np.sqrt(np.maximum(_variances(total), 0.0))
    rest = (np.array([getattr(budget, name) for budget in of]) for name in ("dof", "rectangle", "shift"))
    scale = _factor(coverage.ErrorDistribution(std, *rest)) / coverage.NORMAL
    return np.asarray(total * scale[:, :, None] * scale[:, None, :])


def _factor(error: coverage.ErrorDistribution) -> Floats:
    return np.where(error.std > 0, error.expanded() / np.maximum(error.std, 1e-300), coverage.factor(error.dof))


def budgets(recipe: Recipe, problem: FitProblem, fit: Fit, visits: ReducedVisits, rounding: Floats) -> list[Budget]:
    """The budget of each unit. visits: of one of them; rounding (12): standard deviations of the coefficients' rounding
    in the device."""
    u = len(fit.theta)
    problem, fit = stated_runs.without_offsets_of_runs(recipe, *_with_rounding(problem, fit), visits)
    pose_std, pose_dof = _pose_std(recipe, problem, fit)
    scattered, residuals = _scatter(recipe, problem, fit, hidden_scatter.bound(recipe, problem, pose_std))
    rounded = quantisation.quantisation(recipe, problem, fit)
    of_converter, shift = contributions.converter(recipe, problem, fit)
    parts = {
        "noise": contributions.noise(fit, _plain_noise(problem)),
        "quantisation": rounded.covariance,
        "converter": of_converter,
        "position": contributions.position(problem, fit, pose_std),
        **_truth(recipe, problem, fit, visits),
        "method": contributions.method(recipe, problem, fit),
        "temperature": contributions.temperature(recipe, problem, fit),
        "runs": contributions.turn_on(recipe, fit, visits),
        "reproducibility": contributions.reproducibility(recipe, fit),
        "rounding": np.broadcast_to(np.diag(np.where(fit.free, rounding, 0.0) ** 2), (u, 12, 12)),
        SCATTER: reduce(np.add, (one.covariance for one in scattered)),
    }
    # A coefficient that the method takes for granted has no uncertainty of its own: its error is in the others.
    if not fit.free.all():
        parts = {cause: part * fit.free[:, None] * fit.free for cause, part in parts.items()}
    total = reduce(np.add, parts.values())
    total = (total + total.transpose(0, 2, 1)) / 2
    dofs = {"noise": _dof_of_noise(problem), SCATTER: _together(scattered), "position": pose_dof}
    if recipe.reproducibility is not None:
        dofs["reproducibility"] = np.full((u, 12), recipe.reproducibility.dof)
    dof = coverage.effective_dof(_variances(total), [(_variances(parts[c]), own) for c, own in dofs.items()])
    std = np.sqrt(np.maximum(_variances(total), 0.0))
    error = coverage.ErrorDistribution(std, dof, rounded.rectangle * fit.free, shift * fit.free).telling()
    spread = np.sqrt(problem.scatter_pose + problem.scatter_visit)
    return [
        Budget(
            {c: v[i] for c, v in parts.items()},
            total[i],
            dof[i],
            float(spread[i]),
            {c: d[i] for c, d in dofs.items()},
            (float(residuals[0][i]), float(max(residuals[1][i], 0.0))),
            error.rectangle[i],
            error.shift[i],
        )
        for i in range(u)
    ]


def _with_rounding(problem: FitProblem, fit: Fit) -> tuple[FitProblem, Fit]:
    """With as much rounding as the budget is to count; the fit weighed with what single dwells seem to show."""
    more = problem.rounding - problem.quantisation
    if not more.any():
        return problem, fit
    cov = problem.cov + contributions.diagonal(more)
    felt = more[..., : fit.noise.shape[2]] if fit.tilt is None else more.mean(axis=2, keepdims=True)
    # Scatter that the fit found beyond what it knew of rounding holds the rest of it.
    left = np.where(problem.scatter_pose > 0, np.maximum(problem.scatter_pose - felt.mean(axis=(1, 2)), 0.0), 0.0)
    known = replace(problem, cov=cov, quantisation=problem.rounding, scatter_pose=left)
    return known, replace(fit, noise=fit.noise + felt)


@dataclass(frozen=True, slots=True, eq=False)
class _Scatter:
    """Covariance (u, 12, 12) of one kind of scatter, and its degrees of freedom (u)."""

    covariance: Floats
    dof: Floats


def _scatter(
    recipe: Recipe, problem: FitProblem, fit: Fit, hidden: hidden_scatter.Kind
) -> tuple[list[_Scatter], tuple[Floats, Floats]]:
    """Scatter of visits of one pose, and of poses, for which residuals of earlier units are heard, too; χ²/ν and ν (u)
    of the latter's residuals. hidden: what no residual shows."""
    u, _, v, _ = fit.jacobian.shape
    found = scatter.lack_of_fit(replace(problem, scatter_visit=np.zeros(u)), fit)
    ratio, noise_variance = _ratio(problem.scatter_visit, found.within, found.of_within, found.dof_within)
    over, dof = residual_scatter.excess(ratio, found.dof_within)
    visit = over * noise_variance
    own = fit.jacobian.reshape(u, 12, 3 * v)
    of_visits = _Scatter(visit[:, None, None] * (own @ own.transpose(0, 2, 1)), dof)
    found = scatter.lack_of_fit(replace(problem, scatter_visit=visit), fit)
    earlier = recipe.residuals
    usual = residual_scatter.NOTHING_KNOWN if earlier is None else (earlier.ratio, earlier.dof)
    if stated_poses.apply(recipe, problem, fit):
        shown, residuals = _with_stated_poses(problem, fit, found, usual)
        return [of_visits, *_largest(problem, fit, [*shown, hidden])], residuals
    ratio, noise_variance = _ratio(problem.scatter_pose, found.between, found.of_between, found.dof_between)
    over, dof = residual_scatter.excess(ratio, found.dof_between, usual)
    each = (over * noise_variance)[:, None, None] * _pose_shape(problem, fit)
    return [of_visits, *_largest(problem, fit, [(each, dof), hidden])], (ratio, found.dof_between)


def _with_stated_poses(
    problem: FitProblem, fit: Fit, found: LackOfFit, usual: tuple[float, float]
) -> tuple[list[hidden_scatter.Kind], tuple[Floats, Floats]]:
    """Scatter alike on all readings, and errors of poses beyond the stated ones."""
    even, poses = stated_poses.components(problem, fit, found, usual)
    over, dof = residual_scatter.excess(even.ratio, even.dof, usual)
    more, dof_of_more = residual_scatter.excess(poses.ratio, poses.dof)
    a, b = over[:, None, None] * even.unit, more[:, None, None] * poses.unit
    return [(a, dof), (b, dof_of_more)], (even.ratio, even.dof)


def _largest(problem: FitProblem, fit: Fit, kinds: Sequence[hidden_scatter.Kind]) -> Iterator[_Scatter]:
    """Of several kinds of scatter each reading gets the largest."""
    largest = np.argmax([variance for variance, _ in kinds], axis=0)
    for i, (variance, dof) in enumerate(kinds):
        if variance.any():
            yield _Scatter(_of_poses(problem, fit, np.where(largest == i, variance, 0.0)), dof)


def _of_poses(problem: FitProblem, fit: Fit, variance: Floats) -> Floats:
    """Covariance (u, 12, 12) from errors of that variance (u, v, 3), one draw for all visits of a pose."""
    felt = fit.jacobian * np.sqrt(variance)[:, None]
    shared = contributions.by_pose(problem, felt.transpose(0, 1, 3, 2))
    return np.asarray(shared @ shared.transpose(0, 2, 1))


def _ratio(clear: Floats, square: Floats, variance: Floats, dof: Floats) -> tuple[Floats, Floats]:
    """χ²/ν (u), and the variance (u) that is its unit. clear (u): variance of scatter that the fit weighs with, or 0,
    which then is what the residuals show."""
    used = square > ROUNDING * variance
    usual = (variance * used).sum(axis=1) / np.maximum(used.sum(axis=1), 1)
    plain = (square / variance).sum(axis=1) / np.maximum(dof, 1.0)
    return np.where(clear > 0, 1 + clear / np.maximum(usual, 1e-300), plain), usual


def _pose_shape(problem: FitProblem, fit: Fit) -> Floats:
    """Variance (u, v, 3) of readings for scatter of 1 among residuals, whether poses make it or anything else.

    Errors of poses leave alone the axis along the stimulus, so that the others have more than residuals show on
    average. Of either kind of scatter, each reading gets the larger variance. A fit of magnitudes feels no poses.
    """
    u, _, v, _ = fit.jacobian.shape
    if fit.tilt is not None or not problem.pose_known or problem.turned is not None:
        return np.ones((u, v, 3))
    size = np.maximum(problem.magnitude, 1e-300)[..., None]
    across = np.clip(1 - (problem.true / size) ** 2, 0.0, 1.0)
    still = np.where(fit.disturbed, 0.0, 1.0)[..., None] * np.maximum(1 - tilt.leverages(problem, fit), 0.0)
    share = (still * across).sum(axis=(1, 2)) / np.maximum(still.sum(axis=(1, 2)), 1e-12)
    return np.asarray(np.maximum(1.0, across / np.maximum(share, 0.2)[:, None, None]))


def _pose_std(recipe: Recipe, problem: FitProblem, fit: Fit) -> tuple[Floats, Floats]:
    """Pose error (u) about each axis, rad, and its degrees of freedom (u, 12): stated, as the method finds it in the
    tilts, or the default where residuals are too few to show it."""
    u = len(fit.theta)
    if recipe.reference.source == "gold" or not problem.pose_known:
        return np.zeros(u), np.full((u, 12), coverage.MANY)
    poses = int(problem.pose.max()) + 1
    residual_dof = fit.misfit.shape[2] * poses - fit.parameters if fit.tilt is None else 2 * poses - 3
    stated = np.deg2rad(assumptions.pose_deg(recipe, residual_dof))
    std = np.maximum(fit.pose_std_rad, stated)
    dof = np.where(fit.pose_std_rad > stated, fit.pose_dof, coverage.MANY)
    return std, np.repeat(dof[:, None], 12, axis=1)


def _plain_noise(problem: FitProblem) -> Floats:
    """Covariance (u, v, 3, 3) of the means by noise, without the widening for being an estimate."""
    root = np.sqrt(noise.widening(problem.dof))
    of_noise = problem.cov - contributions.diagonal(problem.quantisation)
    return np.asarray(of_noise / (root[..., :, None] * root[..., None, :]))


def _truth(recipe: Recipe, problem: FitProblem, fit: Fit, visits: ReducedVisits) -> dict[str, Floats]:
    """What the sensor kind says its stimulus may be wrong by; hand-held visits know no more than the magnitude."""
    if not problem.pose_known:
        relative = assumptions.magnitude_relative_std(recipe)
        gain = np.where(coefficients.OFFSETS, 0.0, fit.theta) * relative
        return {"magnitude": gain[:, :, None] * gain[:, None, :]}
    found = dict(references.truth_errors(recipe, visits.position, visits.seating, visits.true))
    degrees = assumptions.directions_deg(recipe)
    found |= references.direction_errors(recipe, visits.position, visits.seating, visits.true, degrees)
    return {name: contributions.patterns(fit, pattern) for name, pattern in found.items()}


def _dof_of_noise(problem: FitProblem) -> Floats:
    """Degrees of freedom (u, 12): those of the axis' noise."""
    axis = problem.dof.min(axis=1)
    return np.concatenate([axis, np.repeat(axis, 3, axis=1)], axis=1)


def _together(scattered: Sequence[_Scatter]) -> Floats:
    """Degrees of freedom (u, 12) of the sum of all."""
    parts = [(_variances(one.covariance), one.dof[:, None]) for one in scattered]
    return coverage.effective_dof(reduce(np.add, (variance for variance, _ in parts)), parts)


def _variances(covariance: Floats) -> Floats:
    return np.asarray(np.einsum("uii->ui", covariance))
