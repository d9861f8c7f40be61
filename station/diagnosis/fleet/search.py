"""Who shares a cause: a greedy search over the groups of a fleet, with everything found so far fitted together.

Model: whitened z = μ + Σ columns · sizes of the causes at work in the unit's groups + noise of variance one. Each round
tests every cause at every group of its levels by the score of the residual, over all time and over each stretch of it,
takes the one that chance explains least, finds the units in which it is at work, and fits all sizes and μ anew. Units
of one load are correlated, so chance exceeds what the noise says: the median of all tests says by how much.

Half of the chance of a finding in a fleet that shares nothing is spent on causes that were always there, a quarter on
those that began and last, a quarter on those that are over. Each part is shared by all groups, causes and stretches
tried.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from station.diagnosis.fleet.candidate import SharedCandidate
from station.diagnosis.fleet.interval import GroupUnits, best_stretch
from station.diagnosis.fleet.moments import FleetCell, Moments
from station.diagnosis.fleet.noise import ResponseNoise
from station.diagnosis.fleet.response import SharedCause
from station.diagnosis.fleet.slices import TimeSlices
from station.diagnosis.fleet.stretch_search import FEWEST_UNITS, PartFound, StretchSearch
from station.domain.core.types import Floats

#: Chance of any finding in a fleet that shares nothing.
LEVEL = 0.01
MOST_FINDINGS = 24
#: Causes whose log likelihoods are this near cannot be told apart.
_NEAR_NATS = 3.0
#: By how much the median of normal numbers scatters more than their mean.
_MEDIAN_STD = float(np.sqrt(np.pi / 2))
#: Of the chance of a finding, what causes without a beginning may take.
_ALWAYS = 0.5
_FIELDS = {"station": ("station",), "nest": ("station", "nest"), "lot": ("lot",), "position": ("station",)}


@dataclass(frozen=True, slots=True, eq=False)
class SharedFinding:
    """A cause that a group shares. size: length of `vector` (a), in the cause's unit; units: how many; begin_ns,
    end_ns: of the first unit with it, and of the first without it again, None: always, still; nats: log likelihood
    gained; others: causes of the same group that cannot be told from it."""

    candidate: SharedCandidate
    vector: tuple[float, ...]
    std: tuple[float, ...]
    units: int
    begin_ns: int | None
    end_ns: int | None
    nats: float
    others: tuple[str, ...]

    @property
    def size(self) -> float:
        """Length of the vector."""
        return float(np.linalg.norm(self.vector))


#: The units of a candidate's group, given what to take off the units of each row (k, r) of the slices of time.
Timeline = Callable[[SharedCandidate, Floats], GroupUnits]
#: Sums (k, r) of what the units of each row are off by, given what to take off each of them (k, r).
Leftover = Callable[[Floats], Floats]


def search_shared(
    moments: Moments,
    slices: TimeSlices,
    causes: Sequence[SharedCause],
    noise: ResponseNoise,
    timeline: Timeline,
    leftover: Leftover,
) -> tuple[list[SharedFinding], float]:
    """Findings, the largest evidence first, and by how much chance was larger than the noise says."""
    candidates = list(_candidates(moments, causes, noise.whiten))
    fit, scans = _Fit(moments, slices), StretchSearch(candidates, slices, noise)
    dispersion = 1.0
    for _ in range(MOST_FINDINGS if candidates else 0):
        tests = [fit.test(candidate) for candidate in candidates]
        ratio = [test / chdtri(max(rank, 1), 0.5) for test, rank in tests if rank]
        dispersion = max(1.0, float(np.median(ratio)) if ratio else 1.0)
        always = np.array([noise.log_chance(test / dispersion, rank) if rank else 0.0 for test, rank in tests])
        price = np.log(len(candidates)) - np.log(_ALWAYS)
        best = int(np.argmin(always))
        part = scans.best(
            leftover(fit.known(plain=True)), fit.known_in_time(), [rank > 0 for _, rank in tests], dispersion
        )
        if min(always[best] + price, part.log_chance if part else 0.0) > np.log(LEVEL):
            break
        if part is None or always[best] + price <= part.log_chance:
            near = _near(candidates, tests, best, dispersion)
            fit.accept(candidates[best], tests[best][0] / dispersion / 2, near, timeline, dispersion)
        else:
            near = _near(candidates, part.tests, part.candidate, part.dispersion)
            nats = part.tests[part.candidate][0] / part.dispersion / 2
            fit.accept(candidates[part.candidate], nats, near, timeline, part.dispersion, part)
    return fit.findings(dispersion), dispersion


def _near(
    candidates: Sequence[SharedCandidate], tests: Sequence[tuple[float, int]], best: int, dispersion: float
) -> tuple[str, ...]:
    """Other causes of the same group that explain nearly as much."""
    own, (top, rank) = candidates[best], tests[best]
    found = []
    for candidate, (test, other_rank) in zip(candidates, tests, strict=True):
        same = (candidate.level, candidate.group) == (own.level, own.group) or (
            {candidate.level, own.level} <= {"station", "position"} and candidate.group == own.group
        )
        behind = (top - test) / dispersion / 2 - (rank - other_rank) / 2
        if same and candidate is not own and behind < _NEAR_NATS:
            found.append(f"{candidate.cause.effect} {candidate.cause.position}".strip())
    return tuple(dict.fromkeys(found))


def _candidates(moments: Moments, causes: Sequence[SharedCause], whiten: Floats) -> Iterator[SharedCandidate]:
    at = 0
    for cause in causes:
        columns = None if cause.columns is None else whiten @ cause.columns
        place = slice(at, at + cause.axes) if cause.columns is None else slice(0, 0)
        at += cause.axes if cause.columns is None else 0
        scores = moments.kz[:, place] if columns is None else moments.z @ columns
        for level in cause.levels:
            for group, members in _groups(moments, level):
                yield SharedCandidate(cause, level, group, members, members @ scores, columns, place)


def _groups(moments: Moments, level: str) -> Iterator[tuple[FleetCell, Floats]]:
    fields = _FIELDS[level]
    names = [
        FleetCell(**{f: getattr(cell, f) if f in fields else "" for f in ("station", "nest", "lot")})
        for cell in moments.cells
    ]
    for group in dict.fromkeys(names):
        members = np.array([name == group for name in names], float)
        here = float(members @ moments.units)
        # A group of all units has nothing to be compared with; one without a name is no group.
        if FEWEST_UNITS <= here < moments.units.sum() and all(getattr(group, f) for f in fields):
            yield group, members


@dataclass(frozen=True, slots=True, eq=False)
class _InTime:
    """How many units, since and until when; size (a): robust, None where it is not known unit by unit."""

    units: int
    begin_ns: int | None = None
    end_ns: int | None = None
    size: Floats | None = None


class _Fit:
    """Everything found so far, fitted together with the middle of all units (r)."""

    def __init__(self, moments: Moments, slices: TimeSlices) -> None:
        self._m, self._slices = moments, slices
        self._accepted: list[SharedCandidate] = []
        self._about: list[tuple[float, tuple[str, ...], _InTime]] = []
        self._middle = moments.z.sum(axis=0) / moments.units.sum()
        self._sizes: list[Floats] = []
        self._shares: list[Floats] = []
        self._inverse = np.zeros((0, 0))

    def test(self, candidate: SharedCandidate) -> tuple[float, int]:
        """Twice the log likelihood that the candidate would gain, and its rank."""
        if any(one.cause is candidate.cause and one.group == candidate.group for one in self._accepted):
            return 0.0, 0
        to_middle = self._to_middle(candidate)
        left = candidate.score - to_middle.T @ self._middle
        for one, size in zip(self._accepted, self._sizes, strict=True):
            left = left - self._between(candidate, one) @ size
        gram = self._between(candidate, candidate) - to_middle.T @ to_middle / self._m.units.sum()
        value, vector = np.linalg.eigh(gram)
        shown = value > 1e-6 * max(float(value[-1]), 1e-300)
        along = (vector.T @ left)[shown] / np.sqrt(value[shown])
        return float(along @ along), int(shown.sum())

    def accept(
        self,
        candidate: SharedCandidate,
        nats: float,
        near: tuple[str, ...],
        timeline: Timeline,
        dispersion: float,
        part: PartFound | None = None,
    ) -> None:
        """Takes the candidate, for the stretch of time in which it is at work; part: what is known of that."""
        known = self.known()
        known += self._others(candidate) if part is None else part.others[self._slices.at]
        candidate, when, share = self._in_time(candidate, timeline, dispersion, known, part)
        self._shares.append(share)
        self._accepted.append(candidate)
        self._about.append((nats, near, when))
        self._solve()

    def findings(self, dispersion: float) -> list[SharedFinding]:
        """With the sizes of the last fit."""
        out, at = [], len(self._middle)
        for one, fitted, (nats, near, when) in zip(self._accepted, self._sizes, self._about, strict=True):
            own = slice(at, at + len(fitted))
            at += len(fitted)
            std = np.sqrt(np.maximum(np.diagonal(self._inverse[own, own]), 0) * dispersion)
            size = fitted if when.size is None else when.size
            wide = 1.0 if when.size is None else _MEDIAN_STD
            vector, stds = tuple(map(float, size)), tuple(map(float, wide * std))
            out.append(SharedFinding(one, vector, stds, when.units, when.begin_ns, when.end_ns, nats, near))
        return sorted(out, key=lambda finding: -finding.nats)

    def _others(self, candidate: SharedCandidate) -> Floats:
        """Mean (r) of the units outside a group: that of all would hold the cause in part."""
        left, weight = self._m.z.copy(), 1 - candidate.members
        for one, size in zip(self._accepted, self._sizes, strict=True):
            if one.columns is not None:
                left -= np.outer(one.members * self._m.units, one.columns @ size)
        return np.asarray(weight @ left / (weight @ self._m.units))

    def known_in_time(self) -> Floats:
        """1 for each row (k) but those whose units are off by what goes with a covariate: what is left of them is not
        known unit by unit."""
        known = np.ones(len(self._slices.cell))
        for one in self._accepted:
            if one.columns is None:
                known[one.members[self._slices.cell] > 0] = 0.0
        return known

    def known(self, *, plain: bool = False) -> Floats:
        """What a unit of each row (k, r) is off by for what was found; plain: as it was measured, not winsorised."""
        known = np.zeros((len(self._slices.cell), len(self._middle)))
        for one, fitted, share, (_, _, when) in zip(
            self._accepted, self._sizes, self._shares, self._about, strict=True
        ):
            if one.columns is not None:
                size = when.size if plain and when.size is not None else fitted
                known += np.outer(share, one.columns @ size)
        return known

    def _in_time(
        self,
        candidate: SharedCandidate,
        timeline: Timeline,
        dispersion: float,
        known: Floats,
        part: PartFound | None,
    ) -> tuple[SharedCandidate, "_InTime", Floats]:
        """The candidate in its stretch, when that is, and in which share of the units of each row (k)."""
        share = candidate.members[self._slices.cell]
        if candidate.columns is None:
            return candidate, _InTime(int(candidate.members @ self._m.units)), share
        units = timeline(candidate, known)
        gram = candidate.columns.T @ candidate.columns
        start = None if part is None else part.units_among(units.began_ns, self._slices.edges_ns)
        found = best_stretch(units, gram, dispersion, start)
        # Units that a large cause draws far off are winsorised: their size is that of the middle one.
        size = np.linalg.pinv(gram) @ np.median(units.plain[found.first : found.last], axis=0)
        begin = int(units.began_ns[found.first]) if found.begun else None
        end = int(units.began_ns[found.last]) if found.ended else None
        when = _InTime(found.last - found.first, begin, end, size)
        if not (found.begun or found.ended):
            return candidate, when, share
        count = np.bincount(units.row[found.first : found.last], minlength=len(share)).astype(float)
        in_cells = np.bincount(self._slices.cell, count, len(self._m.cells))
        # What was taken off before the projection is put back: the score is of the responses themselves.
        score = units.projected[found.first : found.last].sum(axis=0) + candidate.columns.T @ (count @ known)
        inside = replace(candidate, members=in_cells / np.maximum(self._m.units, 1.0), score=score)
        return inside, when, count / self._slices.units

    def _to_middle(self, one: SharedCandidate) -> Floats:
        """Gram matrix (r, a) between the middle and a candidate."""
        if one.columns is None:
            return np.tensordot(one.members, self._m.cross[:, :, one.at], axes=1)
        return np.asarray(float(one.members @ self._m.units) * one.columns)

    def _between(self, one: SharedCandidate, two: SharedCandidate) -> Floats:
        """Gram matrix (a, b) of two candidates, over the units in which both are at work."""
        both = np.minimum(one.members, two.members)
        if one.columns is not None and two.columns is not None:
            return np.asarray(float(both @ self._m.units) * (one.columns.T @ two.columns))
        if one.columns is not None:
            return np.asarray(one.columns.T @ np.tensordot(both, self._m.cross[:, :, two.at], axes=1))
        if two.columns is not None:
            return self._between(two, one).T
        return np.asarray(np.tensordot(both, self._m.kk[:, one.at, two.at], axes=1))

    def _solve(self) -> None:
        r, total = len(self._middle), float(self._m.units.sum())
        edges = np.cumsum([r, *(len(one.score) for one in self._accepted)])
        A = np.zeros((edges[-1], edges[-1]))
        A[:r, :r] = np.eye(r) * total
        for i, one in enumerate(self._accepted):
            own = slice(edges[i], edges[i + 1])
            A[:r, own] = self._to_middle(one)
            A[own, :r] = A[:r, own].T
            for j, two in enumerate(self._accepted):
                A[own, edges[j] : edges[j + 1]] = self._between(one, two)
        b = np.concatenate([self._m.z.sum(axis=0), *(one.score for one in self._accepted)])
        self._inverse = np.linalg.pinv(A, hermitian=True, rcond=1e-10)
        found = self._inverse @ b
        self._middle = found[:r]
        self._sizes = [found[edges[i] : edges[i + 1]] for i in range(len(self._accepted))]
