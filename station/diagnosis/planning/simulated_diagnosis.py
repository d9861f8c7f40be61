"""The next diagnosis, simulated: in how many of drawn sets of readings the right cause is left alone.

A set holds the readings so far and those that the planned runs may bring where one of the tied causes is true. It is
judged as a diagnosis judges it: by the evidence of the tied causes and of the kernels over all shapes, amplitudes and
walks; by the causes that together hold 95 % of the probability; and by d·√κ of what the leader leaves.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.bank import FLOOR_CAUSES, Candidate, build_bank
from station.diagnosis.candidates.free_visits import says_nothing
from station.diagnosis.candidates.kernels import KERNEL_NAMES, kernel_candidates
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.planning.plan import PlannedCampaign
from station.diagnosis.search.alarm import NullDistribution
from station.diagnosis.search.distinguishability import (
    SEPARATION_95,
    SEPARATION_99,
    SignatureAxes,
    has_covariate_error,
    nearer_by_error,
    signature_axes,
)
from station.diagnosis.search.finding import is_free_in_each_run, is_unknown
from station.diagnosis.search.null_noise import NullNoise
from station.diagnosis.search.null_simulation import SinglePrecisionBank
from station.diagnosis.search.rank import FLOOR_VARIANCES, OCCAM_NATS
from station.diagnosis.search.scoring import Scores, ScoringProblem, evidence_by_cause, score_under_floors
from station.diagnosis.search.walk_marginal import replicate_units, slow_candidates
from station.domain.core.types import Array, Floats

#: Beyond its bound a variance of the floor is tried at so many times its standard deviation.
FREE_SPREADS = (1.5, 2.5, 5.0, 10.0, 20.0)
#: Causes that together hold this share of the probability stay.
CREDIBLE = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class JudgedSets:
    """Sets (n) under one problem: evidence of each candidate (n, candidates), of each cause and kernel by name (n), and
    the white readings (n, U, M) of the space in which causes are told apart."""

    candidates: Floats
    evidence: dict[str, Floats]
    white: Floats

    def of_rows(self, rows: slice | Array) -> "JudgedSets":
        """Some of the sets."""
        return JudgedSets(self.candidates[rows], {n: e[rows] for n, e in self.evidence.items()}, self.white[rows])


class SimulatedDiagnosis:
    """The diagnosis of a longer campaign among some causes at their shapes, for any number of sets of its readings."""

    def __init__(
        self,
        plan: PlannedCampaign,
        shapes: Mapping[str, Sequence[Candidate]],
        null: NullDistribution | None = None,
    ) -> None:
        problem, floor, names = plan.problem, plan.floor, tuple(shapes)
        items = [*(c for one in shapes.values() for c in one), *kernel_candidates(problem.view)]
        items = [c for c in items if not says_nothing(c, problem.view)]
        banks = [build_bank(items, problem.view.layout, moving=moving) for moving in (False, True)]
        slow, units = slow_candidates(problem, banks, floor), np.arange(problem.view.grid.units)
        self._marginal = replicate_units(problem, banks, floor, slow, units, 1)
        self._stages = [[SinglePrecisionBank(s) for s in stage.projected] for stage in self._marginal.stages]
        self._free = {name: _free_spaces(problem, floor, name) for name in FLOOR_CAUSES if name in names}
        self._view, self._candidates = problem.view, self._marginal.candidates
        moving = any(c.moving for c in self._candidates if c.name in names)
        self._seen_by = self._stages[0][1 if moving else 0]
        self._axes: dict[int, SignatureAxes] = {}
        self._blurred: dict[int, tuple[Floats, Floats]] = {}
        self._null = null

    def judged(self, drawn: Sequence[NullNoise]) -> JudgedSets:
        """What a diagnosis makes of sets, one after the other."""
        scores = []
        for stage in self._stages:
            each = [light.scores(drawn, None) for light in stage]
            scores.append(Scores(np.concatenate([e for e, _ in each], axis=1), np.stack([f for _, f in each], axis=1)))
        candidates = self._marginal.candidate_scores(scores)
        evidence = evidence_by_cause(self._candidates, candidates)
        for name, free in self._free.items():
            fits = [light.scores(drawn, None)[1] for light in free]
            evidence[name] = np.max(fits, axis=0) - scores[0].fits[:, 0] - OCCAM_NATS
        return JudgedSets(candidates, evidence, np.concatenate([self._seen_by.whitened(one) for one in drawn]))

    def names_right(self, true: str, judged: JudgedSets) -> Array:
        """In which sets (n) anything alarms, a true cause leads, and no kernel follows what it does not."""
        causes = [n for n in judged.evidence if n not in KERNEL_NAMES]
        each = np.stack([judged.evidence[n] for n in causes])
        kernel = np.max([e for n, e in judged.evidence.items() if n in KERNEL_NAMES], axis=0, initial=-np.inf)
        unknown = [is_unknown(k, c) for k, c in zip(kernel, each.max(0), strict=True)]
        leads = (each.argmax(0) == causes.index(true)) & ~np.array(unknown, bool)
        if self._null is not None:
            # The next null distribution is much like the one there is.
            leads &= self._null.surprise(judged.evidence) > self._null.threshold
        return np.asarray(leads)

    def parts(self, true: str, other: str, judged: JudgedSets) -> Array:
        """Which sets (n) part a true cause from another: that is not among those that hold most of the probability, nor
        could it follow what the true one leaves."""
        causes = [n for n in judged.evidence if n not in KERNEL_NAMES]
        each = np.stack([judged.evidence[n] for n in causes])
        odds = np.exp(each - each.max(0))
        likely = odds[causes.index(other)] > (1 - CREDIBLE) * odds.sum(0)
        parted = np.asarray(~likely)
        if other not in self._free and parted.any():
            parted[parted] = self._apart(true, other, judged.of_rows(parted))
        return parted

    def _apart(self, true: str, other: str, judged: JudgedSets) -> Array:
        """Which sets part the two by d·√κ."""
        mine, others = self._places(true), self._places(other)
        best = np.array(mine)[judged.candidates[:, mine].argmax(1)]
        apart = np.ones(len(best), bool)
        for i in np.unique(best):
            rows, c = best == i, self._candidates[i]
            alike = [j for j in others if (self._candidates[j].of, self._candidates[j].pattern) == (c.of, c.pattern)]
            rivals = [j for j in alike or others if not is_free_in_each_run(self._candidates[j])]
            rivals = [j for j in rivals if self._candidates[j].pattern != "scan"]
            if c.pattern == "scan" or not rivals:
                continue
            least = (SEPARATION_99 if has_covariate_error(self._candidates[rivals[0]]) else SEPARATION_95) ** 2
            d2 = np.min(list(self._squares_apart(i, rivals, judged.white[rows], least)), axis=0)
            apart[rows] = d2 >= least
        return apart

    def _squares_apart(self, i: int, rivals: Sequence[int], white: Floats, least: float) -> Iterator[Floats]:
        """d²κ (n) of what a candidate leaves in white readings (n, U, M) against each of some others, freed of what
        noise adds; of what is above the least, also of what an error of the other's covariate explains."""
        found = self._axes_of(i)
        signal = _along(found, white.swapaxes(0, 1))
        squares, noise = np.sum(signal**2, axis=(0, 2)), found.vectors * np.sqrt(found.inverse)[:, None, :]
        for j in rivals:
            other = self._axes_of(j)
            inside = other.vectors.swapaxes(1, 2) @ noise
            inside = inside if other.own or found.own else inside.sum(0, keepdims=True)
            expected = float(np.sum(noise**2) - np.sum(other.inverse[..., None] * inside**2))
            apart = squares - np.sum(_along(other, signal) ** 2, axis=(0, 2)) - expected
            near = apart >= least
            if near.any() and has_covariate_error(self._candidates[j]):
                apart[near] -= self._gained_by_error(j, signal[:, near])
            yield np.asarray(apart)

    def _gained_by_error(self, j: int, signal: Floats) -> Floats:
        """How much nearer (n) an error of its covariate brings a candidate to signals (U, n, M)."""
        candidate = self._candidates[j]
        if j not in self._blurred:
            columns = self._seen_by.space.project(candidate.rows(self._view.layout))
            # All that the columns can follow of a signal is along these.
            along, columns = np.linalg.qr(columns)
            self._blurred[j] = along, columns
        along, columns = self._blurred[j]
        axes = candidate.axes if candidate.plain is None else candidate.plain.axes
        nearer = nearer_by_error((signal @ along).swapaxes(0, 1), columns, axes)
        return np.asarray(nearer.sum(-1))

    def _axes_of(self, i: int) -> SignatureAxes:
        if i not in self._axes:
            candidate = self._candidates[i]
            plain = candidate.plain or candidate
            hit = np.ones(len(plain.names))
            self._axes[i] = signature_axes(plain, self._view.layout, self._seen_by.space, hit)
        return self._axes[i]

    def _places(self, name: str) -> list[int]:
        return [i for i, c in enumerate(self._candidates) if c.name == name]


def _along(axes: SignatureAxes, white: Floats) -> Floats:
    """White readings (U, n, M) as a cause can follow them."""
    u = white @ axes.vectors
    u = axes.inverse[:, None] * (u if axes.own else u.sum(0, keepdims=True))
    return np.asarray(u @ axes.vectors.swapaxes(1, 2))


def _free_spaces(problem: ScoringProblem, floor: NoiseFloor, name: str) -> list[SinglePrecisionBank]:
    """The readings under floors of which one variance is beyond its bound."""
    most = float(np.sqrt(problem.upper[FLOOR_VARIANCES[name]]))
    part = "turn" if FLOOR_VARIANCES[name] == 1 else "walk"
    empty = build_bank([], problem.view.layout, moving=False)
    floors = [replace(floor, **{part: most * factor}) for factor in FREE_SPREADS]
    return [
        SinglePrecisionBank(s.projected[0]) for s in score_under_floors(problem.setting, [empty], floors, axes=True)
    ]
