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
    # What moves within the visits and what does not are seen in spaces of their own, under one floor not comparable.
    alike = [{c.name for c in items if c.moving == moving} for moving in sorted({c.moving for c in forms})]
    drawn = null_simulation.scores(bare, problem.fit(floor), like, SEED, SETS, _signal(problem, bare))
    own = {c.name for c in forms}
    ahead = np.concatenate([np.max([_lead(scores, own, some) for some in alike], axis=0) for scores in drawn])
    return float(np.mean(ahead >= lead))


def _lead(scores: Mapping[str, Floats], forms: set[str], alike: set[str]) -> Floats:
    """By how much the best law is ahead of the best form (n), of those that are seen alike."""
    own = np.max([s for name, s in scores.items() if name in forms & alike], axis=0)
    laws = [s for name, s in scores.items() if name in alike - forms]
    return np.asarray(np.max(laws, axis=0) - own if laws else np.full_like(own, -np.inf))


def _signal(problem: ScoringProblem, bare: ScoringProblem) -> DataColumns:
    """What the cause does to the readings, by its estimate."""
    (without, inside), (beside, rest) = bare.setting.data, problem.setting.data
    moves = None if inside is None or rest is None else inside - rest
    return DataColumns(without - beside, moves)
