"""One term judged exactly in a space, with its constants fitted."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS, Candidate
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.nuisance import AcceptedCause, accept_candidate
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.discovery.constant_scale import ConstantScale
from station.diagnosis.discovery.evidence import log_evidence
from station.diagnosis.discovery.price import CONSTANT_NATS, price
from station.diagnosis.discovery.scan import VISIBLE_SHARE, ScannedUnits, scanned_units
from station.diagnosis.linear.eigen import eigenvectors
from station.diagnosis.linear.evidence import Pattern
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats
from station.model.effect import Effect
from station.model.formula.term import Term
from station.model.formula.term_effect import effect_of

#: The name of a term that has none yet.
UNNAMED = "hypothesis"
#: The prior of an accepted term's coefficients beside their size.
WIDE = 3.0
#: Columns shorter than this share of the longest are rounding.
ROUNDING = 1e-9
#: Stands for an evidence of minus infinity, with which an optimiser cannot reckon.
OUT_OF_QUESTION = 1e12
#: Tops of a coarse grid that are refined, and how far below the highest.
MOST_TOPS, NEAR_TOP_SHARE = 2, 0.15
#: How finely a constant is found, as a share of the steps of the coarse grid, and the rounds where a term has two.
FINENESS, ROUNDS = 0.01, 2
#: By how much the evidence falls a standard deviation beside its top, nats, and how that place is bracketed.
HALF_NAT, DOUBLINGS, BISECTIONS = 0.5, 24, 6


class TermSpace(NamedTuple):
    """Where a term is judged: a view, units of it, and their space."""

    view: ResidualView
    units: ScannedUnits
    space: ResidualSpace


class TermSpaces:
    """A problem's spaces under one floor, each made when it is needed; of all units, or of so many."""

    def __init__(self, problem: ScoringProblem, floor: NoiseFloor, most: int | None = None) -> None:
        self._view, self._floor = problem.view, floor
        self._units = scanned_units(problem, problem.view.grid.units if most is None else most)
        self._made: dict[bool, TermSpace] = {}

    def of(self, term: Term) -> TermSpace:
        """Where a term is judged."""
        moving = "since_arrival_s" in term.needs
        if moving not in self._made:
            space = self._units.setting.space(self._floor, moving=moving)
            self._made[moving] = TermSpace(self._view, self._units, space)
        return self._made[moving]


@dataclass(frozen=True, slots=True, eq=False)
class TermFit:
    """A term in a space: share of the sum of squares that it takes up, coefficients (K) in all, their rms, log
    evidence; signal (U, M) is what it leaves in the white rows at its best; room: log of the share that the data leave
    of what its constants might have been."""

    term: Term
    share: float
    coefficients: int
    rms: float
    evidence: float
    signal: Floats
    room: float = 0.0

    @property
    def score(self) -> float:
        """Evidence less the price of the formula, nats: what chance is drawn for."""
        return self.evidence - price(self.term)

    @property
    def odds(self) -> float:
        """The same with the constants integrated instead of at their best for a price each: by this one family of terms
        is likelier than another. A frequency that fits in a hundredth of its range is a hundred times less likely than
        its best suggests; a zero that may be anywhere costs nothing."""
        return self.score + CONSTANT_NATS * len(self.term.fields) + self.room

    @property
    def d(self) -> float:
        """Length of its signal."""
        return float(np.sqrt(max(float(np.sum(self.signal**2)) - self.coefficients, 0.0)))


def candidate_of(term: Term, view: ResidualView, rms: float = 0.0, name: str = UNNAMED) -> Candidate:
    """A term as a candidate of the diagnosis, with its columns in a view."""
    effect = effect_of(term, name, rms)
    visit, dwell = view.signature(effect, term.of) if _by_simulation(term) else (_still_columns(term, view), None)
    return _candidate(term, effect, view, visit, dwell, name)


def probe_of(term: Term, view: ResidualView) -> Candidate:
    """The same for its columns alone, without an effect where none is needed to make them: each is a class."""
    if _by_simulation(term):
        return candidate_of(term, view)
    return _candidate(term, None, view, _still_columns(term, view), None, UNNAMED)


def _candidate(
    term: Term, effect: Effect | None, view: ResidualView, visit: Floats, dwell: Floats | None, name: str
) -> Candidate:
    code, names = view.scene.group(term.of)
    pattern: Pattern = "own" if term.of in PER_UNIT_LEVELS else "shared"
    return Candidate(name, effect, term.of, pattern, code, names, CauseColumns.of(visit, dwell))


def _by_simulation(term: Term) -> bool:
    return term.is_turn or "since_arrival_s" in term.needs


def _still_columns(term: Term, view: ResidualView) -> Floats:
    """Columns (v, 3, K) of a term that stands still during a visit."""
    signal = view.signal
    visit = np.zeros((len(view.reduced.mean), 3, len(term.columns)))
    for at, column in enumerate(term.columns):
        visit[:, column.i, at] = term.column(column, signal)
    return visit


