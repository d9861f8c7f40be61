"""The problem as it stands: data, simulation, floor structure and everything known so far."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.bank import Candidate, smooth_causes
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.going_round import possible_angles
from station.diagnosis.candidates.nuisance import AcceptedCause, active_together, nuisance_of
from station.diagnosis.candidates.solve import solve, whitened, with_most_in_first
from station.diagnosis.data.reduce import ReducedScene
from station.diagnosis.data.residuals import (
    ResidualView,
    changed_base,
    initial_view,
    with_calibration,
    with_contrast_noise,
)
from station.diagnosis.data.visit_noise import LEAST_OWN, share_beyond_chance
from station.diagnosis.linear.noise_floor import FloorStructure, floor_structure
from station.diagnosis.linear.projection import FloorCovariance, ResidualSpace
from station.diagnosis.search.scoring import ScoringProblem, ScoringSetting
from station.domain.core.types import Floats
from station.domain.recipe.recipe import Recipe
from station.model.effect import stimulus_strength
from station.model.effects.bias_walk import BiasWalk
from station.model.effects.repeatability import Repeatability
from station.model.model_file import Model, ModelEffect
from station.model.timeline import noise_density_of, usual_noise_density

#: Time from visit to visit for which the allowance of the walk holds; it grows with the root of time.
REFERENCE_INTERVAL_S = 2.5
#: Two axes share no more of their means than this, as a correlation.
MOST_SHARED = 0.95
#: A parameter of a model is never known better than to this share of the cause's typical size.
MIN_STD_SHARE = 1e-4
#: Where poses are unknown, a step of a calibration beyond this share of the stimulus must make the fit better, or is
#: halved, down to the least share of it.
FAR, LEAST_STEP_SHARE = 0.02, 1 / 256


@dataclass(frozen=True, slots=True)
class FloorAllowance:
    """What a healthy rig's floor may hold: turn, rad a visit; walk, recipe's unit a visit of 2.5 s. More is a
    finding.

    A device's bias wanders in proportion to its noise: one of ten times the usual density may walk ten times as far,
    and so may one whose filter or slow noise leaves ten times as much of a mean as samples that differ by chance do.
    Where no sheet states the noise, the device may be of the kind that wanders furthest.
    """

    turn: float = 1e-4
    walk: float = 1e-5

    @staticmethod
    def of(recipe: Recipe, model: Model) -> "FloorAllowance":
        """The usual allowance in the recipe's unit, or what a model has found the floor to hold, if that is more."""
        noisier = max(1.0, noise_density_of(recipe) / usual_noise_density(recipe))
        if "noise_density" not in recipe.device.model_fields_set:
            noisier *= BiasWalk.parameter.high / BiasWalk.parameter.typical
        turn, walk = 1e-4, 1e-5 * stimulus_strength(recipe) * noisier
        for modelled in model.effects:
            sizes = [float(p.value) for p in modelled.parameters if p.of == "common" and not isinstance(p.value, str)]
            if modelled.effect == Repeatability.id:
                turn = max([turn, *(1.5 * x for x in sizes)])
            elif modelled.effect == BiasWalk.id:
                walk = max([walk, *(1.5 * x for x in sizes)])
        return FloorAllowance(turn, walk)

    def upper(self, gap_s: float, slow: float = 1.0) -> Floats:
        """Bounds of the variances σ², τ_r², τ_w² where visits follow each other so many seconds apart; slow: square of
        the noise within the dwells beside that from one sample to the next."""
        longer = max(1.0, gap_s / REFERENCE_INTERVAL_S)
        return np.array([np.inf, self.turn**2, self.walk**2 * longer * max(1.0, slow)])


def initial_problem(reduced: ReducedScene, allowance: FloorAllowance, *, matrix: bool = False) -> ScoringProblem:
    """The problem before any cause is known: axes and visits each with the noise that their samples have, or all with
    the same, whichever makes the visits' means the likeliest. What shakes within a visit need not scatter its mean."""
    divisions = [replace(reduced, axis_noise=np.ones(3))]
    if reduced.scene.recipe.pose_known and not np.array_equal(reduced.axis_noise, np.ones(3)):
        divisions.append(reduced)
    if np.any(reduced.excess != 1.0):
        divisions += [division.by_own_noise() for division in divisions]
    if reduced.scene.recipe.pose_known and np.any(reduced.axis_correlation != np.eye(3)):
        divisions += [replace(division, axis_correlation=np.eye(3)) for division in divisions]
    problems = [_plain_problem(division, allowance, matrix=matrix) for division in divisions]
    best = problems[0] if len(problems) == 1 else max(problems, key=_likelihood)
    others = [replace(best.view.reduced, table_angles=angles) for angles in possible_angles(best.view)[1:]]
    if not others:
        return best
    return max([best, *(_plain_problem(one, allowance, matrix=matrix) for one in others)], key=_likelihood_in_dwells)


