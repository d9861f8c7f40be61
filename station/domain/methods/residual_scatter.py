"""How much larger than noise the scatter of visits is, given residuals, and how well that is known.

χ²/ν of residuals with ν degrees of freedom is the squared Birge ratio (Birge 1932, Phys. Rev. 40, 207): their variance
in units of the stated one. Above 1 it widens the uncertainty, with Student's t of ν degrees of freedom (Bodnar & Elster
2014, Metrologia 51, 516); below 1 it counts as 1, because the dwells show the noise, and nothing is better than that.

What residuals of earlier units came to is heard like further degrees of freedom (the moderated t of Smyth 2004, Stat.
Appl. Genet. Mol. Biol. 3, 3): units are drawn from a scaled inverse χ², whose variance and degrees of freedom the
moments of ln(χ²/ν) give.
"""

from collections.abc import Sequence

import numpy as np
import scipy

from station.domain.core.types import Floats

#: Earlier units are not heard where chance would make this unit's residuals so much larger than theirs this rarely.
CONTRADICTS = 1e-3
#: Variance ratio and degrees of freedom where nothing is known of earlier units.
NOTHING_KNOWN = (1.0, 0.0)
#: Newton steps on the trigamma function, which is convex and falls.
STEPS = 50


def excess(ratio: Floats, dof: Floats, usual: tuple[float, float] = NOTHING_KNOWN) -> tuple[Floats, Floats]:
    """Variance (u) of the scatter in units of the noise variance, and its degrees of freedom (u); 0 and 1 where there
    are no residuals. ratio, dof (u): χ²/ν and ν of each unit; usual: the same of earlier units (`usual_residuals`)."""
    known, own = dof >= 1, np.maximum(dof, 1.0)
    before, weight = usual
    contradicts = scipy.special.fdtrc(own, max(weight, 1e-3), ratio / before) < CONTRADICTS
    heard = np.where(contradicts, 0.0, weight)
    nu = own + heard
    over = np.maximum((own * ratio + heard * before) / nu - 1, 0.0)
    # Var(τ²) is that of σ²: 2σ⁴/ν.
    tau_dof = np.maximum(nu * (over / (1 + over)) ** 2, 1e-3)
    return np.where(known, over, 0.0), np.where(known, tau_dof, 1.0)


def usual_residuals(residuals: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The usual variance ratio and its degrees of freedom, of earlier units' (χ²/ν, ν); no more than theirs
    in all, and a ratio no better than noise makes."""
    ratio, dof = np.array(residuals, float).T
    half = dof / 2
    log = np.log(np.maximum(ratio, 1e-12)) - scipy.special.digamma(half) + np.log(half)
    apart = float(log.var(ddof=1) - scipy.special.polygamma(1, half).mean())
    most = float(dof.sum())
    weight = most if apart <= 0 else min(2 * _inverse_trigamma(apart), most)
    found = np.exp(log.mean() + scipy.special.digamma(weight / 2) - np.log(weight / 2))
    return max(float(found), 1.0), weight


def _inverse_trigamma(value: float) -> float:
    """x with ψ′(x) = value, by Newton's steps on 1/ψ′, which is nearly straight."""
    x = 0.5 + 1 / value
    for _ in range(STEPS):
        now = float(scipy.special.polygamma(1, x))
        step = now * (1 - now / value) / float(scipy.special.polygamma(2, x))
        x += step
        if abs(step) < 1e-12 * x:
            break
    return x
