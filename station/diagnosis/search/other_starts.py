"""Whether causes that begin with another one than the leader explain more together.

The first cause is chosen alone. A jump that may be in any run absorbs what a warm-up does in all of them, and the
remainder no longer shows it. So each of the best few is fitted beside whatever fits best next to it, all under one
floor, at the price of one pass over the bank. For the cause that was found first, the state after it already tells its
best partner. Only what is then ahead is searched in full.
"""

from collections.abc import Mapping

import numpy as np

from station.diagnosis.candidates.bank import Bank
from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.search.cause_chains import CHOICE_NATS, Chain, chain_from
from station.diagnosis.search.finding import CauseFinding
from station.diagnosis.search.held_out_gain import held_out_gain
from station.diagnosis.search.rank import RankedCause, causes_of
from station.diagnosis.search.scoring import ScoringProblem, evidence_by_cause, score_bank
from station.diagnosis.search.search_state import CauseSearch, SearchState
from station.diagnosis.search.unit_sample import FLOOR_UNITS, HOPELESS_NATS, UnitSample, sampled_units

#: Causes that are set beside another one, and pairs that are looked for in full.
MAX_STARTS, MAX_PAIRS = 4, 2
#: What a cause explains beside another, it explains to this share alone, at the least.
ALONE_SHARE = 0.5
#: What begins with another cause must be so many nats ahead, odds of twenty.
AHEAD_NATS = 3.0


def best_of_starts(search: CauseSearch, state: SearchState, ranks: Mapping[str, RankedCause], found: Chain) -> Chain:
    """The chain found from a state with such ranks, or one that begins with another cause, explains clearly more and
    leaves nothing."""
    if not found or any(f.words for f, _ in found):
        return found
    least = _value(found) + AHEAD_NATS
    tried = set[str]()
    for value, names in _pairs(search, state.problem, ranks, found, least):
        if value <= least or len(tried) >= 2 * MAX_PAIRS:
            break
        for name in names:
            first = ranks.get(name)
            if name in tried or name == found[0][0].name or first is None or first.best is None:
                continue
            tried.add(name)
            other = chain_from(search, first, state, ranks, (), set())[1]
            if _value(other) > least and not other[-1][1].alarms and _pays(search, other):
                found, least = other, _value(other)
    return found


def _value(found: Chain) -> float:
    """The evidence of causes one after the other, each further one being one more choice."""
    return sum(f.evidence[f.name] for f, _ in found) - CHOICE_NATS * (len(found) - 1)


def _pays(search: CauseSearch, found: Chain) -> bool:
    """Whether each of the causes gains on held-out data beside the others."""
    last, first = found[-1][1], len(search.first.problem.accepted)
    smooth = [f for f, _ in found if f.accepted is not None]
    return all(held_out_gain(last.problem, first + i, last.now.floor).accepted for i in range(len(smooth)))


def _pairs(
    search: CauseSearch, problem: ScoringProblem, ranks: Mapping[str, RankedCause], found: Chain, least: float
) -> list[tuple[float, tuple[str, str]]]:
    """What the likeliest causes, and those that were found, explain with the best partner of each; the most first. What
    cannot come to the least need not be told exactly."""
    names = {f.name for f, _ in found}
    visible = (r for r in causes_of(ranks) if r.best is not None and r.evidence > 0 and r.at.shows(r.best))
    causes = sorted(visible, key=lambda r: (r.name in names, r.evidence), reverse=True)[:MAX_STARTS]
    first, after = found[0]
    pairs = list[tuple[float, tuple[str, str]]]()
    for cause in causes:
        if cause.name == first.name:
            pairs.append(_best_pair(cause, after.evidence))
            continue
        partner = _Partner(problem, cause, first, ranks, least)
        pairs.append(_best_pair(cause, partner.evidence(search)))
        if partner.sample is not None and first.name in ranks:
            pairs.append(_best_pair(ranks[first.name], {cause.name: after.evidence.get(cause.name, -np.inf)}))
    return sorted(pairs, reverse=True)


def _best_pair(cause: RankedCause, evidence: Mapping[str, float]) -> tuple[float, tuple[str, str]]:
    """The evidence of a cause and of the best one beside it, by the evidence of all beside it, and their names."""
    causes = ((e, name) for name, e in evidence.items() if name not in KERNEL_NAMES)
    value, partner = max(causes, default=(-np.inf, cause.name))
    return cause.evidence + value - CHOICE_NATS, (cause.name, partner)


class _Partner:
    """The causes beside one that is known: of a fleet those of which any may be the best, and of so many nats that both
    come to the least. What is beside the first one found the state after it tells: with the same columns that is no
    other pair."""

    def __init__(
        self,
        problem: ScoringProblem,
        cause: RankedCause,
        first: CauseFinding,
        ranks: Mapping[str, RankedCause],
        least: float,
    ) -> None:
        assert cause.best is not None
        self._known = problem.with_accepted((*problem.accepted, cause.at.accept(cause.best, problem.view)))
        self._start, self._first, self._ranks = cause.at.floor, first, ranks
        self._least = least - cause.evidence + CHOICE_NATS
        self.sample = sampled_units(self._known.setting, FLOOR_UNITS)

    def evidence(self, search: CauseSearch) -> dict[str, float]:
        """The evidence of each."""
        every = search.banks.of(self._known.view, search.undetectable)
        banks = [bank.named({c.name for c in bank.candidates} - set(KERNEL_NAMES)) for bank in every]
        if self.sample is not None:
            banks = self._hopeful(self.sample, [bank.only(self._others(bank)) for bank in banks])
        if not any(bank.candidates for bank in banks):
            return {}
        floor = self._known.fit(self._start).floor
        now = score_bank(self._known, banks, floor)
        evidence = evidence_by_cause(now.candidates, now.readings().evidence)
        return {name: float(e[0]) for name, e in evidence.items()}

    def _others(self, bank: Bank) -> list[int]:
        """The candidates of a bank but for that which was found first; what hits few units may hit others beside
        another cause."""
        item = self._first.accepted
        known = None if item is None else (item.candidate.effect, item.candidate.of, item.candidate.pattern)
        alike = [(c.effect, c.of, c.pattern) == known and c.pattern != "scan" for c in bank.candidates]
        return [i for i, same in enumerate(alike) if not same]

    def _hopeful(self, sample: UnitSample, banks: list[Bank]) -> list[Bank]:
        """Those that a sample, under a floor of its own, does not show to be far behind or to explain too little; and
        all that hit few units, as they may hit none of the sample, but hardly explain twice what they do alone."""
        candidates = [c for bank in banks for c in bank.candidates]
        floor = sample.fitted(self._known, self._start)
        (some,) = sample.scored(candidates, [floor])
        evidence = some.readings().evidence[0]
        far = (sample.surely(evidence.max() - evidence) > HOPELESS_NATS) | (sample.at_most(evidence) < self._least)
        names = {c.name for c, behind in zip(some.candidates, far, strict=True) if not behind}
        names |= {c.name for c in candidates if c.pattern == "scan" and self._may_do(c.name)}
        return [bank.named(names) for bank in banks]

    def _may_do(self, name: str) -> bool:
        """Whether a cause explains enough of what is asked for alone."""
        return name not in self._ranks or self._ranks[name].evidence >= ALONE_SHARE * self._least
