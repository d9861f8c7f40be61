"""How far the slopes of runs scatter, of which each is known with an error: drawn together as far as is likely.

Slopes are normal about a mean, each estimate of one has an error of known variance v. Few of them tell little of the
scatter: which share B = v / (v + scatter) of their own is noise is evenly likely beforehand (Daniels 1999), and the
restricted likelihood of the estimates says which are likely.
"""

from typing import NamedTuple

import numpy as np

from station.domain.core.types import Floats

#: Ends of the shares of noise that are looked at: the finer, the smaller.
ENDS = np.linspace(0.0, 1.0, 401) ** 4
SHARE, PRIOR = (ENDS[1:] + ENDS[:-1]) / 2, np.diff(ENDS)
#: So many likely ones are told apart, as far apart from each other; what is less likely than this is left out.
LIKELY, TAIL = 8, 0.005
#: Shares of noise that lie all so near to each other draw slopes together alike.
ALIKE = 0.05
#: So many runs show how their slopes scatter; fewer are taken as they are.
RUNS_TO_POOL = 4


class Scatter(NamedTuple):
    """Likely scatters from small shares of noise to large ones: variance (b) between slopes, probability (b), and the
    share of noise (b); evidence: log-likelihood of the slopes, whichever it is."""

    between: Floats
    probability: Floats
    noise: Floats
    evidence: float

    @property
    def known(self) -> bool:
        """Whether all draw slopes together alike."""
        return float(np.ptp(self.noise)) < ALIKE


#: Slopes as they are.
UNPOOLED = Scatter(np.full(LIKELY, np.inf), np.full(LIKELY, 1 / LIKELY), np.zeros(LIKELY), 0.0)


def scatter(slope: Floats, variance: Floats) -> Scatter:
    """The scatters that are likely by slopes (r) with errors of such variance (r); none of few."""
    if len(slope) < RUNS_TO_POOL or not np.all(variance > 0):
        return UNPOOLED
    usual = 1 / float(np.mean(1 / variance))
    total = variance + usual * ((1 - SHARE) / SHARE)[:, None]
    weight = 1 / total
    mean = (weight @ slope) / weight.sum(1)
    squares = np.sum(weight * (slope - mean[:, None]) ** 2, axis=1)
    nats = np.log(PRIOR) - 0.5 * (np.log(total).sum(1) + np.log(weight.sum(1)) + squares)
    odds = np.exp(nats - nats.max())
    below = np.cumsum(odds) / odds.sum()
    low, high = np.searchsorted(below, [TAIL, 1 - TAIL])
    edges = np.linspace(ENDS[low], ENDS[high + 1], LIKELY + 1)
    # Of each part its mean: parts of next to no cells have the share of their middle.
    part = np.clip(np.searchsorted(edges, SHARE, side="right") - 1, 0, LIKELY - 1)
    mass = np.bincount(part, odds, LIKELY)
    middle = (edges[1:] + edges[:-1]) / 2
    noise = np.where(mass > 0, np.bincount(part, odds * SHARE, LIKELY) / np.where(mass > 0, mass, 1.0), middle)
    return Scatter(usual * (1 - noise) / noise, mass / mass.sum(), noise, float(nats.max() + np.log(odds.sum())))


def drawn_together(precision: Floats, line: Floats, noise: float, between: float) -> tuple[Floats, Floats]:
    """Covariance (r, 2, 2), in units of noise², and means (r, 2, 1) of the runs' lines, whose slopes have a variance
    between runs. precision, line: the same of each run by itself."""
    normal = np.asarray(np.linalg.inv(precision))
    if not np.isfinite(between):
        return normal, line
    mean = float(np.average(line[:, 1, 0], weights=1 / (noise**2 * normal[:, 1, 1] + between)))
    prior = np.zeros_like(precision)
    prior[:, 1, 1] = noise**2 / between
    normal = np.asarray(np.linalg.inv(precision + prior))
    return normal, normal @ (precision @ line + prior[:, :, 1:] * mean)
