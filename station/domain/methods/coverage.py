"""What U means, everywhere: U = k·u, k Student's quantile of the effective degrees of freedom (JCGM 100, annex G)."""

import numpy as np
import scipy

from station.domain.core.types import Floats

#: Coverage probability of every expanded uncertainty.
PROBABILITY = 0.95
#: More degrees of freedom than this change no digit.
MANY = 1e6
#: The same quantile of the normal distribution, Φ⁻¹(0.975); a number, since scipy takes a quarter of a second to load.
NORMAL = 1.959963984540054


def factor(dof: Floats) -> Floats:
    """k of an interval that holds PROBABILITY, for effective degrees of freedom (…)."""
    return quantile(dof, (1 + PROBABILITY) / 2)


def quantile(dof: Floats, probability: float) -> Floats:
    """Student's one-sided quantile for degrees of freedom (…)."""
    return np.asarray(scipy.special.stdtrit(np.clip(dof, 1.0, MANY), probability))


def effective_dof(total: Floats, parts: list[tuple[Floats, Floats]]) -> Floats:
    """Welch–Satterthwaite (JCGM 100, eq. G.2b) of a variance (…) whose parts, variance and degrees of freedom (…)
    each, are estimates; what is not among the parts is known."""
    spread = sum((part**2 / np.maximum(dof, 1e-3) for part, dof in parts), np.zeros_like(total))
    return np.asarray(np.minimum(total**2 / np.maximum(spread, 1e-300), MANY))
