"""A healthy floor as the rival of what alarms: each axis scatters and wanders by its own size.

Real sensors have one axis that wanders further than the others beside the same noise of its samples. What all axes have
in common is the simpler floor, and strongest: only where an alarm asks for it, and where no cause or kernel explains as
much as own sizes do, is the search begun again in a floor that has them.
"""

from dataclasses import replace

from station.diagnosis.linear.axis_sizes import own_sizes
from station.diagnosis.search.scoring import ScoringProblem
from station.diagnosis.search.search_state import CauseSearch, NullFactory

#: What the four sizes of three axes, beside those in common, cost in nats.
OCCAM_NATS = 4.0


def search_in_floor(problem: ScoringProblem, null_of: NullFactory) -> CauseSearch:
    """The search for causes in the floor of a problem, or in one whose axes have their own sizes."""
    search = CauseSearch(problem, null_of)
    if not search.first.alarms:
        return search
    wanted = OCCAM_NATS + max(search.first.evidence.values(), default=0.0)
    sizes = own_sizes(problem.fit(), problem.known, problem.readings(moving=False), problem.upper, wanted)
    if sizes is None:
        return search
    # Under the floor that is best with it a cause explains more than under that which has swallowed a part of it.
    ranks = search.ranks(search.first, [])
    if sizes.gain <= OCCAM_NATS + max((r.evidence for r in ranks.values()), default=0.0):
        return search
    return CauseSearch(replace(problem, setting=replace(problem.setting, structure=sizes.structure)), null_of)
