"""The chance that a plan leaves the right cause alone: the share of simulated diagnoses of it that do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.planning.measured import MeasuredCampaign
from station.diagnosis.planning.next_readings import NextReadings
from station.diagnosis.planning.plan import PlannedCampaign, PlannedRuns
from station.diagnosis.planning.promise import TrueAndOther
from station.diagnosis.planning.simulated_diagnosis import SimulatedDiagnosis
from station.diagnosis.planning.suspects import Suspects, suspect_candidate, usual_shapes
from station.diagnosis.search.null_noise import NullNoise
from station.domain.core.types import Array, Floats

#: Sets that share one floor.
SETS_OF_A_FLOOR = 8
#: 97.5 % quantile of the normal distribution.
Z95 = 1.96


@dataclass(frozen=True, slots=True)
class SimulatedChance:
    """In how many of so many simulated diagnoses the right cause is left alone."""

    right: int
    sets: int

    @property
    def share(self) -> float:
        """The chance."""
        return self.right / self.sets

    @property
    def interval(self) -> tuple[float, float]:
        """Its 95 % interval (Wilson, J. Am. Stat. Assoc. 22 (1927) 209)."""
        n, p, z2 = self.sets, self.share, Z95**2
        middle, half = p + z2 / (2 * n), Z95 * float(np.sqrt(p * (1 - p) / n + z2 / (4 * n * n)))
        low, high = (middle - half) / (1 + z2 / n), (middle + half) / (1 + z2 / n)
        # No rounding takes a share of none or all out of its own interval.
        return min(max(low, 0.0), p), max(min(high, 1.0), p)


@dataclass(frozen=True, slots=True)
class SetsToDraw:
    """How many sets are drawn, and of which seed."""

    count: int
    seed: int


#: Sets by which a plan is chosen, and others by which the chance of what was chosen is told.
CHOOSING_SETS, PROMISED_SETS = SetsToDraw(64, 1), SetsToDraw(96, 2)


@dataclass(frozen=True, slots=True)
class SimulatedPlan:
    """parted: of pairs of causes in the order of their names, the share of sets that part them where one of them is
    true."""

    chance: SimulatedChance
    parted: Mapping[TrueAndOther, float]


@dataclass(frozen=True, slots=True, eq=False)
class PlanSimulator:
    """A longer campaign of which diagnoses are simulated: its shapes of each cause by name, those of it as the true
    temperature has them, the diagnosis and what draws readings. What costs most is made once for all sets."""

    plan: PlannedCampaign
    truth: PlannedCampaign
    shapes: Mapping[str, Sequence[Candidate]]
    diagnosis: SimulatedDiagnosis
    readings: NextReadings

    @staticmethod
    def of(
        campaign: MeasuredCampaign, runs: PlannedRuns, lines_up: Sequence[Suspects], new: Sequence[str] = ()
    ) -> "PlanSimulator":
        """Of a campaign with more runs; new: causes that only these can show, none of which is true."""
        plan = campaign.gone_on(runs)
        names = tuple(dict.fromkeys([*(name for suspects in lines_up for name in suspects.members), *new]))
        shapes = {name: usual_shapes(plan, name) for name in names}
        # A cause follows the temperature, not the thermometer.
        truth = campaign.gone_on(runs, exact=True) if _reads_thermometer(lines_up) else plan
        scale = np.array([plan.floor.variances[0] / campaign.floor.variances[0], 1.0, 1.0])
        readings = NextReadings(plan.problem, plan.floor, campaign.spread * np.outer(scale, scale), campaign.known_runs)
        return PlanSimulator(plan, truth, shapes, SimulatedDiagnosis(plan, shapes, campaign.null), readings)

    def simulated(self, lines_up: Sequence[Suspects], sets: SetsToDraw) -> SimulatedPlan:
        """What diagnoses of drawn sets say; a cause of a tie is true in as many sets as it is likely."""
        rng = np.random.default_rng(sets.seed)
        right = np.ones(sets.count, bool)
        pairs: dict[TrueAndOther, list[Array]] = {}
        for suspects in lines_up:
            one_tie = self._right(suspects, sets.count, rng, pairs)
            # Which set of one tie goes with which of another is chance; of a single one the order is kept.
            right &= one_tie if suspects is lines_up[0] else rng.permutation(one_tie)
        parted_share = {pair: float(np.mean(np.concatenate(each))) for pair, each in pairs.items()}
        return SimulatedPlan(SimulatedChance(int(right.sum()), len(right)), parted_share)

    def _right(
        self, suspects: Suspects, sets: int, rng: np.random.Generator, pairs: dict[TrueAndOther, list[Array]]
    ) -> Array:
        """Which of so many sets leave the right cause of one tie alone; adds to pairs which of them part each two."""
        causes = zip(suspects.tie.names, suspects.tie.likely, suspects.causes, strict=True)
        likely = [(name, p * one.share, one) for name, p, shaped in causes for one in shaped]
        counts = shared_out(np.array([p for _, p, _ in likely]), sets)
        drawn = list[NullNoise]()
        for (name, _, one), count in zip(likely, counts, strict=True):
            shapes = self.shapes[name] if self.truth is self.plan else usual_shapes(self.truth, name)
            candidate = suspect_candidate(self.truth, one, shapes)
            for first in range(0, int(count), SETS_OF_A_FLOOR):
                together = min(SETS_OF_A_FLOOR, int(count) - first)
                drawn.append(self.readings.sets(candidate.plain or candidate, one.size, together, rng))
        found, ends, judged = [], np.cumsum(counts), self.diagnosis.judged(drawn)
        for (name, _, _), count, end in zip(likely, counts, ends, strict=True):
            mine = judged.of_rows(slice(int(end - count), int(end)))
            alone = self.diagnosis.names_right(name, mine)
            for other in self.shapes if count else ():
                if other != name:
                    parted = self.diagnosis.parts(name, other, mine)
                    pairs.setdefault((min(name, other), max(name, other)), []).append(parted)
                    alone &= parted
            found.append(alone)
        return np.concatenate(found)


def _reads_thermometer(lines_up: Sequence[Suspects]) -> bool:
    """Whether any cause follows what the thermometer shows."""
    effects = [one.effect for suspects in lines_up for shapes in suspects.causes for one in shapes]
    return any(need.startswith("temperature") for effect in effects for need in effect.needs)


def shared_out(weights: Floats, count: int) -> Array:
    """How many of a count each has by its weight, to the next whole number."""
    exact = count * weights / weights.sum()
    whole: Array = np.floor(exact).astype(int)
    most = np.argsort(whole - exact, kind="stable")[: count - int(whole.sum())]
    whole[most] += 1
    return whole
