"""Log evidence of a few coefficients whose amplitude nobody knows, from the share of the sum of squares they take up.

Under Zellner's prior c ~ N(0, q σ² (ZᵀZ)⁻¹) with σ profiled,

    L(q) = −½ K·log(1 + q) − ½ n·log(1 − q/(1 + q)·share)

and the evidence is the log of the mean of e^L over the diagnosis' own logarithmic grid of q (Liang et al., J. Am. Stat.
Assoc. 103 (2008) 410, mixtures of g priors). It depends on the data by the share alone, so that thousands of terms are
judged by one product of matrices and a table.
"""

from functools import lru_cache

import numpy as np

from station.diagnosis.linear.evidence import AMPLITUDE_RATIOS, MAX_EXPLAINED_SHARE, log_mean_exp
from station.domain.core.types import Floats

#: Shares that the table holds: dense where the evidence bends.
_SHARES = 1 - np.concatenate([np.linspace(1.0, 0.02, 1200), np.geomspace(0.0199, 1e-9, 800)])


def log_evidence(share: Floats, coefficients: int, dof: int) -> Floats:
    """Log evidence of shares (…) of the sum of squares that so many coefficients take up, of dof numbers."""
    return np.interp(share, _SHARES, _table(coefficients, dof))


@lru_cache(maxsize=256)
def _table(coefficients: int, dof: int) -> Floats:
    q = AMPLITUDE_RATIOS[::2]
    taken = np.minimum(_SHARES, MAX_EXPLAINED_SHARE)[:, None] * q / (1 + q)
    # What is fitted to n numbers leaves n − K of them: a share of K/n is what noise makes.
    return log_mean_exp(-0.5 * coefficients * np.log1p(q) - 0.5 * dof * np.log1p(-taken))
