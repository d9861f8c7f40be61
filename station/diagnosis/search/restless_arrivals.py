"""What each arrival stirs up in its own way: no column has its course, but dwells are livelier as they begin."""

import numpy as np

from station.diagnosis.candidates.kernels import ARRIVALS
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.unseen import LEAST_CHANCE, NOTHING, Unseen


def find_restless_arrivals(problem: ScoringProblem) -> dict[str, Unseen]:
    """What is livelier early in the dwells than late, under its name as a kernel; nothing of lengths alone, and nothing
    beside a cause that moves within the dwells, whose form is never exact. How much it explains is at most what its
    chance p can say, 1 / (−e·p·ln p) (Sellke, Bayarri and Berger)."""
    view = problem.view
    if view.grid.k != 3 or any(cause.candidate.moving for cause in problem.accepted):
        return {ARRIVALS: NOTHING}
    p = max(view.reduced.early_chance, LEAST_CHANCE)
    nats = -1.0 - float(np.log(p)) - float(np.log(-np.log(p))) if p < np.exp(-1) else 0.0
    return {ARRIVALS: Unseen.of(nats, p)}
