"""One stream watched for a change whose size nobody knows, with a stated bound on false alarms.

Each value becomes its rank among all before it, as a share (ranks.py): uniform and independent, whatever the
distribution. From these a mixture of Shiryaev-Roberts statistics is made (e-detectors: Shin, Ramdas, Rinaldo,
NEJSDS 2024).
"""

from collections.abc import Sequence

import numpy as np
import scipy

from station.domain.core.types import Floats

#: Shifts in standard deviations that the mixture expects, each up and down; and what each counts: a large shift
#: overshoots a limit by more, so it may count more for as many false alarms (ShiftDetector).
_SIZES, _WEIGHTS = (0.35, 0.8, 1.8, 3.2), (0.09, 0.115, 0.18, 0.34)
SHIFTS = np.array([s * size for size in _SIZES for s in (1, -1)])
WEIGHTS = np.repeat(_WEIGHTS, 2)
#: Values learnt before the first test.
LEARN = 30
#: A shift is one of Student's t: units scatter with heavier tails than the normal distribution's.
_FREEDOM = 8


def likelihood_ratios(shares: Sequence[float]) -> Floats:
    """(n, shifts): for values whose ranks are these shares (n), Student's density of the quantile less the shift over
    that of the quantile. The mean over all shares is 1."""
    quantile = scipy.special.stdtrit(_FREEDOM, np.asarray(shares, float))[:, None]
    shifted = quantile - SHIFTS / np.sqrt((_FREEDOM - 2) / _FREEDOM)
    ratios = ((_FREEDOM + quantile**2) / (_FREEDOM + shifted**2)) ** ((_FREEDOM + 1) / 2)
    return np.asarray(ratios)


class ShiftDetector:
    """The mixture of Shiryaev-Roberts statistics of uniform shares.

    Each statistic is the sum over beginnings of the likelihood ratio since then. A change of measure to these
    beginnings therefore gives the mean number of shares to an alarm at h: h / Σ w ζ, with ζ the mean of h over the
    evidence at an alarm that the shift itself raises (1 if nothing overshot). Σ w ζ is 0.6 at every h, at most 0.67
    below 100, whatever the values are: their ranks are uniform. So an alarm comes once in 1.6 h shares.

    From any state it comes no later than from none, for the evidence grows with itself: within n shares at most n/h
    alarms are expected (Barlow and Proschan 1975, chapter 6: renewals new better than used).
    """

    def __init__(self) -> None:
        self._statistics = np.zeros(len(SHIFTS))
        self.evidence = 0.0

    def add(self, ratios: Floats) -> None:
        """R ← (1 + R) · likelihood ratio for each shift (shifts)."""
        self._statistics = (1 + self._statistics) * ratios
        self.evidence = float(WEIGHTS @ self._statistics)

    def restart(self) -> None:
        """Forgets all evidence."""
        self._statistics, self.evidence = np.zeros(len(SHIFTS)), 0.0
