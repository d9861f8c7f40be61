"""A healthy floor as the rival of what alarms: each axis scatters and wanders by its own size, or all together.

Real sensors have one axis that wanders further than the others beside the same noise of its samples, and axes that
share what moves their means (the supply, the room, the table) while their samples share nothing. A floor in which no
axis differs, and none goes with another, is the simpler one: only where an alarm asks for it, and where no cause or
kernel explains as much, is the search begun again in one that has sizes of its own, or axes that share.
"""

from dataclasses import replace

from station.diagnosis.candidates.kernels import STATE
from station.diagnosis.linear.axis_sizes import AxisSizes, own_sizes
from station.diagnosis.search.alarm import UNKNOWN_NATS
from station.diagnosis.search.extent import ranks_in_extent
from station.diagnosis.search.hidden_state import has_levels
from station.diagnosis.search.problem import sharing_scatter
from station.diagnosis.search.rank import RankedCause
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.search_state import CauseSearch, NullFactory

#: What the four sizes of three axes, beside those in common, and what three pairs of axes share cost in nats.
SIZES_NATS, SHARED_NATS = 4.0, 3.0


def search_in_floor(problem: ScoringProblem, null_of: NullFactory) -> CauseSearch:
    """The search for causes in the floor of a problem, or in one that is each axis' own, or all axes' together."""
    search = CauseSearch(problem, null_of)
    if not search.first.alarms:
        return search
    evidence = search.first.evidence
    explained = max(evidence.values(), default=0.0)
    floor, gain = problem, 0.0
    shared = sharing_scatter(problem)
    # A unit that jumps to and fro moves its axes together, too, but between two levels.
    jumps = evidence.get(STATE, 0.0) >= UNKNOWN_NATS and has_levels(problem, problem.fit().floor)
    if shared is not None and shared[1] > SHARED_NATS and not jumps:
        floor, gain = shared[0], shared[1] - SHARED_NATS
    readings = floor.readings(moving=False)
    sizes = own_sizes(floor.fit(), floor.known, readings, floor.upper, SIZES_NATS + max(explained - gain, 0.0))
    if sizes is not None:
        floor = in_floor(floor, sizes)
        gain += sizes.gain - SIZES_NATS
    if gain <= explained:
        return search
    # Under the floor that is best with it a cause explains more than under that which has swallowed a part of it, and
    # what acts on one axis alone more than where it pays for all of them: an axis with sizes of its own pays for none.
    state = search.first
    ranks = search.ranks(state, [])
    ranks = ranks_in_extent(problem, [s.bank for s in state.now.projected], ranks, state.now.floor)
    leader = max(ranks.values(), key=lambda r: r.evidence, default=None)
    if leader is not None and gain <= leader.evidence:
        return search
    beside = None if leader is None else _beside(problem, leader, gain)
    return CauseSearch(floor if beside is None else beside, null_of)


def _beside(problem: ScoringProblem, leader: RankedCause, gain: float) -> ScoringProblem | None:
    """The problem in a floor of which each axis has the sizes that it has beside what leads; None where both together
    explain no more than a floor without it does, by its gain."""
    if leader.best is None or leader.evidence < UNKNOWN_NATS:
        return None
    with_it = problem.with_accepted((*problem.accepted, leader.at.accept(leader.best, problem.view)))
    readings = with_it.readings(moving=False)
    wanted = gain + UNKNOWN_NATS + SIZES_NATS - leader.evidence
    sizes = own_sizes(with_it.fit(leader.at.floor), with_it.known, readings, problem.upper, wanted)
    return None if sizes is None else in_floor(problem, sizes)


def in_floor(problem: ScoringProblem, sizes: AxisSizes) -> ScoringProblem:
    """The problem in a floor of which each axis has its own sizes."""
    return replace(problem, setting=replace(problem.setting, structure=sizes.structure))
