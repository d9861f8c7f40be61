"""The whole bank under one noise floor."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import FEW_UNITS, Bank, Candidate
from station.diagnosis.candidates.nuisance import AcceptedCause, CoefficientIndex, accept_candidate, nuisance_of
from station.diagnosis.candidates.projected_bank import CandidateFit, ProjectedBank, project_bank
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear import noise_floor
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.grid import RowLayout
from station.diagnosis.linear.noise_floor import FloorStructure, NoiseFloor
from station.diagnosis.linear.parted_space import PartedSpace
from station.diagnosis.linear.projection import DataColumns, NuisanceColumns, ResidualSpace, residual_space
from station.domain.core.types import Array, Floats

#: A variance that is this share of its bound has reached it.
AT_BOUND_SHARE = 0.99


@dataclass(frozen=True, slots=True, eq=False)
class ScoringSetting:
    """What a cause is judged in: how visits become rows, the floor's structure, what is known, and the readings."""

    layout: RowLayout
    structure: FloorStructure
    known: NuisanceColumns
    data: DataColumns

    def readings(self, *, moving: bool) -> tuple[DataColumns, int]:
        """What a cause that moves within a visit, or not, is judged by: means with contrasts, or means alone; and
        how many numbers that is."""
        count = self.layout.grid.data
        if not (moving or self.known.moving) or self.data.dwell is None:
            return DataColumns(self.data.visit), count
        return self.data, count + int(np.count_nonzero(self.data.dwell))

    def space(self, at: NoiseFloor, *, moving: bool) -> ResidualSpace:
        """The readings under a floor."""
        return residual_space(self.structure.covariance(at.variances), self.known, *self.readings(moving=moving))

    def scored_space(self, at: NoiseFloor, *, moving: bool) -> ResidualSpace | PartedSpace:
        """The same to score a bank in; of more than few units not held, where it need not be."""
        if self.layout.grid.units <= FEW_UNITS or self.known.shared.visit.shape[-1]:
            return self.space(at, moving=moving)
        return PartedSpace(self.structure.covariance(at.variances), self.known, *self.readings(moving=moving))

    def of_units(self, chosen: Array) -> "tuple[ScoringSetting, Array]":
        """The setting of the chosen units alone, and which visits (v) are theirs."""
        layout, visits = self.layout.of_units(chosen)
        structure = replace(self.structure, member=self.structure.member[chosen])
        return ScoringSetting(layout, structure, self.known.of_units(chosen), self.data.of_units(chosen)), visits


@dataclass(frozen=True, eq=False)
class ScoringProblem:
    """View, the setting it makes, what is known and where, and the upper bounds (3) of the floor's variances.

    near: a floor that is near the best one, where the search for it begins.
    """

    view: ResidualView
    setting: ScoringSetting
    accepted: tuple[AcceptedCause, ...]
    places: tuple[CoefficientIndex, ...]
    matrix: bool
    upper: Floats
    near: NoiseFloor | None = None

    @property
    def structure(self) -> FloorStructure:
        """The floor's structure."""
        return self.setting.structure

    @property
    def known(self) -> NuisanceColumns:
        """What is known."""
        return self.setting.known

    def readings(self, *, moving: bool) -> tuple[DataColumns, int]:
        """See `Setting`."""
        return self.setting.readings(moving=moving)

    def fit(self, start: NoiseFloor | None = None, upper: Floats | None = None) -> noise_floor.FittedFloor:
        """The floor that fits best."""
        return self._best if start is None and upper is None else self._fitted(start, upper)

    @cached_property
    def _best(self) -> noise_floor.FittedFloor:
        """The floor that fits best from where the search for it begins: every step that meets a problem asks for it."""
        return self._fitted(None, None)

    @cached_property
    def grown_floors(self) -> "dict[int, GrownFloor]":
        """Of each variance of the floor, by its place, that has reached its bound: what letting it free does."""
        best, grown = self.fit(), dict[int, GrownFloor]()
        for i in np.flatnonzero(best.floor.variances >= AT_BOUND_SHARE * self.upper).tolist():
            upper = self.upper.copy()
            upper[i] = np.inf
            free = self.fit(best.floor, upper)
            grown[i] = GrownFloor(free.space.profile - best.space.profile, free.floor)
        return grown

    def _fitted(self, start: NoiseFloor | None, upper: Floats | None) -> noise_floor.FittedFloor:
        rows, count = self.readings(moving=False)
        upper = self.upper if upper is None else upper
        return noise_floor.fit(
            self.structure, self.known, rows, count, upper, start or self.near, self.view.min_variance
        )

    def space(self, at: NoiseFloor, *, moving: bool) -> ResidualSpace:
        """The readings under a floor."""
        return self.setting.space(at, moving=moving)

    def with_accepted(self, items: Sequence[AcceptedCause]) -> "ScoringProblem":
        """The same with other causes accepted, their columns as they are."""
        known, places = nuisance_of(self.view, tuple(items), self.matrix)
        return replace(self, accepted=tuple(items), places=places, setting=replace(self.setting, known=known))

    def of_units(self, chosen: Array, near: NoiseFloor) -> "ScoringProblem":
        """The problem of some units (in order) alone, before any cause is known. near: a floor near theirs."""
        view = self.view.of_units(chosen)
        known, places = nuisance_of(view, (), self.matrix)
        setting = replace(self.setting.of_units(chosen)[0], known=known)
        return replace(self, view=view, setting=setting, places=places, near=near)

    def without(self, i: int, groups: Sequence[int] | None = None) -> "ScoringProblem":
        """The same with one accepted cause, or some groups of it, neither known nor at work: the whole signal of these
        is in the readings."""
        gone = self.accepted[i]
        left = [] if groups is None else [item for item in (gone.without(groups),) if item.hit.any()]
        active = gone.taken_from(self.view.active)
        for item in left:
            active = item.added_to(active)
        view = replace(self.view, active=active)
        bare = replace(self, view=view, setting=replace(self.setting, data=view.readings()))
        return bare.with_accepted([*self.accepted[:i], *left, *self.accepted[i + 1 :]])


