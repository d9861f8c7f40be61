"""How far the best of many laws is ahead of a cause that is true: sets of readings are drawn from the cause as it was
found and the floor, and scored by the cause's forms and all laws alike."""

from collections.abc import Mapping, Sequence

import numpy as np

from station.diagnosis.candidates.bank import Candidate, build_bank
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.linear.projection import DataColumns
from station.diagnosis.search import null_simulation
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.walk_marginal import WalkMarginal
from station.domain.core.types import Floats

#: Sets that are drawn, and the seed.
SETS, SEED = 512, 1


def chance_of_lead(
    problem: ScoringProblem,
    bare: ScoringProblem,
    forms: Sequence[Candidate],
    laws: Sequence[Candidate],
    floor: NoiseFloor,
    lead: float,
) -> float:
    """How often the best of some laws is so many nats ahead of the best form of a cause where that is true; 0 where it
    is in none of the sets.

    problem: with the cause known; bare: without it; floor: with it, under which all are judged.
    """
    items = [*forms, *laws]
    # Where nothing moves within the visits, what does is no space to look at.
    banks = [build_bank(items, bare.view.layout, moving=moving) for moving in sorted({c.moving for c in items})]
    like = WalkMarginal(score_bank(bare, banks, floor), (), ())
    names = {c.name for c in forms}
    drawn = null_simulation.scores(bare, problem.fit(floor), like, SEED, SETS, _signal(problem, bare))
    ahead = np.concatenate([_lead(scores, names) for scores in drawn])
    return float(np.mean(ahead >= lead))


def _lead(scores: Mapping[str, Floats], forms: set[str]) -> Floats:
    """By how much the best law is ahead of the best form (n)."""
    own = np.max([s for name, s in scores.items() if name in forms], axis=0)
    return np.asarray(np.max([s for name, s in scores.items() if name not in forms], axis=0) - own)


def _signal(problem: ScoringProblem, bare: ScoringProblem) -> DataColumns:
    """What the cause does to the readings, by its estimate."""
    (without, inside), (beside, rest) = bare.setting.data, problem.setting.data
    moves = None if inside is None or rest is None else inside - rest
    return DataColumns(without - beside, moves)
