"""How fast a recorded temperature changes, and how well that is known.

Within a run T = β₀ + β₁ t + f(t) + noise, f an integrated Wiener process: the cubic smoothing spline (Wahba 1978). Its
stiffness is the one that restricted likelihood prefers over all runs; the slope at each stop is its conditional mean,
and what is not known of it its conditional covariance.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from station.domain.types import Floats

#: Stiffness tried: variance of f over a whole run beside that of the noise of a stop.
RATIOS = np.geomspace(1e-2, 1e8, 21)
#: Runs that the stiffness is judged by, at most.
JUDGES = 48
#: Modes kept of what is not known of a slope.
MODES = 3


class Run(NamedTuple):
    """Times (…, n) from the first one as parts of the longest run, and mean temperatures (…, n) of a run's stops."""

    time: Floats
    value: Floats


class Slope(NamedTuple):
    """Slope (n) at each stop of a run, and modes (n, MODES) of its error: their sum, each times a standard normal
    number, is the error."""

    slope: Floats
    modes: Floats


def slopes(runs: Sequence[tuple[Floats, Floats]]) -> list[Slope]:
    """The slopes of runs, each given as times (n) in s and means (n) of its stops."""
    longest = max((float(np.ptp(t)) for t, _ in runs), default=0.0) or 1.0
    scaled = [Run((t - t.min()) / longest, T) for t, T in runs]
    ratio, noise = _stiffness(scaled)
    return [Slope(*(x / longest for x in _slope(run, ratio, noise))) for run in scaled]


def _stiffness(runs: Sequence[Run]) -> tuple[float, float]:
    """The ratio that restricted likelihood prefers, and the standard deviation of a stop's noise."""
    count = Counter(len(run.time) for run in runs if len(run.time) > 2).most_common(1)
    if not count:
        return 1.0, 0.0
    alike = [run for run in runs if len(run.time) == count[0][0]]
    some = alike[:: max(1, len(alike) // JUDGES)]
    judges = Run(np.stack([run.time for run in some]), np.stack([run.value for run in some]))
    free = len(some) * (count[0][0] - 2)
    best = (-np.inf, 1.0, 0.0)
    for ratio in RATIOS:
        logdet, squares = _likelihood(judges, float(ratio))
        variance = max(squares / free, 1e-24)
        best = max(best, (-0.5 * (logdet + free * float(np.log(variance))), float(ratio), variance))
    return best[1], float(np.sqrt(best[2]))


def _likelihood(runs: Run, ratio: float) -> tuple[float, float]:
    """log|V| + log|BᵀV⁻¹B| and the sum of squares left of runs (r, n) together, noise of variance 1."""
    V, B = _covariance(runs.time, ratio)
    y = runs.value[..., None]
    left = np.linalg.solve(V, np.concatenate([B, y], axis=-1))
    normal = B.swapaxes(-1, -2) @ left[..., :2]
    line = np.linalg.solve(normal, B.swapaxes(-1, -2) @ left[..., 2:])
    squares = float(np.sum(y * left[..., 2:]) - np.sum((B.swapaxes(-1, -2) @ left[..., 2:]) * line))
    return float(np.sum(np.linalg.slogdet(V)[1]) + np.sum(np.linalg.slogdet(normal)[1])), max(squares, 0.0)


def _covariance(t: Floats, ratio: float) -> tuple[Floats, Floats]:
    """V = I + ratio · cov(f) at times (…, n), and the straight line B (…, n, 2)."""
    low, high = (f(t[..., :, None], t[..., None, :]) for f in (np.minimum, np.maximum))
    return np.eye(t.shape[-1]) + ratio * (low**2 * high / 2 - low**3 / 6), np.stack([np.ones_like(t), t], -1)


def _slope(run: Run, ratio: float, noise: float) -> tuple[Floats, Floats]:
    """Slope (n) per length of the longest run, and the modes of its error (n, MODES)."""
    t, n = run.time, len(run.time)
    if n < 2 or not np.ptp(t) > 0:
        return np.zeros(n), np.zeros((n, MODES))
    V, B = _covariance(t, ratio)
    # cov(f'(s), f(t)): ∫₀ᵗ min(s, u) du.
    low = np.minimum.outer(t, t)
    with_f = ratio * (low * t - low**2 / 2)
    solved = np.linalg.solve(V, np.column_stack([B, run.value, with_f.T]))
    normal = np.linalg.inv(B.T @ solved[:, :2])
    line = normal @ (B.T @ solved[:, 2])
    toward = np.array([0.0, 1.0]) - with_f @ solved[:, :2]
    slope = line[1] + with_f @ (solved[:, 2] - solved[:, :2] @ line)
    unknown = ratio * low - with_f @ solved[:, 3:] + toward @ normal @ toward.T
    values, vectors = np.linalg.eigh((unknown + unknown.T) / 2)
    modes = vectors[:, -MODES:] * (noise * np.sqrt(np.maximum(values[-MODES:], 0.0)))
    return slope, np.pad(modes, ((0, 0), (0, MODES - modes.shape[1])))
