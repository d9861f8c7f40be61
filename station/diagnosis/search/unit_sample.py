"""A few units of a fleet, spread over it, in which the search sees what is far behind before it looks at all of them.

Evidence adds up over units: what is behind by D nats in n of N units is behind by N/n·D in all, give or take N/n·√(2D),
as a log-likelihood ratio of mean D has the variance 2D. What is far behind by many such errors is so in all units, and
no unit more is spent on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import Bank, Candidate, build_bank
from station.diagnosis.linear import noise_floor
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.scoring import ScoredBank, ScoringProblem, ScoringSetting, score_under_floors
from station.domain.core.types import Floats

#: A fleet has so many times as many units as a sample, at the least.
LEAST_SHARE = 4
#: Standard errors of a sum over the sample beyond which it is no chance.
SURE_ERRORS = 6.0
#: Units of a fleet that show what a candidate changes of a floor's likelihood, and how many nats a floor must be behind
#: another to be without hope: it then changes an evidence by less than a part in 10⁸.
FLOOR_UNITS, HOPELESS_NATS = 40, 20.0
#: Steps by it fill a stretch evenly, however many they are.
GOLDEN_RATIO = (np.sqrt(5.0) - 1) / 2


@dataclass(frozen=True, slots=True, eq=False)
class UnitSample:
    """The setting of the sampled units, which visits (v) are theirs, and for how many units each of them stands."""

    setting: ScoringSetting
    visits: NDArray[np.bool_]
    share: float

    def banks(self, candidates: Sequence[Candidate]) -> tuple[Bank, ...]:
        """Banks of candidates of the whole fleet, those that move within a visit apart, if there are any."""
        columns = {id(c.columns): c.columns.select_visits(self.visits) for c in candidates}
        codes = {id(c.code): c.code[self.visits] for c in candidates}
        items = [replace(c, code=codes[id(c.code)], columns=columns[id(c.columns)]) for c in candidates]
        kinds = sorted({c.moving for c in items})
        return tuple(build_bank(items, self.setting.layout, moving=moving) for moving in kinds)

    def of(self, candidate: Candidate, hit: Floats) -> tuple[Candidate, Floats]:
        """A candidate of the whole fleet and which of its groups (groups) act, as the sample has them."""
        there = np.zeros(len(hit))
        there[candidate.code[self.visits]] = 1.0
        plain = candidate.plain and candidate.plain.select_visits(self.visits)
        return replace(candidate.select_visits(self.visits), plain=plain), hit * there

    def fitted(self, problem: ScoringProblem, start: NoiseFloor) -> NoiseFloor:
        """The floor that fits the sample of a problem best."""
        rows, count = self.setting.readings(moving=False)
        structure, known, least = self.setting.structure, self.setting.known, problem.view.min_variance
        return noise_floor.fit(structure, known, rows, count, problem.upper, start, least).floor

    def scored(self, candidates: Sequence[Candidate], floors: Sequence[NoiseFloor]) -> tuple[ScoredBank, ...]:
        """Candidates of the whole fleet, as its sample shows them under each of some floors."""
        return score_under_floors(self.setting, self.banks(candidates), floors)

    def behind(self, candidates: Sequence[Candidate], floors: Sequence[NoiseFloor], without: Floats) -> Floats:
        """By how many nats each floor is at the least behind the best of them with each candidate (floors, candidates),
        still ones first. without (floors, ·): log-likelihood of all units without a candidate. What a fleet says of a
        floor by itself is known of all its units, what a candidate changes of that in the sample."""
        some = self.scored(candidates, floors)
        sampled = np.stack([s.readings().fits[0] for s in some])[:, some[0].space_index]
        total, alone = sampled + np.stack([s.readings().evidence[0] for s in some]), sampled.max(0) - sampled
        # A unit unlike all others shows in one of the two.
        by_itself = np.minimum(without.max(0) - without, self.share * alone)
        return np.asarray(by_itself + self.surely(total.max(0) - total - alone))

    def surely(self, nats: Floats) -> Floats:
        """By how many nats at the least all units differ where the sample differs by so many."""
        return np.asarray(self.share * (nats - SURE_ERRORS * np.sqrt(2 * np.abs(nats))))

    def at_most(self, nats: Floats) -> Floats:
        """By how many nats at the most all units say what the sample says by so many: of more, D, it would say
        D − SURE_ERRORS·√(2D) at the least."""
        half = SURE_ERRORS / np.sqrt(2)
        return np.asarray(self.share * (half + np.sqrt(half**2 + np.maximum(nats, 0.0))) ** 2)


def spread_units(units: int, count: int, which: int = 0) -> NDArray[np.intp]:
    """So many of a fleet's units (in order), one of each of as many stretches of it; `which` of two such sets, which
    share none. Units in even steps could all be of one nest: the place within a stretch goes on by the golden ratio."""
    ends = (np.arange(count + 1) * units / count).astype(np.intp)
    place = (np.arange(count) * GOLDEN_RATIO + 0.5 * which) % 1.0
    return np.asarray(ends[:-1] + (place * np.diff(ends)).astype(np.intp))


def sampled_units(setting: ScoringSetting, count: int, which: int = 0) -> UnitSample | None:
    """So many units spread over a fleet (see `spread_units`); None of a fleet that has too few for it."""
    units = setting.layout.grid.units
    if units < LEAST_SHARE * count:
        return None
    some, visits = setting.of_units(spread_units(units, count, which))
    return UnitSample(some, np.asarray(visits, bool), units / count)
