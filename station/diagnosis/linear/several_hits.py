"""Scans in which several units are hit hard at once.

The log odds of each group are those of a hit of it alone, in the sum of squares that all others leave in: of two units
that jump alike each explains half of it, 0.35 nats a number, however far the jumps stand above the noise. So the
hardest hit is taken off first and the others are judged in what is left: the likelihood ratios of all steps multiply
to that of all hits together, as units share no rows.
"""

import numpy as np

from station.diagnosis.linear.evidence import MAX_EXPLAINED_SHARE, DataSets, EigenSpectrum, log_mean_exp
from station.domain.core.types import Floats

#: Log odds from which a hit is taken off: of fewer what it hides of others is next to nothing, and noise has no such.
HARD_NATS = 10.0
#: Units whose hits are taken off at most, and numbers of a candidate beyond which none are.
MOST_UNITS, MOST_NUMBERS = 32, 1 << 18


def spread_of_hits(can: EigenSpectrum, u: Floats, sets: DataSets, odds: Floats) -> Floats:
    """Log-likelihood (b, 1, shares) of scans of readings with components u (b, 1, U, G, K) and log odds (b, 1, U, G)
    of each group alone, if such a share of the groups is hit."""
    found = can.spread(odds)
    if can.size.copies > 1 or can.m.shape[1] < 2 or can.m[0].size * can.rho.shape[-1] > MOST_NUMBERS:
        return found
    for i in np.flatnonzero(odds.max(axis=(1, 2, 3)) > HARD_NATS).tolist():
        found[i, 0] = can.spread(_one_after_another(can.of(i), u[i, 0], float(sets.rest[0]))[None])[0]
    return found


def _one_after_another(can: EigenSpectrum, u: Floats, rest: float) -> Floats:
    """Log odds (U, G) of each group of one scan, the hardest hit units' first, each in what those before leave."""
    drop, logdet = (u**2)[..., None, :] @ can.weight, can.logdet
    most, found, left = drop[..., 0, -1], np.zeros(u.shape[:2]), np.ones(len(u), bool)
    for _ in range(MOST_UNITS):
        share = np.minimum(drop[left, :, 0] / rest, MAX_EXPLAINED_SHARE)
        found[left] = log_mean_exp(-0.5 * can.size.dof * np.log1p(-share) - 0.5 * logdet[left])
        best = np.where(left, found.max(axis=1), -np.inf)
        unit = int(best.argmax())
        if best[unit] < HARD_NATS or left.sum() == 1:
            break
        taken = float(most[unit, int(found[unit].argmax())])
        left[unit], rest = False, max(rest - taken, (1 - MAX_EXPLAINED_SHARE) * rest)
    return found
