"""What is left with calibrations and causes fitted: the counterpart of the residual of the simulation as it was, by
plain least squares over the visits."""

import numpy as np

from station.diagnosis.candidates.solve import WhiteRows, solve
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Floats


def remaining_rms(problem: ScoringProblem) -> float:
    """Rms of measured − simulated over the visits, in the recipe's unit; all visits weigh the same and no coefficient
    has a prior."""
    own, shared = (_rows(part.visit) for part in (problem.known.own, problem.known.shared))
    data = _rows(problem.view.readings().visit)[..., 0]
    white = WhiteRows(own, shared, data, data.shape[1], 0)
    live = problem.structure.pad[problem.structure.member].reshape(data.shape) == 0
    rest = white.residual(solve(white))[live]
    return float(np.sqrt(np.mean(rest**2))) if len(rest) else 0.0


def _rows(grid: Floats) -> Floats:
    """Rows (U, R, m, c) of all runs of a unit, one after the other."""
    U, R, m = grid.shape[:3]
    return np.asarray(grid).reshape(U, R * m, *grid.shape[3:])
