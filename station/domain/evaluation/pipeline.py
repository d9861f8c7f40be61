"""Samples → visits → calibration → budget → verdict: the one path of the run, the command and the refit."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.domain.capture.rest_segments import orientations
from station.domain.core.types import Calibration, Floats, Outcome, Reason, ReducedVisits, SampleTable, Verdict
from station.domain.evaluation import quality
from station.domain.evaluation.unit_dwells import UnitDwells, reduce_table, reduce_visits
from station.domain.methods import method, rank, scatter, tilt, uncertainty
from station.domain.methods.coefficients import matrix_of, offset_of
from station.domain.methods.decision import Decision
from station.domain.methods.decision_rule import JudgedUnit, decisions, judge
from station.domain.methods.method import Fit
from station.domain.methods.scatter import SolvedUnits
from station.domain.methods.uncertainty import Budget
from station.domain.noise.noise_prior import NoisePrior
from station.domain.planning import adaptive_dwell, design
from station.domain.recipe import references
from station.domain.recipe.recipe import Recipe
from station.messages import Message

NO_ROUNDING = np.zeros(12)
#: Readings that vary by less than this share of the stimulus show no middle to count directions from.
TURNED = 0.3
#: What the magnitude alone must determine: three offsets and three gains, or six entries of a triangular matrix.
MAGNITUDE_UNKNOWNS = {"offset-gain": 6, "matrix": 9}
#: Units solved together: enough to be fast, few enough for a processor's cache.
BATCH = 128


#: Serial, visits, and what the samples came to where there are samples.
UnitInput = tuple[str, ReducedVisits, UnitDwells | None]


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """What one unit came to. Where its samples cannot be calibrated all but serial and verdict are None."""

    serial: str
    verdict: Verdict
    visits: ReducedVisits | None = None
    calibration: Calibration | None = None
    budget: Budget | None = None
    dwells: UnitDwells | None = None
    recipe: Recipe | None = None

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Every limit as it was decided; computed when it is wanted, which of a fleet it is not."""
        if self.recipe is None or self.calibration is None or self.budget is None or self.visits is None:
            return ()
        return decisions(self.recipe, self.calibration, self.budget, self.visits)


def calibrate(
    recipe: Recipe, table: SampleTable, today: str, rounding: Floats = NO_ROUNDING, prior: NoisePrior | None = None
) -> Iterator[CalibrationResult]:
    """Every unit of a table, one after the other; one that cannot be calibrated does not stop the others.

    today: ISO 8601 date for the gold reference's due date; rounding (12): standard deviation of each coefficient's
    rounding in the device; prior: what is known of such units' noise. Errors: RecipeError, ReferenceOverdue,
    SamplesError (of the table as a whole).
    """
    return calibrate_portions(recipe, [table], today, rounding, prior)


def calibrate_portions(
    recipe: Recipe,
    tables: Iterable[SampleTable],
    today: str,
    rounding: Floats = NO_ROUNDING,
    prior: NoisePrior | None = None,
) -> Iterator[CalibrationResult]:
    """The same for tables of whole units each, one after the other: memory follows the largest of them."""
    # What is wrong with the recipe is said before any table is read.
    _check(recipe, today)
    yield from calibrate_dwells(recipe, (u for t in tables for u in reduce_table(t, recipe, prior)), today, rounding)


def calibrate_dwells(
    recipe: Recipe, units: Iterable[UnitDwells], today: str, rounding: Floats = NO_ROUNDING
) -> Iterator[CalibrationResult]:
    """The same for what the samples of each unit came to."""
    _check(recipe, today)
    truths: references.Truths = {}
    batch: list[UnitInput] = []
    for found in units:
        batch.append((found.serial, reduce_visits(found, recipe, truths), found))
        if len(batch) == BATCH:
            yield from _solve(recipe, batch, rounding)
            batch = []
    yield from _solve(recipe, batch, rounding)


def _check(recipe: Recipe, today: str) -> None:
    """Errors: RecipeError, ReferenceOverdue."""
    design.check(recipe)
    references.check_due(recipe, today)


def calibrate_reduced(
    recipe: Recipe, units: Mapping[str, ReducedVisits], rounding: Floats = NO_ROUNDING
) -> list[CalibrationResult]:
    """The same from visits that are already reduced (those of the log), without the checks of raw samples."""
    design.check(recipe)
    return _solve(recipe, [(serial, visits, None) for serial, visits in units.items()], rounding)


