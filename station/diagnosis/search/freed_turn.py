"""A disturbed visit that is a turn to the first order alone.

While a turn is small its columns are those of any reading beside the stimulus, with one number fewer: a visit that
reads .05 g too much on one axis ranks as a turn of .05 rad. At work that turn also shortens what the axis along the
stimulus feels, by half its square, which such a visit does not show.
"""

from dataclasses import replace

from station.diagnosis.candidates.bank import build_bank
from station.diagnosis.candidates.kernels import disturbed_readings
from station.diagnosis.search.finding import CauseFinding
from station.diagnosis.search.scoring import ScoringProblem, score_bank


def freed_turn(problem: ScoringProblem, finding: CauseFinding) -> CauseFinding | None:
    """The finding of turned visits with the same visits wrong by anything; None of any other finding."""
    item = finding.accepted
    if item is None or item.candidate.effect is None:
        return None
    for free in disturbed_readings(problem.view):
        turn = item.candidate
        if (free.name, free.of, free.pattern) == (turn.name, turn.of, turn.pattern):
            now = score_bank(problem, [build_bank([free], problem.view.layout, moving=False)], finding.floor)
            return replace(finding, accepted=now.accept(free, problem.view, item.hit))
    return None
