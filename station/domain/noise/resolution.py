"""How finely a sensor reads: the step seen in the data, and what rounding does to a mean."""

import numpy as np

from station.domain.core.types import Floats
from station.domain.noise.dwell_statistics import DwellStatistics

#: Differences of a quantised axis are whole steps to within this share of one.
WHOLE = 0.02


def step_of(dwells: DwellStatistics, sheet: float) -> Floats:
    """The step (3) of one unit's readings: the least difference of which all others are multiples.

    Axes that never changed within a dwell take the data sheet's step; 0 where readings are finer than can be seen.
    """
    least = dwells.step.min(axis=0)
    size = np.where(np.isfinite(least), least, 1.0)
    apart = np.concatenate([dwells.high - dwells.low, dwells.low - dwells.low[0]]) / size
    whole = (np.abs(apart - np.round(apart)) < WHOLE).all(axis=0)
    return np.where(np.isfinite(least), np.where(whole, least, 0.0), sheet)


def rounding_variance(step: Floats, noise_std: Floats) -> Floats:
    """Variance that rounding to `step` leaves in a mean of readings with Gaussian noise `noise_std`.

    Mean square over all places between two steps of the error's Fourier series,
    step²/(2π²) · Σ exp(−4π²k²σ²/step²)/k²: step²/12 without noise, nothing with noise of half a step or more
    (Widrow & Kollár 2008, Quantization Noise, ch. 4 and app. B).
    """
    k = np.arange(1, 51)
    ratio = np.divide(noise_std, step, out=np.full(np.shape(step), np.inf), where=np.asarray(step) > 0)
    series = (np.exp(-4 * np.pi**2 * k**2 * np.minimum(ratio, 1e3)[..., None] ** 2) / k**2).sum(axis=-1)
    tail = np.where(ratio == 0, np.pi**2 / 6 - (1 / k**2).sum(), 0.0)
    return np.asarray(step**2 / (2 * np.pi**2) * (series + tail))


def noise_under(step: Floats, std: Floats) -> Floats:
    """Noise (3) of the signal before rounding, from the standard deviations (d, 3) after it (Sheppard)."""
    return np.asarray(np.sqrt(np.maximum((std**2).mean(axis=0) - step**2 / 12, 0.0)))
