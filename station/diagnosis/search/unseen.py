"""What no column of the bank shows, judged by its own distribution in what the floor leaves white."""

from typing import NamedTuple

import numpy as np

from station.diagnosis.search.alarm import UNKNOWN_NATS

#: A chance below this is none: doubles have no smaller ones that add up.
LEAST_CHANCE = 1e-300


class Unseen(NamedTuple):
    """Log evidence, and −log₁₀ p where that is enough to be named."""

    nats: float
    surprise: float

    @staticmethod
    def of(nats: float, chance: float) -> "Unseen":
        """Of a log evidence and how often noise explains as much."""
        p = float(np.clip(chance, LEAST_CHANCE, 1.0))
        return Unseen(nats, -float(np.log10(p)) if nats >= UNKNOWN_NATS else 0.0)


NOTHING = Unseen(-np.inf, 0.0)