class GrownFloor(NamedTuple):
    """The floor that fits best with one variance free, and the restricted log-likelihood that this gains, nats."""

    gain: float
    floor: NoiseFloor


class Scores(NamedTuple):
    """Log evidence (n, candidates) of data sets under one floor, and log-likelihood (n, spaces) without any."""

    evidence: Floats
    fits: Floats


class AmplitudeLikelihood(NamedTuple):
    """Standard deviations (ρ) that a candidate's coefficients may have, the log-likelihood (ρ) of each, and in how many
    directions of the readings they show."""

    spread: Floats
    likelihood: Floats
    directions: int


@dataclass(frozen=True, slots=True, eq=False)
class ScoredBank:
    """Candidates under one floor: still ones see the visits' means, moving ones the contrasts too."""

    floor: NoiseFloor
    projected: tuple[ProjectedBank, ...]

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All of them, in the order of the evidence."""
        return tuple(c for s in self.projected for c in s.bank.candidates)

    @property
    def space_index(self) -> NDArray[np.intp]:
        """Which space each candidate is seen in."""
        return np.repeat(np.arange(len(self.projected)), [len(s.found) for s in self.projected])

    def only(self, places: Sequence[int]) -> "ScoredBank":
        """The same with the candidates at some places."""
        chosen = np.zeros(len(self.candidates), bool)
        chosen[list(places)] = True
        ends = np.cumsum([len(s.found) for s in self.projected])[:-1]
        return ScoredBank(
            self.floor, tuple(s.only(list(c)) for s, c in zip(self.projected, np.split(chosen, ends), strict=True))
        )

    def readings(self) -> Scores:
        """The readings' scores."""
        evidence = np.concatenate([s.evidence for s in self.projected])
        return Scores(evidence[None], np.stack([s.readings.fits for s in self.projected], axis=1))

    def accept(self, candidate: Candidate, view: ResidualView, hit: NDArray[np.bool_] | None = None) -> AcceptedCause:
        """The candidate with its likeliest amplitude, and the groups that it likely hits, where they are not told."""
        hit = self.hit(candidate, view) if hit is None else hit
        found = self.amplitudes(candidate, view, hit)
        spread = float(found.spread[int(found.likelihood.argmax())])
        return accept_candidate(candidate.plain or candidate, hit, spread)

    def amplitudes(self, candidate: Candidate, view: ResidualView, hit: NDArray[np.bool_]) -> AmplitudeLikelihood:
        """How likely each amplitude of a candidate is in the groups that it hits."""
        projected, found = self._of(candidate)
        likelihood, taken, seen = projected.likelihood(found), found.spectrum.logdet, found.spectrum.m
        if found.spectrum.pattern == "scan":
            unit, place = candidate.where(view.layout)
            likelihood, taken = (x[unit[hit], place[hit]].sum(0) for x in (likelihood, taken))
            seen = seen[unit[hit], place[hit]]
        dof = projected.readings.size.dof
        # The scale of the floor that goes with an amplitude: L = −½ n·log(scale · n / rest) − ½ log|1 + ρ m|.
        scale = float(projected.readings.rest[0]) / dof * np.exp(-2 * (likelihood + 0.5 * taken) / dof)
        mean = float(found.spectrum.mean)
        # Of what the readings do not show every amplitude is as likely.
        spread = np.sqrt(found.spectrum.ratios / mean * scale) if mean > 0 else np.full(len(likelihood), np.inf)
        return AmplitudeLikelihood(np.minimum(spread, candidate.most), likelihood, int(np.count_nonzero(seen)))

    def shows(self, candidate: Candidate) -> bool:
        """Whether anything of a candidate is left beside all that is known."""
        return bool(self._of(candidate)[1].spectrum.mean > 0)

    def hit(self, candidate: Candidate, view: ResidualView, alone: bool = False) -> NDArray[np.bool_]:
        """The groups that a candidate likely hits, or the likeliest one `alone`; all where it is not a scan."""
        projected, found = self._of(candidate)
        if found.spectrum.pattern != "scan":
            return np.ones(len(candidate.names), bool)
        odds = log_mean_exp(projected.likelihood(found))[candidate.where(view.layout)]
        return np.asarray((odds == odds.max()) | (not alone) & (odds > np.log(len(odds))))

    def _of(self, candidate: Candidate) -> tuple[ProjectedBank, CandidateFit]:
        """What was found of a candidate, and where."""
        return next(
            (s, f) for s in self.projected for c, f in zip(s.bank.candidates, s.found, strict=True) if c is candidate
        )


