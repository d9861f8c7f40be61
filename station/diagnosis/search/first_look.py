"""The first look at a fleet in which a sample of its units shows what leads.

Causes and kernels certainly far behind the leader of their kind are evaluated in all units only at the shape that is
best in the sample, at each level, and in whatever hits few units, which may hit none of the sample: enough to know how
far behind they are. What is near is evaluated in every shape, and so is everything once the leader is known. Where
nothing leads by so much, nothing is left out: a healthy fleet is judged by all candidates in all units.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from station.diagnosis.candidates.bank import Bank, Candidate
from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.best_form import PROMISING_SHARE
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem
from station.diagnosis.search.unit_sample import FLOOR_UNITS, UnitSample, sampled_units
from station.domain.core.types import Floats

#: A floor whose turn or walk is at its bound may be the cause itself: nothing is then left out.
AT_BOUND = 0.99


class SampledLook(NamedTuple):
    """All candidates of a fleet as a sample of its units shows them under a floor."""

    sample: UnitSample
    scored: ScoredBank

    def contenders(self) -> tuple[Bank, ...] | None:
        """The candidates that are to be looked at in all units; None where that is nearly all."""
        far = self._far_behind()
        chosen = _representatives(self.scored.candidates, self.scored.readings().evidence[0], far)
        if not far:
            return None
        banks, first = [], 0
        for bank in (s.bank for s in self.scored.projected):
            here = {i - first: many for i, many in chosen.items() if 0 <= i - first < len(bank.candidates)}
            first += len(bank.candidates)
            banks.append(bank.standing_for(here))
        return tuple(banks)

    def _far_behind(self) -> set[str]:
        """The names that say at the most, in all units, a share of what the leader of their kind says at the least."""
        best: dict[str, float] = {}
        for c, nats in zip(self.scored.candidates, self.scored.readings().evidence[0].tolist(), strict=True):
            best[c.name] = max(nats, best.get(c.name, -np.inf))
        far = set[str]()
        for kind in (best.keys() & set(KERNEL_NAMES), best.keys() - set(KERNEL_NAMES)):
            names = sorted(kind)
            nats = np.array([best[name] for name in names])
            least = PROMISING_SHARE * self.sample.surely(nats.max(initial=0.0))
            far |= {name for name, most in zip(names, self.sample.at_most(nats), strict=True) if most < least}
        return far


def sampled_look(problem: ScoringProblem, banks: Sequence[Bank], floor: NoiseFloor) -> SampledLook | None:
    """A look at the candidates of a fleet in a sample of its units; None where there is none, or the floor itself may
    be the cause."""
    sample = sampled_units(problem.setting, FLOOR_UNITS)
    if sample is None or np.any(floor.variances[1:] > AT_BOUND * problem.upper[1:]):
        return None
    (some,) = sample.scored([c for bank in banks for c in bank.candidates], [floor])
    whole = {bank.moving: bank for bank in banks}
    projected = tuple(replace(s, bank=whole[s.bank.moving]) for s in some.projected)
    return SampledLook(sample, ScoredBank(floor, projected))


def _representatives(candidates: Sequence[Candidate], evidence: Floats, far: set[str]) -> dict[int, int]:
    """The places of the candidates to look at, and for how many each stands: of a name that is far behind the best of
    each level, and whatever hits few units."""
    chosen, best = dict[int, int](), dict[tuple[str, str], list[int]]()
    for i, c in enumerate(candidates):
        if c.name not in far or c.pattern == "scan":
            chosen[i] = 1
        else:
            best.setdefault((c.name, c.of), []).append(i)
    chosen |= {max(places, key=lambda i: float(evidence[i])): len(places) for places in best.values()}
    return dict(sorted(chosen.items()))
