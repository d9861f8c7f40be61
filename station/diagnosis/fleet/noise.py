"""The natural spread of units: the covariance of their responses within a group, from a sample of the fleet."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, betaln, chdtri

from station.domain.core.types import Floats

#: Units further off than this share of normal ones are no measure of the noise; the rest's covariance is corrected.
_KEPT_SHARE = 0.99
_ROUNDS = 3
#: Directions quieter than this share of the loudest have no noise of their own to be measured by.
_QUIETEST = 1e-9
#: A unit counts as if it were no further off than this many times what is usual.
_MOST_DISTANCE = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class ResponseNoise:
    """whiten (r, d): to r independent numbers of variance one; middle (r): of the sample, so whitened; freedom: of the
    covariance that says so."""

    middle: Floats
    whiten: Floats
    freedom: int

    def whitened(self, responses: Floats) -> Floats:
        """Responses (U, d) as (U, r)."""
        return np.asarray(responses @ self.whiten.T - self.middle)

    def log_chance(self, test: float, rank: int) -> float:
        """Logarithm of the probability that `rank` directions gain so much (twice the log likelihood) by chance.

        Hotelling's T², as the noise is known from so many units only (Rao 1973, 8b); its leading term where the
        probability is no number any more.
        """
        a, b = max(self.freedom - len(self.whiten) + 1, 2) / 2, rank / 2
        x = self.freedom / (self.freedom + test)
        found = float(betainc(a, b, x))
        return float(np.log(found)) if found > 0 else float(a * np.log(x) - np.log(a) - betaln(a, b))


def winsorised(z: Floats, most: float = _MOST_DISTANCE) -> Floats:
    """Whitened responses (U, r), limited for a unit far from all others, so that it cannot speak for a group. most:
    times what is usual."""
    far = np.linalg.norm(z, axis=1, keepdims=True) / np.sqrt(z.shape[1])
    return np.asarray(z / np.maximum(far / most, 1.0))


def response_noise(responses: Floats, groups: Sequence[object]) -> ResponseNoise:
    """From responses (U, d) of a sample; groups: what each unit shares with others, whose means are taken off."""
    code = np.unique([repr(group) for group in groups], return_inverse=True)[1]
    count = np.bincount(code)
    means = np.stack([np.bincount(code, column) for column in responses.T], axis=1) / count[:, None]
    # A group of n has lost 1/n of its variance to its mean.
    apart = (responses - means[code]) / np.sqrt(np.maximum(1 - 1 / count, 1e-9))[code][:, None]
    apart = apart[count[code] > 1]
    inside = np.ones(len(apart), bool)
    whiten = np.eye(responses.shape[1])
    for _ in range(_ROUNDS):
        value, vector = np.linalg.eigh(np.cov(apart[inside].T))
        loud = value > _QUIETEST * value[-1]
        whiten = (vector[:, loud] / np.sqrt(value[loud])).T
        limit = chdtri(len(whiten), 1 - _KEPT_SHARE)
        distance = ((apart @ whiten.T) ** 2).sum(axis=1)
        inside = distance <= limit * np.median(distance) / chdtri(len(whiten), 0.5)
    whiten = _as_summed(apart, whiten)
    # Medians of the responses themselves would not hang together as their quiet directions do.
    freedom = len(apart) - int((count > 1).sum())
    return ResponseNoise(np.median(responses @ whiten.T, axis=0), whiten, freedom)


def _as_summed(apart: Floats, whiten: Floats) -> Floats:
    """Scales responses (U, d), winsorised as the search sums them, to variance one in every direction (Huber 1981,
    chapter 8): heavy-tailed units still scatter more after winsorising than those that were kept."""
    for _ in range(_ROUNDS):
        value, vector = np.linalg.eigh(np.cov(winsorised(apart @ whiten.T).T))
        whiten = (vector / np.sqrt(np.maximum(value, 1.0))).T @ whiten
    return np.asarray(whiten)