def _likelihood_in_dwells(problem: ScoringProblem) -> float:
    """Log-likelihood of the readings, what changes within the dwells included."""
    return problem.space(problem.fit().floor, moving=True).loglik


def _likelihood(problem: ScoringProblem) -> float:
    """Log-likelihood of the readings themselves, whatever was made of what their axes share."""
    space, apart = problem.fit().space, problem.view.apart
    return space.profile + space.dof / len(apart) * float(np.linalg.slogdet(apart)[1])


def sharing_scatter(problem: ScoringProblem) -> tuple[ScoringProblem, float] | None:
    """The problem in a floor in which the visits' means of two axes have as much in common as the readings show, drawn
    in as far as chance alone makes it, and the log-likelihood that this gains; None where they share nothing."""
    view, space = problem.view, problem.fit().space
    if view.grid.k != 3 or not space.dof:
        return None
    slot = view.grid.slot
    scatter = space.residual[:, : slot[0].size * 3].reshape(*slot.shape, 3)[slot >= 0]
    size = np.sqrt(np.mean(scatter**2, axis=0))
    if np.any(size <= 0):
        return None
    upper = np.triu_indices(3, 1)
    # Fisher's transform of a correlation has a variance of one over how many there are.
    alike = np.arctanh(np.clip((scatter / size).T @ (scatter / size) / len(scatter), -MOST_SHARED, MOST_SHARED)[upper])
    share = share_beyond_chance(alike, 3 / space.dof, 3)
    if share == 0.0:
        return None
    found = np.eye(3)
    found[upper] = found.T[upper] = np.tanh(share * alike)
    values, axes = np.linalg.eigh(found)
    found = (axes * np.maximum(values, LEAST_OWN)) @ axes.T
    apart = np.linalg.inv(view.reduced.means_apart)
    whole = apart @ found @ apart.T
    noise = np.sqrt(np.diagonal(whole))
    reduced = replace(view.reduced, visit_correlation=whole / noise / noise[:, None])
    view = replace(view, reduced=reduced, apart=reduced.means_apart)
    shared = problem_in_view(problem, view, problem.accepted)
    shared = replace(shared, setting=replace(shared.setting, structure=_structure(view)), near=None)
    return shared, _likelihood(shared) - _likelihood(problem)


def _plain_problem(reduced: ReducedScene, allowance: FloorAllowance, *, matrix: bool) -> ScoringProblem:
    """The problem under one division of the noise between axes and visits."""
    view = initial_view(reduced, matrix)
    known, places = nuisance_of(view, (), matrix)
    setting = ScoringSetting(view.layout, _structure(view), known, view.readings())
    slow = float(np.mean(view.contrast_noise.noise**2)) if view.contrast_noise.noise.size else 1.0
    return ScoringProblem(view, setting, (), places, matrix, allowance.upper(visit_interval_s(view), slow))


def _structure(view: ResidualView) -> FloorStructure:
    """The floor's structure: that of the rig as it should be."""
    turn = np.einsum("vki,via->vka", view.keep, view.signature(Repeatability.example())[0])
    steps = view.signature(BiasWalk.example())[0][:, 0, 0]
    weight = view.reduced.count.sum(1)
    share = view.reduced.axis_noise**2 * view.reduced.axis_excess if view.grid.k == 3 else np.ones(1)
    # A length does not change when the part turns; what rounding leaves of that is no structure.
    turn = turn if view.grid.k == 3 else np.zeros_like(turn)
    project = view.keep if view.grid.k == 1 else np.broadcast_to(view.apart, view.keep.shape)
    return floor_structure(view.grid, (weight / weight.mean())[:, None] / share, turn, np.round(steps), project)


def visit_interval_s(view: ResidualView) -> float:
    """The usual time from one visit to the next."""
    steps = np.diff(view.scene.time_s)[view.scene.visits.previous[1:] >= 0]
    return float(np.median(steps)) if len(steps) else 0.0


def with_model(problem: ScoringProblem, model: Model) -> ScoringProblem:
    """The problem with the causes of a model at work, each coefficient known as well as the model says."""
    items = [item for modelled in model.effects for item in _accepted_from_model(problem.view, modelled)]
    if not items:
        return problem
    view = with_active_causes(problem.view, tuple(items))
    return refined(problem_in_view(problem, view, tuple(items)))


def _accepted_from_model(view: ResidualView, modelled: ModelEffect) -> Iterator[AcceptedCause]:
    """A cause of a model file, once for each level it speaks of; gross faults and the floor are known otherwise."""
    effect = modelled.build()
    if modelled.term is None and effect.id not in smooth_causes():
        return
    for found in modelled.acting(view.scene, None):
        code, names = view.scene.group(found.of)
        std = np.zeros(found.coefficients.shape)
        for p in modelled.parameters:
            if (at := modelled.place(effect, p)) is not None and p.of in names:
                std[names.index(p.of), at] = p.std or 0.0
        hit = np.any(found.coefficients != 0.0, axis=1) | np.any(std > 0, axis=1)
        if hit.any():
            std = np.maximum(std, MIN_STD_SHARE * effect.parameter.typical * effect.parameter.scale(view.scene.recipe))
            columns = CauseColumns.of(*view.signature(found.effect, found.of))
            candidate = Candidate(effect.id, found.effect, found.of, "own", code, names, columns)
            yield AcceptedCause(candidate, hit, found.coefficients, found.coefficients, std)