def score_bank(problem: ScoringProblem, banks: Sequence[Bank], at: NoiseFloor, *, keep: bool = False) -> ScoredBank:
    """The bank under a floor; keep: with what tells it in larger noise, too."""
    projected = list[ProjectedBank]()
    for bank in banks:
        space = problem.setting.scored_space(at, moving=bank.moving)
        projected += project_bank(bank, problem.setting.layout, [space], keep=keep)
    return ScoredBank(at, tuple(projected))


def score_in_noise(problem: ScoringProblem, first: ScoredBank, at: NoiseFloor) -> ScoredBank:
    """A bank that was scored under one floor under a multiple of it. Of what stands still in a visit that is known
    already, where nothing that is known has a prior."""
    known, factor = problem.known, at.noise / first.floor.noise
    seen = [None if s.bank.moving or known.moving or known.prior_count else s.in_noise(factor) for s in first.projected]
    pairs = zip(first.projected, seen, strict=True)
    return ScoredBank(at, tuple(found or score_bank(problem, [s.bank], at).projected[0] for s, found in pairs))


def score_under_floors(
    setting: ScoringSetting, banks: Sequence[Bank], floors: Sequence[NoiseFloor], *, copies: int = 1, axes: bool = False
) -> tuple[ScoredBank, ...]:
    """The bank under each of some floors; its columns are laid out once."""
    projected, spaces = [], list[ResidualSpace | PartedSpace]()
    for bank in banks:
        if axes or copies > 1:
            spaces = [setting.space(at, moving=bank.moving).times(copies) for at in floors]
        else:
            spaces = [setting.scored_space(at, moving=bank.moving) for at in floors]
        projected.append(project_bank(bank, setting.layout, spaces, axes=axes))
    return tuple(ScoredBank(at, each) for at, each in zip(floors, zip(*projected, strict=True), strict=True))


def evidence_by_cause(candidates: Sequence[Candidate], evidence: Floats) -> dict[str, Floats]:
    """Log evidence (n) of each cause: the mean over its candidates' (n, candidates), and over those that they stand
    for, which say next to nothing beside them."""
    rows: dict[str, list[int]] = {}
    for i, c in enumerate(candidates):
        rows.setdefault(c.name, []).append(i)
    if not rows:
        return {}
    counts = np.array([len(at) for at in rows.values()])
    every = np.array([sum(candidates[i].stands_for for i in at) for at in rows.values()])
    sorted_by_cause = evidence[:, np.concatenate(list(rows.values()))]
    starts = np.cumsum(counts) - counts
    top = np.maximum.reduceat(sorted_by_cause, starts, axis=1)
    share = np.exp(sorted_by_cause - np.repeat(top, counts, axis=1))
    found = top + np.log(np.add.reduceat(share, starts, axis=1) / every)
    return dict(zip(rows, found.T, strict=True))
