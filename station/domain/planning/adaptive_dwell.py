"""Dwells that end as soon as every coefficient is known as well as the recipe's `dwell.until_std` wants.

The recipe's own method says how each coefficient depends on each visit's mean; the noise as it has been so far says how
long each visit that is left must then last for the least sum (`planning.allocation`). A weighted method weighs
by the dwells, so its derivative and the dwells are improved in turn: the sum falls with each, and where it stays it
is the least (both are convex together, Pukelsheim 2006, ch. 2).

`until_std` is the wanted standard deviation, from noise, of every coefficient that the method estimates: of offsets in
the recipe's unit, of matrix entries by what they do to a reading at the strongest planned stimulus (at 1 g: in g per
g). It is read with a normal quantile, as every standard uncertainty of the budget.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.capture.rest_detection import expected_noise
from station.domain.core.types import Floats
from station.domain.methods import coefficients, method
from station.domain.methods.method import FitProblem
from station.domain.noise import noise
from station.domain.noise.running_noise import NoiseCurve, family_length
from station.domain.planning import nominal_visits
from station.domain.planning.allocation import least_dwells
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: Rounds of dwells and derivative from a cold start; a plan that goes on from its predecessor needs WARM.
ROUNDS, WARM = 16, 2
#: Dwells are planned for noise so many standard deviations of what is yet to be learnt above what it seems: a visit
#: that was left too early costs the others more than one that was left too late.
CAUTION = 0.3
#: A dwell is looked at again when it has become so much longer, if not earlier by its own plan.
GROWTH = 1.5
#: A plan that wants this little more is not waited for, as a share of the dwell.
NEAR = 2e-3
#: From this ratio of reached to wanted on, a calibration says that it was not reached.
SHORTFALL_RATIO = 1.05


@dataclass(frozen=True, slots=True, eq=False)
class AccuracyTarget:
    """What the planned visits (v) of all runs are for. std (12): wanted, infinite where the method estimates nothing;
    ideal: the visits as a perfect sensor sees them, one unit; shortest_s, longest_s: of a dwell; rate_hz."""

    recipe: Recipe
    std: Floats
    ideal: FitProblem
    shortest_s: float
    longest_s: float
    rate_hz: float

    def __len__(self) -> int:
        return len(self.ideal.pose)

    def jacobian(self, variance: Floats) -> Floats:
        """Derivative (f, 12, v, 3) of the coefficients by the means, whose noise has variance (f, v, 3)."""
        f = len(variance)
        many = self.ideal.take(np.zeros(f, np.intp))
        many = replace(many, true=np.broadcast_to(self.ideal.true[0], many.true.shape))
        many, kind = replace(many, cov=variance[..., None] * np.eye(3)), method.of(self.recipe)
        short = kind.together(many)
        return (short if short is not None and short.consistent.all() else kind.fit(many)).jacobian


@dataclass(frozen=True, slots=True, eq=False)
class DwellProgress:
    """Where a run of fixtures (f) stands. curve: of their noise; done_s (f, v): dwells of visits already done, 0 where
    still to come; observed: the visits that curve.variance_ratio is of; observed_s (f): how long they lasted."""

    curve: NoiseCurve
    done_s: Floats
    observed: NDArray[np.intp]
    observed_s: Floats

    def variance(self, dwell_s: Floats, rate_hz: float) -> Floats:
        """Variance (f, v, 3) of the means after dwells (f, v), widened as it will be when all of them are done."""
        count = np.maximum(dwell_s * rate_hz, 1.0)
        variance_ratio = np.ones((*dwell_s.shape, 3))
        variance_ratio[:, self.observed] = self.curve.variance_ratio
        by_count, dof = self.curve.at(count)
        final = dof * np.maximum(dwell_s.sum(axis=1) / self.observed_s, 1.0)[:, None, None]
        # By so much, in its logarithm, the estimate will still move (2/ν is the variance of ln χ²/ν).
        unsure = np.exp(CAUTION * np.sqrt(np.maximum(2 / dof - 2 / final, 0.0)))
        return np.asarray(by_count / count[..., None] * variance_ratio * noise.widening(final) * unsure)


@dataclass(frozen=True, slots=True, eq=False)
class DwellPlan:
    """Dwells (f, v), s, of every visit, those already done included, and the standard deviations (f, 12) they give."""

    dwell_s: Floats
    std: Floats


def target_std(recipe: Recipe, free: NDArray[np.bool_], strongest: float) -> Floats:
    """Wanted standard deviations (12) of the coefficients that are `free` (12); strongest: magnitude of the truth."""
    offset = recipe.dwell.until_std or np.inf
    std = np.where(coefficients.OFFSETS, offset, offset / strongest if strongest else np.inf)
    return np.where(free, std, np.inf)


def accuracy_target(recipe: Recipe) -> AccuracyTarget:
    """The aim of a recipe whose dwell is until_std."""
    dwell = recipe.dwell
    visits = nominal_visits.nominal_visits(recipe, np.full(len(nominal_visits.names(recipe)[0]), dwell.longest_s))
    problem = method.fit_problem(recipe, [visits])
    std = target_std(recipe, method.of(recipe).fit(problem).free, float(problem.magnitude.max()))
    return AccuracyTarget(recipe, std, problem, dwell.min_s, dwell.max_s, recipe.device.rate_hz)


def plan_dwells(aim: AccuracyTarget, so_far: DwellProgress, guess_s: Floats, rounds: int = WARM) -> DwellPlan:
    """Dwells that reach the aim in the least time for fixtures (f); guess_s (f, v): dwells to start from."""
    remaining = so_far.done_s[0] == 0
    dwell_s = np.where(remaining, guess_s, so_far.done_s)
    shortest, longest = (np.full((len(dwell_s), remaining.sum()), s) for s in (aim.shortest_s, aim.longest_s))
    for _ in range(rounds if remaining.any() else 0):
        part = _variance_shares(aim, so_far, dwell_s)
        price = (part * dwell_s[:, None])[..., remaining]
        dwell_s = dwell_s.copy()
        dwell_s[:, remaining] = least_dwells(price, part[..., ~remaining].sum(axis=2), shortest, longest)
    share = _variance_shares(aim, so_far, dwell_s).sum(axis=2)
    return DwellPlan(dwell_s, np.sqrt(share) * np.where(np.isfinite(aim.std), aim.std, 0.0))


def next_check_s(wanted_s: Floats, lasted_s: Floats) -> Floats:
    """When to look again at dwells that have lasted so long and are planned so long, s: `lasted_s` where they end."""
    return np.where(wanted_s <= lasted_s * (1 + NEAR), lasted_s, np.minimum(wanted_s, GROWTH * lasted_s))


def worst_curve(curves: Sequence[NoiseCurve], gold: NoiseCurve | None = None) -> NoiseCurve:
    """The noise that a fixture must reckon with: that of its noisiest unit in every axis, at every length of dwell.

    gold: of the gold reference, which comes on top of every unit's own.
    """
    found = NoiseCurve(
        count=curves[0].count,
        by_count=np.max([c.by_count for c in curves], axis=0),
        dof=np.min([c.dof for c in curves], axis=0),
        variance_ratio=np.max([c.variance_ratio for c in curves], axis=0),
    )
    return found if gold is None else replace(found, by_count=found.by_count + gold.by_count)


def initial_dwells_s(aim: AccuracyTarget, density: float) -> Floats:
    """Dwells (v) of every planned visit where white noise has so much variance · s in every axis."""
    white = np.full((1, 3, 1), density * aim.rate_hz)
    curve = NoiseCurve(np.ones(1), white, np.full((1, 3, 1), 1e9), np.ones((1, 0, 3)))
    guess = np.full((1, len(aim)), np.sqrt(aim.shortest_s * aim.longest_s))
    so_far = DwellProgress(curve, np.zeros_like(guess), np.zeros(0, np.intp), np.ones(1))
    return np.asarray(plan_dwells(aim, so_far, guess, ROUNDS).dwell_s[0])


def dwells_by_sheet_s(recipe: Recipe) -> Floats:
    """Dwells (v) of every planned visit of all runs, s, by the noise that the data sheet promises."""
    return planned_dwells_s(recipe, expected_noise(recipe) ** 2 / recipe.device.rate_hz)


def planned_dwells_s(recipe: Recipe, density: float) -> Floats:
    """Dwells (v) of every planned visit of all runs, s, where white noise has so much variance · s."""
    if recipe.dwell.time_s is not None:
        return np.full(len(nominal_visits.names(recipe)[0]), recipe.dwell.time_s)
    return initial_dwells_s(accuracy_target(recipe), density)


def prior_length(recipe: Recipe) -> int:
    """The readings that a prior of the noise is for (Prior.longest): those of the longest dwell by the data sheet."""
    return family_length(round(float(dwells_by_sheet_s(recipe).max()) * recipe.device.rate_hz))


def shortfall(recipe: Recipe, std: Floats, noise_std: Floats) -> Message | None:
    """What falls short of the wanted standard deviations (12) by those that noise leaves; None where nothing does."""
    ratio = noise_std / std
    worst = int(np.argmax(ratio))
    if not ratio[worst] > SHORTFALL_RATIO:
        return None
    dwell, unit = recipe.dwell, recipe.unit
    return Message(
        "dwell-too-short",
        coefficient=coefficients.NAMES[worst],
        std=float(noise_std[worst]),
        coefficient_unit=unit if coefficients.OFFSETS[worst] else "1",
        ratio=float(ratio[worst]),
        until_std=dwell.until_std,
        unit=unit,
        max_s=dwell.max_s,
    )


def _variance_shares(aim: AccuracyTarget, so_far: DwellProgress, dwell_s: Floats) -> Floats:
    """What each visit gives to each coefficient's variance (f, 12, v), over the wanted one, with dwells (f, v)."""
    variance = so_far.variance(dwell_s, aim.rate_hz)
    return np.asarray(np.einsum("fcvk,fvk->fcv", aim.jacobian(variance) ** 2, variance) / aim.std[:, None] ** 2)
