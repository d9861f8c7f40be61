"""The noise of each contrast within the dwells, and the correlation of contrasts: slow noise separates early blocks
from late ones; readings differenced before sampling hardly move the contrasts, and move neighbours in opposite
directions.

The noise is what remains after subtracting the courses within the dwell that each run of a unit has: one common to all
its visits and one in proportion to the last move; then those of all runs whose size follows time, temperature or drive.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.visit_noise import (
    FURTHEST,
    LEAST_OWN,
    MAD_PER_SIGMA,
    MAX_LOG_VARIANCE,
    share_beyond_chance,
)
from station.domain.core.types import Array, Floats
from station.model.scene import Scene

#: Standard deviations beyond which no chance takes a contrast, and one in how many visits may be so far off alone.
LONE_BUMP, LONE_OF = 5.0, 20
#: Degrees of freedom that are left of a contrast, at the least, for its noise to be known, of all axes together or of
#: one; and those that each axis must have.
LEAST_FREE, LEAST_OF_AXIS = 8, 3
#: Variance of the logarithm of a noise's square by n squares, none of which is far out, times n.
SQUARES_LOG_VARIANCE = 2.4


def without_bumps(contrast: Floats, sigma: Floats) -> Floats:
    """Contrasts (v, B−1, 3) where a visit that was bumped, as hardly any other was, is limited to what the rest may
    show; sigma (3): noise of a sample. What many visits show is a course, and stays."""
    if contrast.size == 0 or np.any(sigma <= 0):
        return contrast
    usual = np.maximum(np.median(np.abs(contrast), axis=0) / MAD_PER_SIGMA, sigma)
    furthest = np.max(np.abs(contrast) / usual, axis=(1, 2))
    bumped = furthest > LONE_BUMP
    if np.count_nonzero(bumped) > max(1, len(contrast) // LONE_OF):
        return contrast
    return np.asarray(contrast * np.where(bumped, LONE_BUMP / np.maximum(furthest, LONE_BUMP), 1.0)[:, None, None])


@dataclass(frozen=True, slots=True, eq=False)
class ContrastNoise:
    """noise (B−1, k) of the contrasts of each axis beside that of a sample; apart (B−1, B−1), which makes of contrasts
    in units of their noise such as have nothing in common, None where they have nothing. Standard errors: common_error,
    axis_error of the noise's logarithm, of a contrast in all axes and in each by itself, shared_error of what two
    contrasts have in common."""

    noise: Floats
    apart: Floats | None = None
    common_error: float = 0.0
    axis_error: float = 0.0
    shared_error: float = 0.0

    @property
    def errors(self) -> tuple[float, float, float]:
        """All three standard errors."""
        return self.common_error, self.axis_error, self.shared_error

    def of_lengths(self) -> "ContrastNoise":
        """The same of the one number that is kept where a hand may turn the sensor."""
        both = float(np.hypot(self.common_error, self.axis_error / np.sqrt(3)))
        noise = np.sqrt(np.mean(self.noise**2, axis=1, keepdims=True))
        return ContrastNoise(noise, self.apart, both, 0.0, self.shared_error)

    def of_truth(self, white: Array, rng: np.random.Generator) -> Array:
        """Sets of white contrasts (n, …, B−1, k) as the true noise may have them, of which this is an estimate; another
        truth for each set."""
        if not any(self.errors):
            return white
        sets, blocks, axes = len(white), *self.noise.shape
        logs = self.common_error * rng.standard_normal((sets, blocks, 1))
        logs = logs + self.axis_error * rng.standard_normal((sets, blocks, axes))
        # The root of I + S is I + S/2 where S is small.
        shared = np.triu(rng.standard_normal((sets, blocks, blocks)), 1) * self.shared_error / 2
        mixed = np.eye(blocks) + shared + shared.swapaxes(1, 2)
        within = (sets, *(1,) * (white.ndim - 3))
        factor = np.exp(logs).astype(white.dtype).reshape(*within, blocks, axes)
        return np.asarray(factor * (mixed.astype(white.dtype).reshape(*within, blocks, blocks) @ white))


def contrast_noise(contrast: Floats, mean: Floats, scene: Scene, sigma: Floats) -> ContrastNoise:
    """The noise of contrasts (v, B−1, 3) of visits with means (v, 3), given sigma (3), the noise of a sample of each
    axis. It is shrunk towards sigma as far as chance makes it differ (James and Stein): contrasts of all axes together
    first, then each axis; correlations of two contrasts are shrunk towards zero likewise."""
    blocks, rms = contrast.shape[1], float(np.sqrt(np.mean(sigma**2)))
    expected = np.broadcast_to(sigma / (rms or 1.0), (blocks, 3))
    there = np.all(contrast != 0, axis=(1, 2))
    if rms == 0.0 or np.any(sigma <= 0) or not blocks or not there.any():
        return ContrastNoise(np.ones((blocks, 3)) if rms == 0.0 else np.asarray(expected))
    products, free = zip(*(_products(contrast[..., i], mean[:, i], scene, there) for i in range(3)), strict=True)
    if sum(free) < LEAST_FREE or min(free) < LEAST_OF_AXIS:
        return ContrastNoise(np.asarray(expected))
    half = 0.5 * np.array(free)
    # What a few squares say of the logarithm of their mean is too little by as much.
    logs = np.log(np.stack([np.diagonal(p) for p in products], axis=1)) - scipy.special.digamma(half) + np.log(half)
    logs = logs - 2 * np.log(expected * rms)
    common, error = logs.mean(axis=1, keepdims=True), SQUARES_LOG_VARIANCE / min(free)
    # What an axis has in all of its contrasts is known from fewer visits than what it has in each.
    axis = (logs - common).mean(axis=0, keepdims=True)
    shares = [
        share_beyond_chance(common, error / 3, blocks),
        share_beyond_chance(axis, error / blocks, 2),
        share_beyond_chance(logs - common - axis, error, 2 * (blocks - 1)) if blocks > 1 else 0.0,
    ]
    if min(free) < LEAST_FREE:
        shares[2] = 0.0
    drawn = shares[0] * common + shares[1] * axis + shares[2] * (logs - common - axis)
    drawn = np.clip(drawn, -MAX_LOG_VARIANCE, MAX_LOG_VARIANCE)
    # Of what is drawn in by a share the error is drawn in, too; that of a noise is half of its square's.
    errors = 0.5 * np.sqrt([shares[0] * error / 3, shares[1] * error / blocks + shares[2] * error])
    found = ContrastNoise(np.asarray(expected * np.exp(drawn / 2)), None, *map(float, errors))
    return _apart(found, np.stack(products), sum(free)) if there.all() else found


def _apart(found: ContrastNoise, products: Floats, free: float) -> ContrastNoise:
    """The noise with what contrasts have in common beyond chance, by their mean products of each axis (3, B−1, B−1), so
    many of them free."""
    size = np.sqrt(np.diagonal(products, axis1=1, axis2=2))
    shared = np.mean(products / (size[:, :, None] * size[:, None]), axis=0) - np.eye(size.shape[1])
    pairs = shared[np.triu_indices(len(shared), 1)]
    share = share_beyond_chance(pairs, 1 / free, pairs.size)
    if share == 0.0:
        return found
    values, axes = np.linalg.eigh(np.eye(len(shared)) + share * shared)
    apart = (axes / np.sqrt(np.maximum(values, LEAST_OWN))) @ axes.T
    return replace(found, apart=np.asarray(apart), shared_error=float(np.sqrt(share / free)))


def _products(contrast: Floats, mean: Floats, scene: Scene, there: NDArray[np.bool_]) -> tuple[Floats, float]:
    """Mean products (B−1, B−1) of the contrasts (v, B−1) of one axis without the courses, and their degrees of
    freedom."""
    rest, left = without_courses(contrast, mean, scene, there)
    usual = np.median(np.abs(rest), axis=0) / MAD_PER_SIGMA
    furthest = FURTHEST * np.where(usual > 0, usual, np.inf)
    bounded = np.clip(rest, -furthest, furthest)
    return np.asarray(bounded.T @ bounded) / max(left, 1), float(left)


def without_courses(values: Floats, mean: Floats, scene: Scene, there: NDArray[np.bool_]) -> tuple[Floats, int]:
    """Values (v, c) within the visits of one axis that are there, without the courses that each run has and what
    follows its moves, by the visits' means (v); then without those whose size follows time, temperature or the drive.
    How many numbers of each are left."""
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

    rest, known = free(values[there]), 2 * len(count)
    drives = [x[there] for x in (scene.time_s, scene.temperature_degC, scene.motor) if x is not None]
    followed = free(np.stack(drives, axis=1))
    size = np.linalg.norm(followed, axis=0)
    followed = followed[:, size > 1e-9 * np.linalg.norm(drives, axis=1)]
    if len(rest) - known - followed.shape[1] >= LEAST_FREE:
        rest, known = rest - followed @ np.linalg.lstsq(followed, rest, rcond=1e-9)[0], known + followed.shape[1]
    return rest, len(rest) - known


def _by_run(values: Floats, run: NDArray[np.intp], count: NDArray[np.intp]) -> Floats:
    """The mean of values (v, c) over the visits of each one's run (v)."""
    sums = np.stack([np.bincount(run, column) for column in values.T], axis=1)
    return np.asarray((sums / count[:, None])[run])
