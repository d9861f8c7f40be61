"""How a bench warms after power-on: one exponential, alike in all runs of all units.

T = a level of each run + H · (1 − e^(−p/τ)) + f + noise, p since power-on, f the integrated Wiener process of
`temperature_course.py`, which bends as much anywhere in a run and so flattens what bends at its beginning. f begins
with a slope that is as large as those it comes to. All runs together tell H and τ; one τ and one H are taken where
restricted likelihood gains by more than two numbers and the choice of one cost.
"""

from typing import NamedTuple

import numpy as np

from station.domain.core.types import Floats

#: Time constants tried, as shares of the longest run, and what they must gain, nats.
TAU_SHARES = np.geomspace(0.05, 3.0, 13)
LEAST_GAIN_NATS = 6.0
#: A visit so many time constants after power-on is as warm as it will be.
MOST_TIME_CONSTANTS = 50.0


class Heating(NamedTuple):
    """By how much a bench warms, degC, with which time constant, s."""

    size_degC: float
    tau_s: float

    def value(self, since_s: Floats) -> Floats:
        """How warm it is, degC, so long after power-on (n)."""
        return np.asarray(-self.size_degC * _left(since_s, self.tau_s))

    def slope(self, since_s: Floats) -> Floats:
        """How fast it warms, degC/s."""
        return np.asarray(self.size_degC / self.tau_s * _left(since_s, self.tau_s))


#: A bench that does not warm.
COLD = Heating(0.0, 1.0)


def bench_heating(
    since_s: Floats, temperature_degC: Floats, covariance: Floats, ratios: Floats, longest_s: float
) -> Heating:
    """How the bench warms by runs (r, n) at times since power-on (r, n), at the best of some stiffnesses; covariance
    (r, n, n): of f, where that is 1."""
    n = since_s.shape[1]
    # Across the level f has the same axes at every stiffness, and is independent along them.
    within = np.linalg.qr(np.ones((n, 1)), mode="complete")[0][:, 1:]
    variance, vectors = np.linalg.eigh(within.T @ covariance @ within)
    axes = (within @ vectors).swapaxes(-1, -2)
    weight = 1 / (1 + ratios[:, None] * np.maximum(variance, 0.0).ravel())
    read = (axes @ temperature_degC[..., None]).ravel()
    squares, logdet = weight @ read**2, -np.log(weight).sum(1)
    least = float(np.max(_nats(squares, logdet, read.size))) + LEAST_GAIN_NATS
    taus_s = TAU_SHARES * longest_s
    curves = (axes @ -_left(since_s, taus_s[:, None, None])[..., None]).reshape(len(taus_s), -1)
    # (stiffness, τ).
    normal, toward = weight @ (curves**2).T, weight @ (curves * read).T
    size = np.divide(toward, normal, out=np.zeros_like(normal), where=normal > 0)
    nats = _nats(squares[:, None] - size * toward, logdet[:, None], read.size)
    at = np.unravel_index(nats.argmax(), nats.shape)
    return Heating(float(size[at]), float(taus_s[at[1]])) if nats[at] > least else COLD


def _nats(squares: Floats, logdet: Floats, free: int) -> Floats:
    return np.asarray(-0.5 * (logdet + free * np.log(np.maximum(squares / free, 1e-24))))


def _left(since_s: Floats, tau_s: Floats | float) -> Floats:
    """The share of the warming that is still to come."""
    return np.asarray(np.exp(-np.minimum(since_s / tau_s, MOST_TIME_CONSTANTS)))
