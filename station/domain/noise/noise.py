"""Standard error of the mean of autocorrelated noise, learnt from the dwells themselves.

A dwell's mean is the zeroth coefficient of its orthonormal cosine transform (DCT-II) over √n; the other n − 1 do
not know the mean. So the noise is learnt from those: each is nearly independent with a variance that follows
exactly from an autocovariance (the debiased Whittle likelihood, Sykulski et al. 2019, Biometrika 106, eq. 7–8, on
cosine instead of Fourier coefficients, which leak less where neighbours are alike). The family of shapes is averaged by
its posterior: first-order noise (Jeffreys' prior 1/√(1 − φ²), pool of all dwells of one unit and axis), white noise
on top of slow noise, white on flicker, a two-pole and a boxcar filter. No shape is picked, so no pretest spoils
the intervals.
"""

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import scipy

from station.domain.core.types import Floats

#: Longer dwells are cut into this many blocks at most; slow noise needs no more.
MAX_BLOCKS = 128
#: Prior weight of each kind of shape against first-order noise.
MIXED, FLICKER, TWO_POLE, BOXCAR = 0.005, 0.002, 0.005, 0.005
SLOW_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8)
FLICKER_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
BOXCARS = (2, 3, 4, 6, 8, 12, 16)


@dataclass(frozen=True, slots=True, eq=False)
class NoiseFamily:
    """Shapes (s) for dwells of n blocks of `width` steps each, of unit variance a step.

    transform (n, n): the cosine transform; inverse (n, s): one over the expected squares of its coefficients, 0
    for the mean; log_det (s): sum of their logarithms; mean_variance (s): variance of the mean of the dwell;
    log_prior (s).
    """

    transform: Floats
    inverse: Floats
    log_det: Floats
    mean_variance: Floats
    log_prior: Floats


@dataclass(frozen=True, slots=True)
class BlockCut:
    """How a dwell is cut: `blocks` blocks of `width` steps of `step` samples each."""

    blocks: int
    width: int
    step: int

    @property
    def samples(self) -> int:
        """Samples in one block."""
        return self.width * self.step


