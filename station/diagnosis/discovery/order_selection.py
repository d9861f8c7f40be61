"""Whether a rest holds anything along directions that are finer and finer.

Most laws that another form follows differ from it by something smooth: a test that spends itself evenly on all
directions hardly sees it. Here as many of the first are taken as speak loudest, and chance is that of the choice
(Eubank & Hart, Ann. Stat. 20 (1992) 1412): of squares z² of unit variance the statistic is the largest
(z₁² + … + z_m²)/m, and

    P(max ≥ c) = 1 − exp(−Σ_m P(χ²_m > m·c)/m)
"""

import numpy as np
import scipy

from station.diagnosis.linear.projection import ResidualSpace
from station.domain.core.types import Floats

#: A direction that keeps less than this share of its squared length beside what is known and the coarser ones is lost.
SEEN_SHARE = 1e-3


def order_chance(along: Floats) -> float:
    """The chance that standard normal numbers (m), the coarsest direction's first, are as large as they are."""
    orders = np.arange(1, len(along) + 1)
    largest = float(np.max(np.cumsum(along**2) / orders))
    return -float(np.expm1(-np.sum(scipy.special.chdtrc(orders, orders * largest) / orders)))


def along_directions(columns: Floats, fitted: int, space: ResidualSpace) -> Floats:
    """What the rest has along white columns (U·M, c), each freed of what is known and of those before it, with unit
    variance: none of those that are lost, nor of the first so many, along which the rest was fitted."""
    known = space.shared_basis.reshape(space.residual.size, -1).T @ columns
    whole = columns.T @ columns
    normal, right = whole - known.T @ known, columns.T @ space.residual.ravel()
    kept: list[int] = []
    found: list[float] = []
    for at, length in enumerate(np.diag(whole)):
        before = normal[np.ix_(kept, kept)]
        share = np.linalg.solve(before, normal[kept, at])
        left = float(normal[at, at] - normal[kept, at] @ share)
        if left > SEEN_SHARE * length:
            if at >= fitted:
                found.append(float(right[at] - right[kept] @ share) / float(np.sqrt(left)))
            kept.append(at)
    return np.array(found)
