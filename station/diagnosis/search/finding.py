"""What a search finds: a cause with its probability and its rivals, or a kernel that no cause explains."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.bank import Candidate, build_bank
from station.diagnosis.candidates.kernels import KERNEL_NAMES, covariates_of
from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.candidates.shape import has_jump, with_form
from station.diagnosis.linear.evidence import log_mean_exp
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.alarm import EXPLAINS_NATS, UNKNOWN_NATS
from station.diagnosis.search.distinguishability import (
    SEPARATION_95,
    SEPARATION_99,
    estimate_signal,
    has_covariate_error,
    separations,
)
from station.diagnosis.search.jump_times import fit_jump_times
from station.diagnosis.search.rank import RankedCause, causes_of, leaders
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem, score_bank
from station.diagnosis.search.unit_sample import FLOOR_UNITS, UnitSample, sampled_units
from station.domain.core.types import Floats

#: A kernel must beat every cause by this share, too: no form, and no mean of a block, is more exact. What it leaves out
#: is found in the next round.
KERNEL_MARGIN = 0.04
#: A set of causes less likely than this, which is less likely than not, does not account for what was found.
UNLIKELY = 1 / 2
#: A kernel so many nats ahead of a cause has its word said beside it.
AHEAD_NATS = 2.0
#: A separation in a sample of a fleet's units that is so many times as large as any that matters is none of chance.
SURE_SHARE = 2.0
#: A kernel is named beside the leading one where it explains all but this share of what that explains.
NEAR_SHARE = 0.08

#: A candidate and which of its groups (groups) act.
Hit = tuple[Candidate, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class CauseFinding:
    """One cause found, or one kernel that no cause explains.

    ranks: log evidence of every cause at that point; chosen: what was accepted; probability of it together with
    `indistinguishable_from`, those as they stood best being `alike`; d: its strength; floor: with it; words: what an
    unknown depends on; doubts: what that depends on which follows the data better than an unlikely cause.
    """

    name: str
    accepted: AcceptedCause | None
    floor: NoiseFloor
    evidence: Mapping[str, float]
    probability: Mapping[str, float]
    indistinguishable_from: tuple[str, ...]
    d: float
    statistic: float
    words: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    alike: tuple[Candidate, ...] = ()

    @property
    def numbers(self) -> int:
        """How many coefficients it has, over all units."""
        item = self.accepted
        return 0 if item is None else int(np.count_nonzero(item.hit)) * item.coefficient.shape[1]

    def beside(self, nats: float) -> "CauseFinding":
        """The finding with its probability where something that is none of the causes is so many nats ahead of it."""
        share = 1 / (1 + np.exp(min(nats, 500.0)))
        return replace(self, probability={name: float(p * share) for name, p in self.probability.items()})

    def at_most(self, chance: float) -> "CauseFinding":
        """The finding with a probability of its set no greater than a chance."""
        now = self.set_probability
        share = chance / now if now > chance else 1.0
        return replace(self, probability={name: p * share for name, p in self.probability.items()})

    @property
    def set_probability(self) -> float:
        """Of the cause together with those it cannot be told from."""
        members = (self.name, *self.indistinguishable_from)
        return min(1.0, sum(self.probability.get(name, 0.0) for name in members))

    @property
    def is_unlikely(self) -> bool:
        """Whether something else follows the data better than the cause or any that it cannot be told from."""
        return bool(self.probability) and self.set_probability < UNLIKELY

    @property
    def words_ahead(self) -> tuple[str, ...]:
        """On what the kernels depend that are ahead of the cause, and of any that it cannot be told from."""
        best = max((self.probability.get(n, 0.0) for n in (self.name, *self.indistinguishable_from)), default=0.0)
        kernels = ((p, name) for name, p in self.probability.items() if name in KERNEL_NAMES)
        ahead = [name for p, name in sorted(kernels, reverse=True) if p > best * np.exp(AHEAD_NATS - UNKNOWN_NATS)]
        return tuple(dict.fromkeys(word for name in ahead for word in covariates_of(name)))

    @property
    def covariates(self) -> tuple[str, ...]:
        """On what the kernels depend that explain most where it was found."""
        return self.words or depends_on({n: e for n, e in self.evidence.items() if n in KERNEL_NAMES})


def depends_on(kernels: Mapping[str, float]) -> tuple[str, ...]:
    """The covariates of the kernels that explain most, by their evidence; the likeliest first, none where none
    explains anything."""
    top = max(kernels.values(), default=0.0)
    near = [name for name, e in kernels.items() if e > 0 and e >= top - max(UNKNOWN_NATS, NEAR_SHARE * top)]
    near.sort(key=lambda name: -kernels[name])
    return tuple(dict.fromkeys(word for name in near for word in covariates_of(name)))


def is_unknown(kernel: float, cause: float) -> bool:
    """Whether a kernel, by its evidence, is ahead of every cause, or of causes that explain nothing."""
    return kernel > cause + max(UNKNOWN_NATS, KERNEL_MARGIN * cause) or cause < EXPLAINS_NATS < kernel


def unknown_finding(ranks: Mapping[str, RankedCause], surprise: float) -> CauseFinding:
    """The leading kernel, which no cause explains."""
    evidence = {name: r.evidence for name, r in ranks.items()}
    kernel = leaders(ranks)[1]
    assert kernel is not None
    words = depends_on({name: e for name, e in evidence.items() if name in KERNEL_NAMES})
    return CauseFinding(kernel.name, None, kernel.at.floor, evidence, {}, (), 0.0, surprise, words)


def cause_finding(
    problem: ScoringProblem, ranks: Mapping[str, RankedCause], cause: RankedCause, surprise: float
) -> CauseFinding:
    """A cause with those it cannot be told from. Its probability is that against everything a kernel can follow too:
    what nobody has described yet is as much less likely beforehand as it must be ahead to be called unknown."""
    evidence = {name: r.evidence for name, r in ranks.items()}
    causes = causes_of(ranks)
    likely = _credible(_posterior({r.name: r.evidence for r in causes}))
    probability = _posterior({n: e - UNKNOWN_NATS * (n in KERNEL_NAMES) for n, e in evidence.items()})
    accepted, floor = accepted_at_best(problem, cause)
    near_by, d = _indistinguishable(problem, causes, accepted, floor)
    # What explains nothing is in the set of none, however little the others explain.
    shown = [n for n in likely if evidence[n] >= EXPLAINS_NATS]
    members = [n for n in dict.fromkeys((*shown, *near_by)) if n != cause.name]
    alike = tuple(r.best for r in causes if r.best is not None and r.name in members)
    return CauseFinding(cause.name, accepted, floor, evidence, probability, tuple(members), d, surprise, alike=alike)


def accepted_at_best(problem: ScoringProblem, cause: RankedCause) -> tuple[AcceptedCause | None, NoiseFloor]:
    """The cause with its amplitude under the floor that fits best with it, and that floor."""
    if cause.best is None:
        return None, cause.at.floor
    best, at, hit = cause.best, cause.at, None
    if has_jump(best.effect) and best.pattern == "scan":
        if best.own:
            # At one time of all, from which each run's own is found once more, with those that jumped by less.
            best = with_form(replace(best, own=()), best.own[0], problem.view)
            at = score_bank(problem, [build_bank([best], problem.view.layout, moving=False)], at.floor)
        best, hit = fit_jump_times(problem, at.accept(best, problem.view), at.floor)
        at = score_bank(problem, [build_bank([best], problem.view.layout, moving=False)], at.floor)
    floor = problem.with_accepted((*problem.accepted, at.accept(best, problem.view, hit))).fit(at.floor).floor
    own = score_bank(problem, [build_bank([best], problem.view.layout, moving=best.moving)], floor)
    return own.accept(best, problem.view, hit), floor


def _posterior(evidence: Mapping[str, float]) -> dict[str, float]:
    values = np.array(list(evidence.values()))
    shares = np.exp(values - (log_mean_exp(values) + np.log(len(values))))
    return dict(zip(evidence, (float(s) for s in shares), strict=True))


def _credible(probability: Mapping[str, float], level: float = 0.99) -> list[str]:
    """The likeliest causes that together hold `level` of the probability."""
    chosen: list[str] = []
    for name in sorted(probability, key=lambda n: -probability[n]):
        if sum(probability[n] for n in chosen) >= level:
            break
        chosen.append(name)
    return chosen


def is_free_in_each_run(candidate: Candidate) -> bool:
    """Whether a cause has coefficients of its own in each run, with which it imitates any slow one; that there are
    fewer of others tells them apart."""
    usual = candidate.effect.of[0] if candidate.effect is not None else ""
    return usual == "run" and candidate.pattern == "own"


def _rival_of(accepted: Candidate, best: Candidate, at: ScoredBank) -> Candidate:
    """A rival as it stood best where it acts in the same groups as what was accepted, if it can: the level at which it
    explains least badly alone is the one of fewest numbers, which follows nothing."""
    alike = [
        (value, c)
        for value, c in zip(at.readings().evidence[0], at.candidates, strict=True)
        if c.name == best.name and (c.of, c.pattern) == (accepted.of, accepted.pattern)
    ]
    if not alike or (best.of, best.pattern) == (accepted.of, accepted.pattern):
        return best
    return max(alike, key=lambda pair: pair[0])[1]


def _indistinguishable(
    problem: ScoringProblem, causes: Sequence[RankedCause], accepted: AcceptedCause | None, floor: NoiseFloor
) -> tuple[list[str], float]:
    """Causes closer than 3.3 to the accepted one, and its strength d."""
    if accepted is None:
        return [], 0.0
    # An offset of each run's own imitates any slow cause; that parsimony forbids it, no column shows. What is in the
    # model already has no columns left to imitate with.
    known = {(c.name, c.of) for c in (a.candidate for a in problem.accepted) if c.pattern != "scan"}
    others = [
        (_rival_of(accepted.candidate, r.best, r.at), r.at)
        for r in causes
        if r.best is not None and r.name != accepted.candidate.name and not is_free_in_each_run(r.best)
    ]
    others = [(c, at) for c, at in others if (c.name, c.of) not in known]
    moving = any(c.moving for c in (accepted.candidate, *(c for c, _ in others)))
    space = problem.space(floor, moving=moving)
    mine = accepted.candidate, accepted.hit.astype(float)
    found = estimate_signal(mine[0], problem.view.layout, space, mine[1])
    hits = [(c, at.hit(c, problem.view, alone=True).astype(float)) for c, at in others]
    if (sample := sampled_units(problem.setting, FLOOR_UNITS)) is not None:
        hits = _perhaps_near(sample, mine, hits, sample.setting.space(floor, moving=moving))
    apart = separations(found, hits, problem.view.layout, space)
    # How far a covariate may be off is an estimate, too: from such a cause nothing is told by little.
    blurred = {c.name for c, _ in others if has_covariate_error(c)}
    near = [n for n, x in apart.items() if x < (SEPARATION_99 if n in blurred else SEPARATION_95)]
    return sorted(near, key=lambda n: apart[n]), found.d


def _perhaps_near(sample: UnitSample, mine: Hit, others: Sequence[Hit], space: ResidualSpace) -> list[Hit]:
    """The causes that a fleet's sample, in its space, does not show to be further from the accepted one, mine, than it
    takes to tell them apart: squares of what a cause cannot follow add up over units."""
    layout = sample.setting.layout
    candidate, hit = sample.of(*mine)
    found = estimate_signal(candidate, layout, space, hit)
    apart = separations(found, [sample.of(*one) for one in others], layout, space)
    return [one for one in others if apart[one[0].name] < SURE_SHARE * SEPARATION_99]
