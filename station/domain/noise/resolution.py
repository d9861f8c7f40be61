"""How finely a sensor reads: the step seen in the data, and what rounding does to a mean."""

from functools import lru_cache

import numpy as np

from station.domain.core.types import Floats
from station.domain.noise.dwell_statistics import DwellStatistics

#: Share of the scatter of coarse readings that counts as evidence of noise beneath.
SAFE_SHARE = 0.85
#: From so many dwells on one axis' noise is told from the others'.
MANY_DWELLS = 12
#: The noisiest axis of a sensor over the usual one: an upright axis of data sheets has up to a fifth more.
AXES_APART = 1.2
#: Few dwells tell little of an axis' noise: this share of it is taken from all axes.
SHRUNK = 0.5
#: Means of dwells nearer than this share of a step lie at one place.
ONE_PLACE = 0.25
#: Beyond this mean square of coarse readings, in steps, noise dithers wherever they lie.
DITHERED = 0.3
#: Differences of a quantised axis are whole steps to within this share of one.
WHOLE = 0.02
#: Differences of no less than this share of the data sheet's step show that it is one.
NO_LESS = 0.9
#: Differences of fewer steps show whether levels lie on one grid.
NEAR = 50.0


def step_of(dwells: DwellStatistics, sheet: float) -> Floats:
    """The step (3) of one unit's readings: the least difference of which all others are multiples.

    Axes that never changed within a dwell take the data sheet's step, and without one the least difference between
    dwells, of their own or of another axis; 0 where readings are finer than can be seen.
    """
    least = dwells.step.min(axis=0)
    if sheet == 0 and not np.isfinite(least).all():
        sheet = _least_between(dwells)
    size = np.where(np.isfinite(least), least, 1.0)
    apart = np.concatenate([dwells.high - dwells.low, dwells.low - dwells.low[0]]) / size
    whole = (np.abs(apart - np.round(apart)) < WHOLE).all(axis=0)
    return np.where(np.isfinite(least), np.where(whole, least, 0.0), sheet)


def stated_step(dwells: DwellStatistics, seen: Floats, sheet: float) -> Floats:
    """The step (3) that a budget counts: the one seen; where none is, the data sheet's, if no reading ever changed by
    less. Steps of a converter that came in finer frames are no whole multiples of each other."""
    least = dwells.step.min(axis=0)
    return np.where((seen == 0) & np.isfinite(least) & (least > NO_LESS * sheet), sheet, seen)


def _least_between(dwells: DwellStatistics) -> float:
    """Least difference between the levels of dwells, over all axes; 0 where there is none."""
    levels = np.sort(dwells.low, axis=0)
    apart = np.diff(levels, axis=0)
    apart = apart[apart > 1e-12 * max(float(np.abs(levels).max(initial=0.0)), 1e-300)]
    if not len(apart):
        return 0.0
    least = float(apart.min())
    near = apart[apart < NEAR * least] / least
    # Single readings never repeat, however fine: only what lies on one grid shows a step.
    on_grid = bool((np.abs(near - np.round(near)) < WHOLE).all())
    return 0.0 if (dwells.count == 1).all() and not on_grid else least


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
    """Noise (3) of the signal before rounding, from the standard deviations (d, 3) after it.

    Over all places between two steps a dwell's variance is σ² + step²/12 − rounding_variance(σ) in the mean: what of
    the rounding does not stay in the mean scatters about it. Far above the step that is Sheppard's correction.

    Dwells of an axis that lie on an edge by chance look like more noise, which would dither their rounding away. The
    axes of a sensor are about as noisy: of those that change none counts as noisier than AXES_APART times their median.
    Of a few dwells the median is no better a guess than each, and there residuals widen U far more.
    """
    square, step = (std**2).mean(axis=0), np.broadcast_to(np.asarray(step, float), np.shape(std)[1:])
    coarse = (step > 0) & (square < step**2)
    # Few readings cross a step: less noise than they seem to show leaves more of the rounding.
    ratio = SAFE_SHARE * square / np.where(coarse, step, 1.0) ** 2
    fine = np.sqrt(np.maximum(square - step**2 / 12, 0.0))
    found = np.where(coarse, step * np.interp(ratio, *_noise_by_variance()), fine)
    if len(std) < MANY_DWELLS or not found.any():
        return np.asarray(found)
    return np.asarray(np.where(coarse, np.minimum(found, AXES_APART * np.median(found[found > 0])), found))


def rounding_of_few(step: Floats, dwells: DwellStatistics) -> Floats:
    """Variance (3) that rounding leaves in means of fewer than MANY_DWELLS dwells; 0 where they are more, have no
    step, or noise dithers anyway.

    Of six faces four readings of an axis lie at its offset. When that is on an edge all four look noisy, and their
    noise would dither away the rounding of the other two. So dwells of one place count together as one; and each axis
    is shrunk towards the mean of all (Efron & Morris 1973, J. Am. Stat. Assoc. 68, 117), since so few are hardly
    better a guess than those of the other axes.
    """
    squares = dwells.std**2
    coarse = (step > 0) & (squares.mean(axis=0) < DITHERED * step**2)
    out = np.zeros(3)
    if len(squares) >= MANY_DWELLS:
        return out
    ratio = np.array([_by_place(dwells.mean[:, i], squares[:, i], step[i]) if coarse[i] else 0.0 for i in range(3)])
    # An axis that never changes keeps all of its rounding.
    for i in np.flatnonzero(coarse & squares.any(axis=0)):
        alike = coarse & np.isclose(step, step[i])
        shrunk = (1 - SHRUNK) * ratio[i] + SHRUNK * ratio[alike].mean()
        noise = step[i] * np.interp(SAFE_SHARE * shrunk, *_noise_by_variance())
        out[i] = rounding_variance(step[i], noise)
    return out


def _by_place(mean: Floats, square: Floats, step: float) -> float:
    """Variance of readings, in steps, as dwells (d) of one place have it on average, averaged over the places."""
    order = np.argsort(mean, kind="stable")
    apart = np.flatnonzero(np.diff(mean[order]) > ONE_PLACE * step) + 1
    return float(np.mean([square[own].mean() for own in np.split(order, apart)])) / step**2


@lru_cache(maxsize=1)
def _noise_by_variance() -> tuple[Floats, Floats]:
    """Mean variance of rounded readings, and the noise beneath, in steps."""
    noise = np.linspace(0.0, 1.2, 1201)
    return noise**2 + 1 / 12 - rounding_variance(np.ones_like(noise), noise), noise