def _solve(recipe: Recipe, units: Sequence[UnitInput], rounding: Floats) -> list[CalibrationResult]:
    """Units that went through the same visits are solved together; the order of the results is that of the units."""
    same_truth: dict[object, list[int]] = {}
    for i, (_, visits, _) in enumerate(units):
        # Of hand-held visits each unit has directions of its own.
        truth = visits.true if recipe.pose_known else visits.mean
        same_truth.setdefault((visits.position, visits.seating, truth.tobytes()), []).append(i)
    done: dict[int, CalibrationResult] = {}
    for members in same_truth.values():
        group = [units[i] for i in members]
        why = _undetermined_reason(recipe, group[0][1])
        found = [_refused(serial, why) for serial, _, _ in group] if why else _solve_group(recipe, group, rounding)
        done.update(zip(members, found, strict=True))
    return [done[i] for i in range(len(units))]


def _solve_group(recipe: Recipe, units: Sequence[UnitInput], rounding: Floats) -> list[CalibrationResult]:
    done: dict[int, CalibrationResult] = {}
    # Readings that are no calibration end in NaN, and NaN in a verdict.
    with np.errstate(all="ignore"):
        for part in scatter.solve(method.of(recipe), method.fit_problem(recipe, [s for _, s, _ in units])):
            own = [units[i] for i in part.units.tolist()]
            done.update(zip(part.units.tolist(), _results(recipe, own, part, rounding), strict=True))
    return [done[i] for i in range(len(units))]


def _results(
    recipe: Recipe, units: Sequence[UnitInput], part: SolvedUnits, rounding: Floats
) -> list[CalibrationResult]:
    """One result a unit of a part."""
    budgets = uncertainty.budgets(recipe, part.problem, part.fit, units[0][1], rounding)
    covariance, tilts = uncertainty.covering(budgets), tilt.of(part.problem, part.fit)
    tilts_deg, rms = (np.rad2deg(tilts[0]), np.rad2deg(tilts[1])), _residual_rms(recipe, part.fit)
    invalid, judged = _invalid_fit_reasons(part.fit), []
    for (_, visits, measured), u in zip(units, part.rows.tolist(), strict=True):
        own = budgets[u], covariance[u], (tilts_deg[0][u], tilts_deg[1][u]), float(rms[u])
        found, reasons = _calibration(recipe, visits, (part.fit, u), own), invalid[u]
        if measured is not None:
            found = replace(found, notes=(*found.notes, *quality.notes(recipe, measured)))
            reasons = (*reasons, *quality.reasons(recipe, measured, visits))
        judged.append(JudgedUnit(found, budgets[u], visits, reasons))
    return [
        CalibrationResult(serial, verdict, visits, one.found, one.budget, measured, recipe)
        for (serial, visits, measured), one, verdict in zip(units, judged, judge(recipe, judged), strict=True)
    ]


def _calibration(
    recipe: Recipe,
    visits: ReducedVisits,
    fitted: tuple[Fit, int],
    of_unit: tuple[Budget, Floats, tuple[Floats, Floats], float],
) -> Calibration:
    """of_unit: its budget, the covariance that covers, its visits' tilts and their standard deviations, in degrees,
    and the RMS of its residuals."""
    (fit, u), (budget, covariance, tilts_deg, rms) = fitted, of_unit
    return Calibration(
        method=recipe.method,
        unit=recipe.unit,
        offset=offset_of(fit.theta[u]),
        matrix=matrix_of(fit.theta[u]),
        covariance=covariance,
        positions=visits.position,
        residual=fit.residual[u],
        tilt_deg=tilts_deg[0],
        tilt_std_deg=tilts_deg[1],
        disturbed=fit.disturbed[u],
        residual_rms=rms,
        notes=(
            *_disturbed(visits, fit, u, recipe.unit),
            *_scatter(budget, recipe.unit),
            *_dwell(recipe, fit, visits, budget),
            *fit.notes[u],
        ),
    )