def fit_term(term: Term, at: TermSpace) -> TermFit:
    """A term in a space."""
    return _fit(term, probe_of(term, at.view), at)


def fit_in_place(term: Term, columns: Floats, at: TermSpace) -> TermFit:
    """Other columns (v, 3, K) in a space, shared as those of a term are."""
    return _fit(term, _candidate(term, None, at.view, columns, None, UNNAMED), at)


def _fit(term: Term, candidate: Candidate, at: TermSpace) -> TermFit:
    space = at.space
    rows = candidate.select_visits(at.units.visits).rows(at.units.setting.layout)
    U, R, m, _ = rows.visit.shape
    white = space.covariance.whiten(rows, space.dwell, space.basis.shape[1] - R * m - space.dwell)
    length = np.einsum("umk,umk->uk", white, white)
    white -= space.basis @ (space.basis.transpose(0, 2, 1) @ white)
    own = candidate.pattern == "own"
    columns = white if own else white.reshape(1, U * white.shape[1], -1)
    turn, rank = _orthonormal(columns, length, own=own)
    basis = columns @ turn
    before, after, signal = _remaining(basis.reshape(white.shape), space, own=own)
    along = basis.swapaxes(1, 2) @ signal.reshape(len(basis), -1, 1)
    share = max(0.0, 1 - after / before) if before > 0 else 0.0
    evidence = float(log_evidence(np.array(share), rank, space.dof)) if 0 < rank <= space.dof // 3 else -np.inf
    return TermFit(term, share, rank, rms_of(turn @ along), evidence, signal)


def rms_of(coefficients: Floats) -> float:
    """Their rms; of columns that nearly died away they are too large to be squared."""
    largest = float(np.abs(coefficients).max(initial=0.0))
    return largest * float(np.sqrt(np.mean((coefficients / largest) ** 2))) if largest > 0 else 0.0


def _orthonormal(columns: Floats, length: Floats, *, own: bool) -> tuple[Floats, int]:
    """What turns columns (U or 1, ·, K) to orthonormal bases, zeros for what is lost, and their rank in all."""
    normal = columns.swapaxes(1, 2) @ columns
    scale = length if own else length.sum(0, keepdims=True)
    # A turn that a pose cannot show leaves a column of rounding.
    live = scale > (ROUNDING**2) * scale.max(axis=1, keepdims=True)
    unit = np.where(live, 1 / np.sqrt(np.where(live, scale, 1.0)), 0.0)
    m, E = eigenvectors(normal * unit[:, :, None] * unit[:, None, :])
    visible = m > VISIBLE_SHARE
    turn = unit[:, :, None] * E * np.where(visible, 1 / np.sqrt(np.where(visible, m, 1.0)), 0.0)[:, None, :]
    return turn, int(np.count_nonzero(visible))


def _remaining(basis: Floats, space: ResidualSpace, *, own: bool) -> tuple[float, float, Floats]:
    """Sums of squares before and after, and what the basis takes up (U, M), with the shared known columns fitted."""
    before, shared = space.rest, space.shared_basis
    if not own:
        flat = basis.reshape(space.data.size, -1)
        known = shared.reshape(space.data.size, -1)
        flat = flat - known @ (known.T @ flat)
        flat = flat @ np.linalg.pinv(np.linalg.cholesky(flat.T @ flat + 1e-12 * np.eye(flat.shape[1])).T)
        taken = (flat @ (flat.T @ space.residual.ravel())).reshape(space.data.shape)
        return before, before - float(np.sum(taken**2)), taken
    left = space.data - _onto(basis, space.data)
    if not shared.shape[2]:
        return before, float(np.sum(left**2)), space.data - left
    known = shared - basis @ (basis.swapaxes(1, 2) @ shared)
    flat = known.reshape(space.data.size, -1)
    found = np.linalg.lstsq(flat, left.ravel(), rcond=None)[0]
    rest = left.ravel() - flat @ found
    return before, float(rest @ rest), space.residual - rest.reshape(space.data.shape)


def _onto(basis: Floats, data: Floats) -> Floats:
    return np.asarray((basis @ (basis.swapaxes(1, 2) @ data[..., None]))[..., 0])


def refine(term: Term, at: TermSpace) -> TermFit:
    """The term with its constants fitted one after the other, and how much of their prior range the data leave."""
    best = fit_term(term, at)
    fields = term.fields
    room = dict.fromkeys(fields, 0.0)
    for _ in range(ROUNDS if len(fields) > 1 else 1):
        for field in fields:
            best, room[field] = _refine_one(best, field, at)
    return replace(best, room=sum(room.values()))


def _refine_one(best: TermFit, field: str, where: TermSpace) -> tuple[TermFit, float]:
    """One constant where the evidence is largest, and its room."""
    tried = {best.term: best}

    def evidence(term: Term) -> float:
        tried[term] = found = tried.get(term) or fit_term(term, where)
        return found.evidence

    found = search_constant(best.term, field, where.view, evidence)
    return tried[found.term], found.room


