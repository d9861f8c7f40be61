"""What a cause gains on data it was not fitted to.

The white rows of the visits are independent, so a part of them can be held out and predicted from the rest. What is
held out depends on the cause: visits where each unit has its own coefficient, units where all share one, samples where
a single visit is hit. The score is logarithmic. Its standard error is that of the sum of the paired differences of the
visits or, where few of them move, that of their white noise.

The numbers of the cause are those that the rest tells. Of calibrations and other causes the rest may tell nothing: of
a bumped visit that is held out, of the offsets of runs that walk, of a position met once. So the prediction is as wide
as they leave it: with r what the rest leaves of the held-out rows, S their covariance given the rest and e what a fit
to all rows leaves of them, S⁻¹r = e, and the score is −½ rᵀS⁻¹r = −½ rᵀe. With the cause, its prediction is taken off
the readings first, so that S is the same on both sides.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.solve import NuisanceSolution, WhiteRows, solve, whitened
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import NuisanceColumns
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats

#: Parts into which visits or units are dealt, and the fewest units that can be held out in turn.
FOLDS, MIN_HELD_OUT_UNITS = 6, 3
#: Covariates that change slowly and steadily from visit to visit.
SLOW_COVARIATES = frozenset({"time_s", "temperature_degC", "temperature_rate", "since_power_s", "since_clamp_s"})
#: Weight of a held-out row in the fit. Where a bias walks, only the first visits tell the offset: without them it
#: would be rounding magnified. So what the rest cannot say is taken from them, on both sides of the comparison.
HELD_WEIGHT = 1e-3
#: So few visits, each counted by how far it moves, do not tell how much it scatters what one of them gains: of four
#: that gain the same the sum is never more than twice its standard error. Three or less confirm nothing, since the sum
#: of three is never twice their length: there are as few positions that are not needed to tell the calibration.
FEW_VISITS, TOO_FEW_VISITS = 12, 3
#: What moves a visit by so much, the square of it in units of its noise, is decided by that visit alone, and one that
#: it moves further confirms no more than it.
DECISIVE = 1000.0
#: Pairs into which one visit's data are split by noise.
FISSIONS = 4


@dataclass(frozen=True, slots=True)
class HeldOutGain:
    """held_out_by: visit, unit, time or sample; rms in the recipe's unit before and after; explained: share of what is
    above the floor; log_score in nats with its standard error."""

    held_out_by: str
    rms_before: float
    rms_after: float
    explained: float
    log_score: float
    std_error: float

    @property
    def accepted(self) -> bool:
        """Whether it gains more than chance would."""
        return self.log_score > 2 * self.std_error

    @property
    def chance(self) -> float:
        """Of any gain at all, by the score and its standard error."""
        return float(scipy.special.ndtr(self.log_score / self.std_error)) if self.std_error > 0 else 1.0


def held_out_gain(problem: ScoringProblem, i: int, floor: NoiseFloor) -> HeldOutGain:
    """The gain of an accepted cause beside all others."""
    return gain_together(problem, (i,), floor)


def gain_together(problem: ScoringProblem, which: Sequence[int], floor: NoiseFloor) -> HeldOutGain:
    """The gain of some accepted causes together beside all others, held out as the first of them requires."""
    items = [problem.accepted[i] for i in which]
    bare = problem
    for i in sorted(which, reverse=True):
        bare = bare.without(i)
    moving = any(item.candidate.moving for item in items) or bare.known.moving
    fresh = [replace(item, coefficient=np.zeros(item.coefficient.shape)) for item in items]
    by = _held_out_by(problem, items[0])
    test = _HeldOutTest(bare, bare.with_accepted([*bare.accepted, *fresh]), len(fresh), floor, moving=moving)
    score = np.zeros(problem.view.grid.slot.shape)
    squares, rows, moved = np.zeros(2), 0.0, np.zeros(score.shape)
    for held in folds(problem, by):
        both = test.split_by_noise(held) if by == "sample" else test.predicted(held)
        score += both[0].half_squares - both[1].half_squares
        squares += [p.raw for p in both]
        moved += test.by_visit((both[0].rows - both[1].rows) ** 2)
        rows += test.size(held)
    before, after = np.sqrt(squares / max(rows, 1.0))
    floor_rms = test.floor_rms(floor)
    above = before**2 - floor_rms**2
    explained = float(np.clip((before**2 - after**2) / above, 0.0, 1.0)) if above > 0 else 0.0
    visits = score[problem.view.grid.slot >= 0]
    total = float(visits.sum())
    few, confirming = _moved_visits(moved), _moved_visits(moved / (1 + moved / DECISIVE))
    if by == "sample" or (few < FEW_VISITS and confirming > TOO_FEW_VISITS):
        # Where few visits move, they do not tell how much it scatters what they gain; the standard deviation of their
        # log-likelihood ratio is the length of what moves in white data.
        std_error = np.sqrt(np.sum(moved))
    else:
        # About nothing, not about their mean, where there are so few: three that gain the same would have no scatter.
        std_error = np.sqrt(np.sum((visits - (visits.mean() if confirming > TOO_FEW_VISITS else 0.0)) ** 2))
    return HeldOutGain(by, float(before), float(after), explained, total, float(std_error))


def _moved_visits(moved: Floats) -> float:
    """How many visits move, each counted by how far it does: (Σ s)² / Σ s² of their squares s."""
    return float(np.sum(moved)) ** 2 / max(float(np.sum(moved**2)), 1e-300)


def _held_out_by(problem: ScoringProblem, item: AcceptedCause) -> str:
    """What is held out for a cause."""
    of = item.candidate.of
    if of == "visit":
        return "sample"
    effect = item.candidate.effect
    if effect is not None and SLOW_COVARIATES & set(effect.needs) and problem.view.grid.slot.shape[2] >= 2 * FOLDS:
        # Neighbours in time are alike: what is held out is a stretch of time, which must be reached from outside.
        return "time"
    if of in PER_UNIT_LEVELS or problem.view.grid.units < MIN_HELD_OUT_UNITS:
        return "visit"
    # A group of one unit could not be predicted from the others.
    unit = problem.view.scene.visits.unit.code
    shared = all(len(np.unique(unit[item.candidate.code == g])) > 1 for g in np.flatnonzero(item.hit))
    return "unit" if shared else "visit"


def folds(problem: ScoringProblem, by: str) -> Iterator[Floats]:
    """Which visits (U, R, V) are held out, 1, in turn."""
    slot = problem.view.grid.slot
    U, R, V = slot.shape
    if by == "unit":
        part = np.broadcast_to(np.arange(U)[:, None, None] % max(MIN_HELD_OUT_UNITS, min(U, FOLDS)), slot.shape)
    elif by == "time":
        part = np.broadcast_to(np.arange(V) * FOLDS // V, slot.shape)
    elif by == "visit":
        # Dealt so that no part holds the same places of all runs.
        part = np.broadcast_to(
            (np.arange(V) + 2 * np.arange(R)[:, None] + np.arange(U)[:, None, None]) % FOLDS, slot.shape
        )
    else:
        part = np.zeros(slot.shape)
    for fold in range(int(part.max()) + 1):
        yield ((part == fold) & (slot >= 0)).astype(float)


class _Prediction(NamedTuple):
    """half_squares (U, R, V) of the held-out visits' white rows; these rows (U, M); raw: sum of squares of readings."""

    half_squares: Floats
    rows: Floats
    raw: float


