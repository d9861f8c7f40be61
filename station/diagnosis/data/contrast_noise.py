"""How noisy each contrast within the dwells is: slow noise moves early blocks away from late ones, and what was
differenced before it was sampled hardly moves them.

The noise is that which is left when the courses within the dwell are taken off that each run of a unit has: the same
one at every stop, and one of the size of the last move; then those of all runs whose size follows time, temperature or
the drive.
"""

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.visit_noise import DIFFERENT_BY, FURTHEST, MAD_PER_SIGMA, MAX_LOG_VARIANCE, drawn_to_chance
from station.domain.core.types import Floats
from station.model.scene import Scene

#: Standard deviations beyond which no chance takes a contrast, and one in how many stops may be so far off alone.
LONE_BUMP, LONE_OF = 5.0, 20
#: Degrees of freedom that an axis has left of a contrast, at the least, for its noise to be known.
LEAST_FREE = 8
#: Variance of the logarithm of a noise's square by n squares, none of which is far out, times n.
SQUARES_LOG_VARIANCE = 2.4


def without_bumps(contrast: Floats, sigma: Floats) -> Floats:
    """Contrasts (v, B−1, 3) where a stop that was bumped, as next to no other was, is drawn in to what the rest may
    show; sigma (3): noise of a sample. What many stops show is a course, and stays."""
    if contrast.size == 0 or np.any(sigma <= 0):
        return contrast
    usual = np.maximum(np.median(np.abs(contrast), axis=0) / MAD_PER_SIGMA, sigma)
    furthest = np.max(np.abs(contrast) / usual, axis=(1, 2))
    bumped = furthest > LONE_BUMP
    if np.count_nonzero(bumped) > max(1, len(contrast) // LONE_OF):
        return contrast
    return np.asarray(contrast * np.where(bumped, LONE_BUMP / np.maximum(furthest, LONE_BUMP), 1.0)[:, None, None])


def contrast_noise(contrast: Floats, mean: Floats, scene: Scene, sigma: Floats) -> Floats:
    """Noise (B−1, 3) of contrasts (v, B−1, 3) of stops whose means are (v, 3), beside the rms of sigma (3), that of a
    sample of each axis; that where chance explains the rest, and drawn to it as far as chance makes it differ (James
    and Stein): contrasts of all axes together first, then each axis by itself."""
    blocks, rms = contrast.shape[1], float(np.sqrt(np.mean(sigma**2)))
    expected = np.broadcast_to(sigma / (rms or 1.0), (blocks, 3))
    there = np.all(contrast != 0, axis=(1, 2))
    if rms == 0.0 or np.any(sigma <= 0) or not blocks or not there.any():
        return np.ones((blocks, 3)) if rms == 0.0 else np.asarray(expected)
    squares, free = zip(*(_squares(contrast[..., i], mean[:, i], scene, there) for i in range(3)), strict=True)
    if min(free) < LEAST_FREE:
        return np.asarray(expected)
    logs = np.log(np.stack(squares, axis=1)) - 2 * np.log(expected * rms)
    error = SQUARES_LOG_VARIANCE / min(free)
    common = logs.mean(axis=1, keepdims=True)
    drawn = drawn_to_chance(common, error / 3, blocks, DIFFERENT_BY)
    drawn = drawn + drawn_to_chance(logs - common, error, 2 * blocks, DIFFERENT_BY)
    return np.asarray(expected * np.exp(np.clip(drawn, -MAX_LOG_VARIANCE, MAX_LOG_VARIANCE) / 2))


def _squares(contrast: Floats, mean: Floats, scene: Scene, there: NDArray[np.bool_]) -> tuple[Floats, float]:
    """Mean square (B−1) of the contrasts (v, B−1) of one axis without the courses, and its degrees of freedom."""
    visits = scene.visits
    step = np.where(visits.previous >= 0, mean[visits.previous] - mean, 0.0)[there]
    # A nest's courses are those of a run, as a unit may come into another one.
    run = np.unique(np.cumsum(visits.previous < 0)[there], return_inverse=True)[1]
    count = np.bincount(run)

    def free(values: Floats) -> Floats:
        """Values (v, c) without each run's mean and what follows its moves."""
        centred, along = (x - _by_run(x, run, count) for x in (values, step[:, None]))
        slope = _by_run(centred * along, run, count) / np.maximum(_by_run(along**2, run, count), 1e-300)
        return np.asarray(centred - slope * along)

    rest, known = free(contrast[there]), 2 * len(count)
    drives = [x[there] for x in (scene.time_s, scene.temperature_degC, scene.motor) if x is not None]
    followed = free(np.stack(drives, axis=1))
    size = np.linalg.norm(followed, axis=0)
    followed = followed[:, size > 1e-9 * np.linalg.norm(drives, axis=1)]
    if len(rest) - known - followed.shape[1] >= LEAST_FREE:
        rest, known = rest - followed @ np.linalg.lstsq(followed, rest, rcond=1e-9)[0], known + followed.shape[1]
    left = len(rest) - known
    usual = np.median(np.abs(rest), axis=0) / MAD_PER_SIGMA
    bounded = np.minimum(np.abs(rest), FURTHEST * np.where(usual > 0, usual, np.inf))
    return np.sum(bounded**2, axis=0) / max(left, 1), float(left)


def _by_run(values: Floats, run: NDArray[np.intp], count: NDArray[np.intp]) -> Floats:
    """The mean of values (v, c) over the stops of each one's run (v)."""
    sums = np.stack([np.bincount(run, column) for column in values.T], axis=1)
    return np.asarray((sums / count[:, None])[run])
