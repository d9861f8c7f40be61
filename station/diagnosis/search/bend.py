"""What a cause at work explains beyond its columns.

Causes are ranked by the derivatives of the simulation, in which every size is exact only while it is small: a turn of
.05 rad differs from them by the half of its square, which stands far above the noise. A kernel, or a law whose
coefficients the readings choose freely, pays nothing for that.
"""

from dataclasses import replace

import numpy as np

from station.diagnosis.candidates.nuisance import AcceptedCause
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.scoring import ScoringProblem


def bend_nats(known: ScoringProblem, bare: ScoringProblem, item: AcceptedCause, floor: NoiseFloor) -> float:
    """By how many nats a cause is likelier at work, as in the problem where it is known, than by its columns beside
    what is known in a bare one; 0 of a kernel. floor: near which the latter's is."""
    if item.candidate.effect is None:
        return 0.0
    straight = replace(item.in_view(bare.view), coefficient=np.zeros(item.coefficient.shape))
    by_columns, now = bare.with_accepted((*bare.accepted, straight)), known.fit()
    # From either floor: what a worse one of two leaves is no bend.
    return max(now.space.profile - max(by_columns.fit(f).space.profile for f in (floor, now.floor)), 0.0)
