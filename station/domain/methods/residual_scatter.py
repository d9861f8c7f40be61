"""How much larger than noise explains the scatter of visits may be, given residuals: always an amount, never a pretest.

The variance σ² of a residual is n² (1 + τ²), n² its noise. χ² with ν degrees of freedom says how likely each τ is;
before it is looked at, τ is 0 with probability NONE, otherwise of any size that residuals could hide. The posterior of
ln σ² is matched by a scaled inverse χ², whose mean is the estimate and whose degrees of freedom say how well it is
known.
"""

from functools import lru_cache

import numpy as np
import scipy

from station.domain.core.types import Floats

#: Prior: no scatter at all with this probability; otherwise any τ up to the largest that residuals hide is as likely,
#: and none beyond LARGEST.
NONE, LARGEST = 0.5, 6.0
#: Residuals that chance would make so rarely speak for themselves (station.domain.methods.scatter).
CLEAR = 1e-3


def posterior(chi2: Floats, dof: Floats) -> tuple[Floats, Floats]:
    """τ² (u) in units of the noise variance, and its degrees of freedom (u); 0 and 1 where dof (u) is none."""
    ratio, nu = np.zeros(len(chi2)), np.ones(len(chi2))
    for count in np.unique(dof[dof >= 1]):
        own = dof == count
        x, square, of_square = _table(float(count))
        mean = chi2[own] / count
        at = np.log(np.maximum(mean, np.exp(x[0])))
        clear = scipy.special.chdtrc(count, chi2[own]) < CLEAR
        total = np.where(clear, np.maximum(mean, 1.0), np.exp(np.interp(at, x, square)))
        ratio[own] = np.maximum(total - 1, 0.0)
        # Var(τ²) is that of σ²: 2σ⁴/ν.
        known = np.where(clear, count, np.interp(at, x, of_square))
        nu[own] = np.maximum(known * (ratio[own] / total) ** 2, 1e-3)
    return ratio, nu


@lru_cache(maxsize=64)
def _table(dof: float) -> tuple[Floats, Floats, Floats]:
    """ln(χ²/ν), and there ln σ²/n² and its degrees of freedom."""
    x = np.concatenate([np.linspace(np.log(0.02), np.log(4), 160), np.linspace(np.log(4.05), np.log(1e4), 160)])
    tau = np.linspace(0.01, _largest_hidden(dof), 600)
    square = np.r_[1.0, 1 + tau**2]
    prior = np.r_[NONE, np.full(len(tau), (1 - NONE) / len(tau))]
    log = -dof / 2 * (np.log(square) + np.exp(x)[:, None] / square) + np.log(prior)
    p = np.exp(log - log.max(axis=1, keepdims=True))
    p /= p.sum(axis=1, keepdims=True)
    mean = p @ np.log(square)
    spread = np.maximum(p @ np.log(square) ** 2 - mean**2, 1e-6)
    nu = np.maximum(1 + 2 / spread, 2.0)
    return x, np.asarray(mean - np.log(nu / 2) + scipy.special.digamma(nu / 2)), nu


def _largest_hidden(dof: float) -> float:
    """τ whose χ², unless chance makes it rarely small, is larger than chance makes that of noise alone but rarely."""
    ratio = scipy.special.chdtri(dof, CLEAR) / scipy.special.chdtri(dof, 1 - CLEAR)
    return float(min(np.sqrt(ratio - 1), LARGEST))
