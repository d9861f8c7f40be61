"""How noisy each stop is: a drive that idles here and brakes there, an axis that shakes where gravity loads it.

Noise is taken from differences of neighbours, which slow motion does not reach.
"""

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

MAD_PER_SIGMA = 0.6745
#: Variance of the logarithm of a noise's square by the median of n differences, times n; and by how much, in such
#: logarithms, an axis may be noisier than the others.
MEDIAN_LOG_VARIANCE, MAX_LOG_VARIANCE = 8.0, 3.0
#: The same by the mean of n squares, none above that of so many standard deviations.
MEAN_LOG_VARIANCE, FURTHEST = 4.0, 3.0
#: A stop is noisier by itself beyond so many standard errors, by chance one of thirty thousand; the stops differ
#: altogether where their logarithms spread by so many standard errors more than chance makes them.
NOISIER_BY, DIFFERENT_BY = 4.0, 4.0
#: Of codes so many standard deviations wide each stop shows another noise by where it lies between two of them.
COARSE = 1.5
#: Fewer differences of a stop show no noise of its own.
LEAST_DIFFERENCES = 8


def sample_noise(reading: Floats, visit: NDArray[np.intp]) -> Floats:
    """Noise of a sample (3) from differences of neighbours in a stop; 0 where they never differ."""
    near = _differences(reading, visit)[0]
    if not len(near):
        return np.zeros(3)
    robust = np.median(near, axis=0) / MAD_PER_SIGMA
    return np.asarray(np.where(robust > 0, robust, np.sqrt(np.mean(near**2, axis=0))) / np.sqrt(2))


def axis_noise(sigma: Floats, differences: int) -> Floats:
    """Noise of each axis (3) beside the rms of all, from that of a sample; drawn to 1 as far as chance alone makes them
    differ (James and Stein), and no further apart than noise of one kind may be."""
    if np.any(sigma <= 0) or differences < 1:
        return np.ones(3)
    logs = 2 * np.log(sigma)
    apart = logs - logs.mean()
    # Two degrees of freedom are left of three logarithms.
    shrunk = max(0.0, 1 - 2 * MEDIAN_LOG_VARIANCE / differences / max(float(apart @ apart), 1e-300))
    variance = np.exp(np.clip(shrunk * apart, -MAX_LOG_VARIANCE, MAX_LOG_VARIANCE))
    return np.asarray(np.sqrt(variance / variance.mean()))


def excess_variance(reading: Floats, visit: NDArray[np.intp], sigma: Floats) -> Floats:
    """Noise's square of each stop and axis (v, 3) beside that of all stops; 1 where chance explains it.

    Where the stops differ altogether, each is drawn to 1 as far as chance makes it differ (James and Stein); one that
    stands out by itself counts in full. What is quieter by itself keeps the common noise: what stands still for
    another reason shall not outweigh the rest.
    """
    stops = int(visit.max()) + 1 if len(visit) else 0
    near, of = _differences(reading, visit)
    if np.any(sigma <= 0) or not len(near):
        return np.ones((stops, 3))
    logs, count = _log_variances(near / sigma, of, stops)
    logs = np.where(np.min(near, axis=0, initial=np.inf, where=near > 0) > COARSE * sigma, 0.0, logs)
    error = np.sqrt(MEAN_LOG_VARIANCE / np.maximum(count, 1))[:, None]
    score = np.where(count[:, None] >= LEAST_DIFFERENCES, logs / error, 0.0)
    squares, size = float(np.sum(np.clip(score, -NOISIER_BY, NOISIER_BY) ** 2)), max(score.size, 1)
    shared = 1 - size / squares if squares > size + DIFFERENT_BY * np.sqrt(2 * size) else 0.0
    found = shared * np.where(score == 0.0, 0.0, logs)
    for stop, axis in np.argwhere(score > NOISIER_BY):
        # Cut off at FURTHEST, the mean of squares of a much noisier stop says too little.
        middle = float(np.median(near[of == stop, axis])) / sigma[axis] / MAD_PER_SIGMA / np.sqrt(2)
        found[stop, axis] = max(logs[stop, axis], 2 * np.log(max(middle, 1.0)))
    return np.asarray(np.exp(np.maximum(found, -MAX_LOG_VARIANCE)))


def _differences(reading: Floats, visit: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
    """Distances (n, 3) of neighbours in a stop, and the stop of each."""
    within = visit[1:] == visit[:-1]
    return np.abs(np.diff(reading, axis=0))[within], visit[1:][within]


def _log_variances(ratio: Floats, of: NDArray[np.intp], stops: int) -> tuple[Floats, NDArray[np.intp]]:
    """Logarithm of the noise's square of each stop and axis (v, 3) beside that of the middle stop, from differences
    (n, 3) in units of the common noise, and how many differences it has.

    Means of squares, since a median of coarse readings jumps from code to code; wild ones count as FURTHEST.
    """
    count = np.bincount(of, minlength=stops)
    squares = np.minimum(ratio / np.sqrt(2), FURTHEST) ** 2
    mean = np.stack([np.bincount(of, column, stops) for column in squares.T], axis=1) / np.maximum(count, 1)[:, None]
    there = (count[:, None] > 0) & (mean > 0)
    logs = np.log(np.where(there, mean, 1.0))
    return np.where(there, logs - _middle(logs, there), 0.0), count


def _middle(logs: Floats, there: NDArray[np.bool_]) -> Floats:
    """Median (3) of each axis over the stops that have one; 0 where none has."""
    return np.array([np.median(x[t]) if t.any() else 0.0 for x, t in zip(logs.T, there.T, strict=True)])