class SearchedConstant(NamedTuple):
    """A term with one constant at its best, and what every value tried on its scale was worth."""

    term: Term
    scale: ConstantScale
    worth: Mapping[float, float]

    @property
    def room(self) -> float:
        """Log of the mean over the constant's range of a likelihood beside its best (trapezia between what was tried),
        where log-likelihoods are what it is worth."""
        x = np.sort(list(self.worth))
        nats = np.array([self.worth[at] for at in x])
        if not np.isfinite(nats.max()):
            return 0.0
        mean = float(np.trapezoid(np.exp(nats - nats.max()) * self.scale.density(x), x))
        return min(float(np.log(max(mean, 1e-300))), 0.0)


def search_constant(term: Term, field: str, view: ResidualView, worth: Callable[[Term], float]) -> SearchedConstant:
    """The term with one constant where it is worth most: by Brent's method between the neighbours of its best value on
    a coarse grid."""
    scale = ConstantScale.of(field, dict(term.constants)[field], view)
    tried = {scale.start: (worth(term), term)}

    def at(x: float) -> float:
        if x not in tried:
            moved = term.with_constants(**{field: scale.value(x)})
            tried[x] = worth(moved), moved
        return tried[x][0]

    for x in scale.around:
        at(x)
    for low, high in list(_tops(sorted(tried), at)):
        search_between(low, high, at)
    best = max(tried.values(), key=lambda pair: pair[0])[1]
    return SearchedConstant(best, scale, {x: value for x, (value, _) in tried.items()})


def search_between(low: float, high: float, at: Callable[[float], float]) -> None:
    """Brent's method: as near to the highest point of a function as a share of the interval."""
    scipy.optimize.minimize_scalar(
        lambda x: min(-at(float(x)), OUT_OF_QUESTION),
        bounds=(low, high),
        method="bounded",
        options={"xatol": FINENESS * (high - low)},
    )


def _tops(points: Sequence[float], at: Callable[[float], float]) -> Iterator[tuple[float, float]]:
    """The neighbours of the highest maxima of a function on a grid, if these are near the highest of all: a narrow
    maximum between two points may be higher than either."""
    ends = [-np.inf, *(at(x) for x in points), -np.inf]
    tops = [i for i in range(len(points)) if ends[i] <= ends[i + 1] >= ends[i + 2]]
    tops.sort(key=lambda i: -at(points[i]))
    for i in tops[:MOST_TOPS]:
        if at(points[i]) > (1 - NEAR_TOP_SHARE) * at(points[tops[0]]):
            yield points[max(i - 1, 0)], points[min(i + 1, len(points) - 1)]


def accepted(fit: TermFit, view: ResidualView, name: str) -> AcceptedCause:
    """The term in the model, its prior wide beside its size, so that hardly anything is shrunk."""
    candidate = candidate_of(fit.term, view, fit.rms, name)
    return accept_candidate(candidate, np.ones(len(candidate.names), bool), WIDE * max(fit.rms, 1e-300))


def with_levels(fit: TermFit, at: TermSpace, levels: tuple[str, ...]) -> TermFit:
    """The fit at the level of sharing that pays most."""
    tried = [replace(fit_term(replace(fit.term, of=of), at), room=fit.room) for of in levels if of != fit.term.of]
    return max((fit, *tried), key=lambda f: f.score)


def constant_stds(fit: TermFit, at: TermSpace) -> dict[str, float]:
    """Standard deviation of each constant, by how the evidence falls off about it."""
    return {field: _std_of(fit, field, value, at) for field, value in fit.term.constants}


def _std_of(fit: TermFit, field: str, value: float, at: TermSpace) -> float:
    """The rms of how far one may go to either side until the evidence has fallen by half a nat; of one side alone,
    where the other never ends."""
    best, first = fit_term(fit.term, at).evidence, 1e-3 * max(abs(value), 1e-3)

    def side(sign: int) -> float | None:
        return _half_nat(lambda x: best - _evidence_at(fit.term, field, value + sign * x, at), first)

    sides = side(-1), side(1)
    told = [x for x in sides if x is not None]
    return float(np.sqrt(np.mean(np.square(told)))) if told else first * 2.0**DOUBLINGS


def _half_nat(fallen: Callable[[float], float], step: float) -> float | None:
    """How far something falls by a half, None where it never does: by a parabola about a smooth top, by bisection where
    it stands level up to an edge, as the time of a jump does between two visits."""
    steps = step * 2.0 ** np.arange(DOUBLINGS)
    far = next((float(x) for x in steps if fallen(float(x)) >= HALF_NAT / 2), None)
    if far is None:
        return None
    near = far / 2
    for _ in range(BISECTIONS):
        if fallen(far) <= 2 * HALF_NAT:
            return far * float(np.sqrt(HALF_NAT / fallen(far)))
        middle = (near + far) / 2
        near, far = (near, middle) if fallen(middle) >= HALF_NAT / 2 else (middle, far)
    return far


def _evidence_at(term: Term, field: str, value: float, at: TermSpace) -> float:
    return fit_term(term.with_constants(**{field: float(np.clip(value, *term.range_of(field)))}), at).evidence
