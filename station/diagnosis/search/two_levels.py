"""Whether what scatters along one direction has two levels, as a state does that comes and goes, or any size, as where
the supply, the room or the table moves all axes of a healthy sensor together.

Two levels in the noise, by expectation and maximisation, are held against one normal spread of any size.
"""

import numpy as np

from station.domain.core.types import Floats

#: Shares of the parts that lie below the cut where the search for two levels begins, and rounds of it.
CUTS, ROUNDS = (0.5, 0.2, 0.8), 25
#: Log odds of a level beyond which a part is sure to have it.
SURE = 50.0


def levels_ahead(parts: Floats, noise: float) -> float:
    """By how many nats two levels in noise of one size follow the parts (n) better than a normal spread does."""
    z = parts / max(noise, 1e-300)
    spread = -0.5 * len(z) * (1.0 + float(np.log(max(float(np.var(z)), 1e-300))))
    return max(_likelihood(z, float(np.quantile(z, share))) for share in CUTS) - spread


def _likelihood(z: Floats, cut: float) -> float:
    """Log-likelihood of parts (n) in units of their noise at two levels, found from those below and above a cut."""
    upper = (z > cut).astype(float)
    levels, share = np.zeros((2, len(z))), 0.5
    for _ in range(ROUNDS):
        weights = np.stack([1 - upper, upper])
        middle = weights @ z / np.maximum(weights.sum(1), 1e-9)
        share = float(np.clip(upper.mean(), 0.5 / len(z), 1 - 0.5 / len(z)))
        levels = np.log([[1 - share], [share]]) - 0.5 * (z - middle[:, None]) ** 2
        upper = 1 / (1 + np.exp(np.clip(levels[0] - levels[1], -SURE, SURE)))
    return float(np.logaddexp(*levels).sum())