def _residual_rms(recipe: Recipe, fit: Fit) -> Floats:
    """Root mean square (u) of the residuals of each unit's undisturbed visits."""
    square = (fit.residual**2).sum(axis=2)
    mean = square.mean(axis=1)
    for u in np.flatnonzero(fit.disturbed.any(axis=1)).tolist():
        mean[u] = square[u][~fit.disturbed[u]].mean()
    # Of a hand-held visit only the magnitude can be off: one number, not one an axis.
    return np.asarray(np.sqrt(mean / (recipe.axes if recipe.pose_known else 1)))


def _dwell(recipe: Recipe, fit: Fit, visits: ReducedVisits, budget: Budget) -> Iterator[Message]:
    """What is known less well than the recipe's dwell.until_std wants."""
    if recipe.dwell.until_std is None:
        return
    known = recipe.pose_known
    strongest = np.linalg.norm(visits.true, axis=1).max() if known else recipe.reference.strength()
    wanted = adaptive_dwell.target_std(recipe, fit.free, float(strongest))
    if note := adaptive_dwell.shortfall(recipe, wanted, budget.covering_std("noise")):
        yield note


def _disturbed(visits: ReducedVisits, fit: Fit, u: int, unit: str) -> Iterator[Message]:
    for v in np.flatnonzero(fit.disturbed[u]):
        off = float(np.abs(fit.residual[u, v]).max())
        run, visit = int(visits.run[v]), int(visits.visit[v])
        place = Message("visit-place", position=visits.position[v], run=run, visit=visit)
        yield Message("visit-disturbed", place=place, value=off, unit=unit)


def _scatter(budget: Budget, unit: str) -> Iterator[Message]:
    if budget.scatter > 0:
        yield Message("visits-scatter", value=budget.scatter, unit=unit)


def _invalid_fit_reasons(fit: Fit) -> list[tuple[Reason, ...]]:
    """Of each unit why its fit is no calibration: not settled, not finite, or a matrix that mirrors."""
    finite, upright = np.asarray(np.isfinite(fit.theta).all(axis=1)), np.linalg.det(matrix_of(fit.theta)) > 0
    reasons: list[tuple[Reason, ...]] = [(Reason(own[0], check="fit"),) if own else () for own in fit.notes]
    for u in np.flatnonzero(~(finite & upright)).tolist():
        why = Message("fit-mirrors" if finite[u] else "fit-not-finite")
        reasons[u] = (*reasons[u], Reason(why, check="fit"))
    return reasons


def _undetermined_reason(recipe: Recipe, visits: ReducedVisits) -> Message | None:
    """Why such visits cannot determine the coefficients; None when they can."""
    if not recipe.pose_known and (few := _too_few_poses(recipe, visits)) is not None:
        return few
    true = visits.true if recipe.pose_known else _directions(visits) * recipe.reference.strength()
    nuisance = method.nuisance(recipe, visits.position, visits.seating, true)
    rows, names = method.of(recipe).design(true, recipe, nuisance)
    lost = rank.undetermined(rows, names, rank.EXACT_TOLERANCE if recipe.pose_known else rank.NOISY_TOLERANCE)
    if not lost:
        return None
    undetermined = {"method": recipe.method, "coefficients": tuple(lost)}
    if missing := tuple(p.name for p in recipe.positions if p.name not in visits.position):
        return Message("positions-not-visited", positions=missing, **undetermined)
    return Message("visits-too-similar", **undetermined)


def _too_few_poses(recipe: Recipe, visits: ReducedVisits) -> Message | None:
    """A magnitude gives one equation a pose; the scatter of poses held again is none."""
    turned = np.ptp(visits.mean, axis=0).max() > TURNED * recipe.reference.strength()
    poses = int(orientations(_directions(visits) if turned else visits.mean).max(initial=-1)) + 1
    needed = MAGNITUDE_UNKNOWNS[recipe.model]
    return Message("too-few-poses", poses=poses, needed=needed, model=recipe.model) if poses < needed else None


def _directions(visits: ReducedVisits) -> Floats:
    """Directions (v, 3) that hand-held visits seem to have: from the middle of the extremes."""
    apart = visits.mean - (visits.mean.max(axis=0) + visits.mean.min(axis=0)) / 2
    return np.asarray(apart / np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), 1e-300))


def _refused(serial: str, why: Message) -> CalibrationResult:
    reason = Reason(Message("unit-not-calibrated", serial=serial, reason=why), check="samples")
    return CalibrationResult(serial, Verdict(Outcome.ERROR, (reason,), Message("rule-none"), 0.0, 0.0))