def step_of(longest: int) -> int:
    """Samples that are one step in dwells of up to `longest` samples: all dwells of a unit share it."""
    return -(-longest // (8 * MAX_BLOCKS))


def cut(count: int, step: int) -> BlockCut:
    """Cuts a dwell of `count` samples into at most LONGEST equal blocks; what is left over is left out."""
    steps = max(count // step, 1)
    width = -(-steps // MAX_BLOCKS)
    return BlockCut(steps // width, width, step)


def reach_of(longest: int) -> int:
    """The reach, in steps, of slow noise looked for in dwells of up to `longest` samples: a power of two."""
    return 1 << max(3, (max(longest // step_of(longest), 1) - 1).bit_length())


@lru_cache(maxsize=512)
def family(blocks: int, width: int, reach: int) -> NoiseFamily:
    """The family for dwells of blocks · width steps; correlation lengths up to reach / 2 steps."""
    # Dwells that end when they are good enough have all lengths: what does not depend on the length is made once.
    longest = max(reach, blocks * width)
    autocovariance, prior = _shapes(longest, reach)
    coarse = _of_blocks(autocovariance[:, : blocks * width], blocks, width)
    expected = coarse @ _lag_weights(blocks).T
    inverse = np.zeros((blocks, len(prior)))
    inverse[1:] = 1 / expected[:, 1:].T
    return NoiseFamily(
        _transform(blocks), inverse, np.log(expected[:, 1:]).sum(axis=1), expected[:, 0] / blocks, np.log(prior)
    )


@cache
def _transform(n: int) -> Floats:
    """The orthonormal cosine transform (n, n), DCT-II."""
    return np.asarray(scipy.fft.dct(np.eye(n), axis=0, norm="ortho", type=2))


@cache
def _lag_weights(n: int) -> Floats:
    """Weights (n, n): expected square of coefficient j = Σ_k weight[j, k] · autocovariance[k]."""
    C = _transform(n)
    W = scipy.fft.irfft(np.abs(scipy.fft.rfft(C, 2 * n, axis=1)) ** 2, 2 * n, axis=1)[:, :n]
    W[:, 1:] *= 2
    return np.asarray(W)


def _of_blocks(autocovariance: Floats, blocks: int, width: int) -> Floats:
    """Autocovariance (s, blocks) of means of `width` neighbours, from that of steps (s, blocks · width)."""
    if width == 1:
        return autocovariance
    lag = np.arange(1 - width, width)
    triangle = (width - np.abs(lag)) / width**2
    at = np.abs(np.arange(blocks)[:, None] * width + lag)
    inside = at < autocovariance.shape[1]
    return np.asarray((autocovariance[:, np.where(inside, at, 0)] * (triangle * inside)).sum(axis=2))


@lru_cache(maxsize=16)
def _shapes(n: int, reach: int) -> tuple[Floats, Floats]:
    """Autocovariances (s, n) of unit variance, and their prior weights (s)."""
    k = np.arange(n)
    white = (k == 0).astype(float)
    top = 0.5 * np.log(reach)
    phi = np.tanh(np.arange(-1.0, top, 0.06))
    first_order = np.where(k == 0, 1.0, phi[:, None] ** np.maximum(k, 1))
    slow = np.tanh(np.arange(0.7, top, 0.3))[:, None] ** k
    mixed = np.concatenate([a * slow + (1 - a) * white for a in SLOW_SHARES])
    times = 2.0 ** np.arange(-1.0, np.log2(20 * reach / (2 * np.pi)))
    one_over_f = np.exp(-k / times[:, None]).mean(axis=0)
    flicker = np.array([a * one_over_f + (1 - a) * white for a in FLICKER_SHARES])
    pole = np.tanh(np.arange(0.1, max(top - 0.2, 0.2), 0.12))[:, None]
    two_pole = (1 + k * (1 - pole**2) / (1 + pole**2)) * pole**k
    boxcar = np.array([np.maximum(1 - k / w, 0.0) for w in BOXCARS if 2 * w <= reach])
    jeffreys = np.sqrt(1 - phi**2)
    prior = [
        jeffreys / jeffreys.sum(),
        *(np.full(len(kind), weight / len(kind)) for kind, weight in _weighted(mixed, flicker, two_pole, boxcar)),
    ]
    return np.concatenate([first_order, mixed, flicker, two_pole, boxcar]), np.concatenate(prior)


def _weighted(mixed: Floats, flicker: Floats, two_pole: Floats, boxcar: Floats) -> list[tuple[Floats, float]]:
    return [(mixed, MIXED), (flicker, FLICKER), (two_pole, TWO_POLE), (boxcar, BOXCAR)]


def posterior(misfit: Floats, dof: Floats, log_det: Floats, log_prior: Floats) -> tuple[Floats, Floats]:
    """Posterior weights (u, 3, s) of the shapes and the sample variance under each (u, 3, s).

    misfit (u, 3, s): Σ over dwells of squared coefficients over their expected squares; dof (u, 1) or (u, 3): how
    many coefficients; log_det (u, s): Σ over dwells.
    """
    with np.errstate(divide="ignore"):
        variance = misfit / dof[..., None]
        score = -0.5 * (dof[..., None] * np.log(np.maximum(variance, 1e-300)) + log_det[:, None, :]) + log_prior
    weight = np.exp(score - score.max(axis=-1, keepdims=True))
    return weight / weight.sum(axis=-1, keepdims=True), variance


def average_shapes(weight: Floats, variance_of_mean: Floats, dof: Floats) -> tuple[Floats, Floats]:
    """Variance of the mean (u, 3) and its degrees of freedom ν (u, 3) from a posterior of dof (u, 1) or (u, 3).

    The average over shapes (and over the χ² of the sample variance) is matched in mean and variance of its
    logarithm by a scaled inverse χ² with ν: Var ln = ψ′(ν/2) ≈ 2/(ν − 1), E ln = ln s² + ln(ν/2) − ψ(ν/2).
    """
    log = np.log(np.maximum(variance_of_mean, 1e-300))
    mean = (weight * log).sum(axis=-1)
    spread = np.maximum((weight * log**2).sum(axis=-1) - mean**2, 0.0) + 2 / dof
    nu = np.maximum(1 + 2 / spread, 2.0)
    return np.exp(mean - np.log(nu / 2) + scipy.special.digamma(nu / 2)), nu


def widening(nu: Floats) -> Floats:
    """(t_{0.975, ν} / 1.96)²: makes ± 1.96 standard deviations cover 95 % although the variance is an estimate."""
    # A quantile takes longer than a search, and the visits of one unit mostly have the same ν.
    distinct, which = np.unique(np.maximum(nu, 1.0), return_inverse=True)
    return np.asarray(((scipy.special.stdtrit(distinct, 0.975) / 1.959963984540054) ** 2)[which].reshape(np.shape(nu)))