class _HeldOutTest:
    """A comparison, ready to be fitted to a part of the data and judged by the rest: bare without the causes under
    test, whole with them, so many, as the last that it accepts."""

    def __init__(
        self, bare: ScoringProblem, whole: ScoringProblem, tested: int, floor: NoiseFloor, *, moving: bool
    ) -> None:
        self.bare = bare
        self.readings, _ = bare.readings(moving=moving)
        covariance = bare.structure.covariance(floor.variances)
        self.white, self.whole = (whitened(covariance, side.known, self.readings) for side in (bare, whole))
        self._columns = _tested_columns(whole, tested, self.white.own.shape[-1])
        self._known = bare.known, whole.known
        self._all = solve(self.white)
        r = bare.view.reduced
        self.count = bare.view.grid.spread(
            np.broadcast_to(r.count.sum(1)[:, None, None], (len(r.mean), bare.view.grid.k, 1))
        )

    def predicted(self, held: Floats) -> tuple["_Prediction", "_Prediction"]:
        """What is left of the held-out visits, without the causes and with them."""
        rows = self._rows(held, self.white)
        kept = [solve(white, 1 - (1 - HELD_WEIGHT) * self._rows(held, white)) for white in (self.white, self.whole)]
        rest = [self._measured(w.residual(s)) for w, s in zip((self.white, self.whole), kept, strict=True)]
        own, shared = self._columns
        told = replace(kept[1], own=np.where(own, kept[1].own, 0.0), shared=np.where(shared, kept[1].shared, 0.0))
        data = self.white.data.copy()
        measured = self._measured(data)
        measured -= self._measured(self.whole.data - self.whole.residual(told))
        without = replace(self.white, data=data)
        solved = solve(without)
        fits = self.white.residual(self._all), without.residual(solved)
        made = []
        for left, fitted, others, cause in zip(rest, fits, (self._all, solved), (None, told), strict=True):
            e = self._measured(fitted) * self._measured(rows)
            # What of the held-out rows' squares a fit to all of them hides, each fold as a whole.
            wide = float(np.sum(left * e)) / max(float(np.sum(e**2)), 1e-300)
            white = e * np.sqrt(max(wide, 0.0))
            terms = [(self._known[0], others)] + ([] if cause is None else [(self._known[1], cause)])
            raw = self._raw(terms, held) * max(wide, 0.0)
            made.append(_Prediction(0.5 * self.by_visit(white**2), white, raw))
        return made[0], made[1]

    def split_by_noise(self, held: Floats) -> tuple["_Prediction", "_Prediction"]:
        """The same for one visit. Adding and subtracting noise makes two independent data sets of twice the variance;
        one is fitted and the other judged, and vice versa (data fission, Leiner et al. 2023). Several such pairs are
        averaged, so that hardly anything depends on the noise added."""
        made = []
        for white, known in zip((self.white, self.whole), self._known, strict=True):
            rng = np.random.default_rng(0)
            squares: Floats = np.zeros(self.bare.view.grid.slot.shape)
            for _ in range(FISSIONS):
                noise = rng.standard_normal(white.data.shape)
                ends = [replace(white, data=white.data + s * noise) for s in (1, -1)]
                for fitted, judged in (ends, ends[::-1]):
                    squares = squares + 0.25 * self.by_visit(judged.residual(solve(fitted)) ** 2) / FISSIONS
            solved = solve(white)
            raw = self._raw([(known, solved)], held)
            made.append(_Prediction(squares, self._measured(white.residual(solved)), raw))
        return made[0], made[1]

    def _measured(self, rows: Floats) -> Floats:
        """White rows (U, M) without those of the priors."""
        return rows[:, : self.white.visits + self.white.dwell]

    def _rows(self, visits: Floats, white: WhiteRows) -> Floats:
        """A value of each visit (U, R, V) for each of the white rows (U, M), 0 for those of the priors."""
        U = len(visits)
        flat = visits.reshape(U, -1)
        visit = np.repeat(flat, white.visits // flat.shape[1], axis=1)
        dwell = np.repeat(flat, white.dwell // flat.shape[1], axis=1)
        rest = np.zeros((U, white.data.shape[1] - visit.shape[1] - dwell.shape[1]))
        return np.concatenate([visit, dwell, rest], axis=1)

    def by_visit(self, rows: Floats) -> Floats:
        """White rows (U, M), with those of the priors or without, summed up by visit (U, R, V)."""
        U, R, V = self.bare.view.grid.slot.shape
        a, b = self.white.visits, self.white.visits + self.white.dwell
        parts = (rows[:, :a], rows[:, a:b])
        return np.asarray(sum(p.reshape(U, R, V, -1).sum(3) for p in parts if p.shape[1]))

    def _raw(self, terms: Sequence[tuple[NuisanceColumns, NuisanceSolution]], held: Floats) -> float:
        """Sum of squares of the held-out readings without such terms: of means, or of all samples' blocks."""
        U, R, V = held.shape
        visit, dwell = self.readings.visit[..., 0], self.readings.dwell
        rest = None if dwell is None else dwell[..., 0]
        for known, solved in terms:
            visit = visit - np.einsum("urmp,up->urm", known.own.visit, solved.own) - known.shared.visit @ solved.shared
            for rows, c in ((known.own.dwell, solved.own[:, :, None]), (known.shared.dwell, solved.shared[:, None])):
                rest = rest if rest is None or rows is None else rest - (rows @ c)[..., 0]
        squares = (visit**2 * (1.0 if rest is None else self.count[..., 0])).reshape(U, R, V, -1).sum(3)
        if rest is not None:
            squares = squares + (rest**2).reshape(U, R, V, -1).sum(3) * self.bare.view.sigma**2
        return float(np.sum(squares * held))

    def size(self, held: Floats) -> float:
        """How many readings the sum of squares is of."""
        if self.readings.dwell is None:
            return float(held.sum()) * self.bare.view.grid.k
        U, R, V = held.shape
        return float(np.sum(self.count.reshape(U, R, V, -1).sum(3) * held))

    def floor_rms(self, floor: NoiseFloor) -> float:
        """Rms of what the floor alone would leave."""
        diagonal = self.bare.structure.visit_variance(floor.variances)[self.bare.structure.member]
        live = self.count[..., 0] > 0
        if self.readings.dwell is None:
            return float(np.sqrt(diagonal[live].mean()))
        inside = 3 * np.count_nonzero(self.readings.dwell) / 3
        total = float(np.sum(diagonal * self.count[..., 0])) + inside * self.bare.view.sigma**2
        return float(np.sqrt(total / self.count.sum()))


def _tested_columns(whole: ScoringProblem, tested: int, others: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which own (p) and shared (c) columns are those of the causes that were accepted last, so many, and of the errors
    of their covariates, which stand at the end: all but the others' own columns."""
    own = np.zeros(whole.known.own.visit.shape[-1], bool)
    shared = np.zeros(whole.known.shared.visit.shape[-1], bool)
    for place in whole.places[len(whole.places) - tested :]:
        (own if place.own else shared)[place.column[place.column >= 0]] = True
    blurs = len(own) - others - int(own.sum())
    own[len(own) - blurs :] = True
    return own, shared