def problem_in_view(problem: ScoringProblem, view: ResidualView, accepted: tuple[AcceptedCause, ...]) -> ScoringProblem:
    """The problem in another view, with its causes as they look there.

    The floor's structure stays: by what the causes at work bend it is a share of a small part of the noise.
    """
    accepted = tuple(item.in_view(view) for item in accepted)
    known, places = nuisance_of(view, accepted, problem.matrix)
    setting = ScoringSetting(view.layout, problem.structure, known, view.readings())
    return replace(problem, view=view, setting=setting, accepted=accepted, places=places)


def refined(problem: ScoringProblem, rounds: int = 4) -> ScoringProblem:
    """The simulation with all known parameters at their best: Gauss–Newton under the floor, exact at its end."""
    for _ in range(rounds):
        readings, _ = problem.readings(moving=problem.known.moving)
        fitted = problem.fit()
        white = whitened(fitted.space.covariance, problem.known, readings)
        solved = solve(white)
        calibration, own = problem.view.calibration(problem.matrix).shape[-1], solved.own
        if problem.view.scene.recipe.feels_rotation:
            # The speed of the rate table moves what a gain does.
            own = with_most_in_first(white.own, own, calibration)
        own = own[:, :calibration]
        steps = [solved.at(place)[0] for place in problem.places]
        moved = _moved(problem, own, steps)
        if problem.view.grid.k == 1 and _is_far(problem.view, own):
            share, misfit = 1.0, float(np.sum(white.data**2))
            while _misfit(problem, moved, fitted.space.covariance) > misfit:
                share /= 2
                if share < LEAST_STEP_SHARE:
                    return problem
                moved = _moved(problem, share * own, [share * step for step in steps])
        problem = replace(problem_in_view(problem, *moved), near=fitted.floor)
        at_work = [s for s, item in zip(steps, problem.accepted, strict=True) if item.candidate.effect]
        if _converged(fitted.floor.noise, [own, *at_work]):
            break
    return problem


_Moved = tuple[ResidualView, tuple[AcceptedCause, ...]]


def _moved(problem: ScoringProblem, own: Floats, steps: list[Floats]) -> _Moved:
    """A problem's view with calibrations changed by own (U, p), and its causes with coefficients changed by steps."""
    accepted = tuple(
        replace(item, coefficient=item.coefficient + step) if item.candidate.effect else item
        for item, step in zip(problem.accepted, steps, strict=True)
    )
    view = with_calibration(problem.view, changed_base(problem.view.base, own))
    return with_active_causes(view, accepted), accepted


def _is_far(view: ResidualView, own: Floats) -> bool:
    """Whether a change of calibrations (U, p) is one over which a magnitude is not nearly linear."""
    stimulus = stimulus_strength(view.scene.recipe)
    return bool(np.max(np.abs(own[:, :3]), initial=0.0) > FAR * stimulus or np.max(np.abs(own[:, 3:])) > FAR)


def _misfit(problem: ScoringProblem, moved: _Moved, covariance: FloorCovariance) -> float:
    """Sum of squares of what a moved view leaves under a floor, priors included; no column of a cause is needed."""
    view, accepted = moved
    rows, _ = replace(problem.setting, data=view.readings()).readings(moving=problem.known.moving)
    white = covariance.whiten(rows, 0 if rows.dwell is None else rows.dwell.shape[1])
    priors = (((item.mean - item.coefficient) / item.std)[item.hit] for item in accepted)
    return float(np.sum(white**2)) + sum(float(np.sum(off**2)) for off in priors)


def with_active_causes(view: ResidualView, accepted: tuple[AcceptedCause, ...]) -> ResidualView:
    """The view with the accepted causes at work."""
    return with_contrast_noise(replace(view, active=active_together(accepted)))


def _converged(noise: float, steps: list[Floats]) -> bool:
    """Whether the last step of every parameter is far below the noise: what it leaves is of second order."""
    return all(float(np.max(np.abs(s), initial=0.0)) < 1e-3 * noise for s in steps)


def marginal_nats(problem: ScoringProblem, space: ResidualSpace | None = None) -> float:
    """Log-likelihood of the readings beside everything known, with the coefficients fitted under their priors, in a
    space, or else in that of the floor that fits best."""
    priors = np.concatenate([problem.known.per_unit_precision.ravel(), problem.known.shared_precision])
    space = problem.fit().space if space is None else space
    return space.profile + 0.5 * float(np.sum(np.log(priors[priors > 0])))
