"""A bias that wanders and returns: what each visit adds dies away in those after it.

A walk keeps all that it has come to. Where each step fades by a share from visit to visit (an autoregressive process of
the first order), the floor is another one and no walk: a dwell of any length then has the same error, and no longer one
helps. It is judged by the same likelihood, its scale at its best.
"""

from dataclasses import replace

import numpy as np

from station.diagnosis.linear.noise_floor import FloorStructure, NoiseFloor
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats

#: Visits of the longest run that is whitened in one piece, a matrix of a megabyte.
MOST_WHITENED = 120
#: Shares of what one visit has come to that the next one keeps.
KEPT = (0.3, 0.6, 0.8)
#: Sizes of a visit's own step that are tried, in noises of a visit.
STEPS = (0.2, 0.35, 0.6, 1.0, 1.7, 3.0, 5.5, 10.0)


def nats_ahead(problem: ScoringProblem) -> float:
    """By how many nats what returns follows the readings better than the walk of the floor, less what it costs to
    choose how fast; −∞ where runs are too long to be whitened whole."""
    structure, walk = _in_one_piece(problem.structure), problem.fit()
    if structure.walk.shape[2] > MOST_WHITENED:
        return -np.inf
    best = max(_profile(problem, _returning(structure, kept), walk.floor) for kept in KEPT)
    return best - walk.space.profile - float(np.log(len(KEPT)))


def _in_one_piece(structure: FloorStructure) -> FloorStructure:
    """The structure with each run in one block, its inside left as it was."""
    C, B, v, k = structure.walk.shape[:4]
    turn, walk = (x.reshape(C, 1, B * v, k, 3) for x in (structure.turn, structure.walk))
    step = structure.step.reshape(C, 1, B * v)
    white = structure.white.reshape(C, 1, B * v * k)
    return replace(structure, white=white, turn=turn, walk=walk, step=step, taken=step.cumsum(2))


def _profile(problem: ScoringProblem, structure: FloorStructure, floor: NoiseFloor) -> float:
    """Log-likelihood of the readings under the best of the steps."""
    setting = replace(problem.setting, structure=structure)
    floors = (NoiseFloor(floor.noise, floor.turn, step * floor.noise) for step in STEPS)
    return max(setting.space(at, moving=problem.known.moving).profile for at in floors)


def _returning(structure: FloorStructure, kept: float) -> FloorStructure:
    """The structure with steps of which each visit keeps a share."""
    taken = structure.taken
    first = np.minimum(taken[..., :, None], taken[..., None, :])
    apart = np.abs(taken[..., :, None] - taken[..., None, :])
    both: Floats = kept**apart * (1 - kept ** (2 * first)) / (1 - kept**2)
    walk = structure.walk
    inside = both[..., :, None, :, None] * np.einsum("cbvia,cbwja->cbviwj", walk, walk, optimize=True)
    numbers = structure.white.shape[2]
    return replace(structure, inside=inside.reshape(len(walk), 1, numbers, numbers))
