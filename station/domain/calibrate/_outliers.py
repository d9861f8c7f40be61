"""Which stop does not fit with the others: deletion tests at a level held for the whole unit."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc

from station.domain.types import Floats

#: Probability that a unit without any disturbance loses a stop.
LEVEL = 1e-3
#: A stop is named only if leaving it out explains this much more than leaving out any other: χ²₁ at LEVEL.
CLEARLY = 10.8
#: Leverage above which the others say nothing about a stop.
ALONE = 1 - 1e-6


def worst(residual: Floats, leverage: Floats, variance: Floats, keep: Floats, parameters: int) -> NDArray[np.bool_]:
    """Marks, in each unit, the stop to leave out, if any: (u, v).

    residual, leverage, variance (u, v, a) of a readings a stop; keep (u, v) 0 or 1. The drop in χ² when a stop is
    left out is measured against noise where the rest agrees with noise, against the rest's own scatter otherwise
    (externally studentised residual, Cook & Weisberg 1982, eq. 2.2.8): a rig with loose poses loses no stop for it.
    """
    a = residual.shape[2]
    told = (leverage < ALONE).all(axis=2) & (keep > 0)
    drop = (residual**2 / (variance * np.maximum(1 - leverage, 1 - ALONE))).sum(axis=2) * told
    chi2 = (keep[..., None] * residual**2 / variance).sum(axis=(1, 2))
    left = a * keep.sum(axis=1) - parameters - a
    rest = np.maximum(chi2 - drop.max(axis=1), 0.0)
    scatter = rest / np.maximum(left, 1)
    p = np.where(
        chdtrc(np.maximum(left, 1), rest) > LEVEL,
        chdtrc(a, drop.max(axis=1)),
        fdtrc(a, np.maximum(left, 1), drop.max(axis=1) / a / np.maximum(scatter, 1e-300)),
    )
    ranked = np.sort(drop, axis=1)
    clear = ranked[:, -1] - ranked[:, -2] > CLEARLY * np.maximum(scatter, 1.0) if drop.shape[1] > 1 else False
    found = (p * keep.sum(axis=1) < LEVEL) & clear & (left >= a)
    return np.asarray(found[:, None] & (np.arange(drop.shape[1]) == drop.argmax(axis=1)[:, None]))
