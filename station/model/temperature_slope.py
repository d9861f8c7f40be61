"""How fast a recorded temperature changes, and how well that is known.

Within a run T = β₀ + β₁ t + f(t) + noise, f an integrated Wiener process: the cubic smoothing spline (Wahba 1978). Its
stiffness is the one that restricted likelihood prefers over all runs; the slope at each visit is its conditional mean,
and what is not known of it its conditional covariance. β₁ is normal from run to run: noisy slopes are drawn to their
mean, because a cause in proportion to them as they are comes out too small (regression calibration: Carroll, Ruppert,
Stefanski and Crainiceanu, Measurement Error in Nonlinear Models, 2nd ed., ch. 4).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from station.domain.core.types import Array, Floats
from station.model import long_temperature_run

#: Stiffness tried: variance of f over a whole run beside that of the noise of a visit.
STIFFNESS_RATIOS = np.geomspace(1e-2, 1e8, 21)
#: Runs that the stiffness is judged by, at most.
MAX_LIKELIHOOD_RUNS = 48
#: So many runs show how their slopes scatter; fewer are taken as they are.
RUNS_TO_POOL = 4
#: Modes kept of what is not known of a slope.
MODES = 3
#: Visits of a run beyond which no matrix has as many rows: its cost grows with the cube of them.
MOST_DENSE_VISITS = 240


class RunTemperatures(NamedTuple):
    """Times (r, n) from the first one as parts of the longest run, mean temperatures (r, n), of runs of n visits."""

    time: Floats
    value: Floats


class TemperatureSlope(NamedTuple):
    """Slope (n) at each visit of a run, and modes (n, MODES) of its error: their sum, each times a standard normal
    number, is the error."""

    slope: Floats
    modes: Floats


def temperature_slopes(runs: Sequence[tuple[Floats, Floats]]) -> list[TemperatureSlope]:
    """The slopes of runs, each given as times (n) in s and means (n) of its visits."""
    longest = max((float(np.ptp(t)) for t, _ in runs), default=0.0) or 1.0
    by_length: dict[int, list[int]] = {}
    for i, (t, _) in enumerate(runs):
        by_length.setdefault(len(t), []).append(i)
    scaled = {n: _stacked([runs[i] for i in places], longest) for n, places in by_length.items()}
    ratio, noise = _stiffness(list(scaled.values()))
    found: dict[int, TemperatureSlope] = {}
    for n, places in by_length.items():
        slope, modes = _slope(scaled[n], ratio, noise)
        found.update(
            {i: TemperatureSlope(s / longest, m / longest) for i, s, m in zip(places, slope, modes, strict=True)}
        )
    return [found[i] for i in range(len(runs))]


def _stacked(runs: Sequence[tuple[Floats, Floats]], longest: float) -> RunTemperatures:
    time = np.stack([t - t.min(initial=np.inf) for t, _ in runs])
    return RunTemperatures(time / longest, np.stack([T for _, T in runs]))


def _stiffness(kinds: Sequence[RunTemperatures]) -> tuple[float, float]:
    """The ratio that restricted likelihood prefers, and the standard deviation of a visit's noise."""
    long = [runs for runs in kinds if runs.time.shape[1] > 2]
    if not long:
        return 1.0, 0.0
    by_length = max(long, key=lambda runs: len(runs.time))
    every = max(1, len(by_length.time) // MAX_LIKELIHOOD_RUNS)
    judges = RunTemperatures(by_length.time[::every], by_length.value[::every])
    logdet, squares = _likelihoods(judges)
    free = len(judges.time) * (judges.time.shape[1] - 2)
    variance = np.maximum(squares / free, 1e-24)
    best = int(np.argmax(-0.5 * (logdet + free * np.log(variance))))
    return float(STIFFNESS_RATIOS[best]), float(np.sqrt(variance[best]))


def _likelihoods(runs: RunTemperatures) -> tuple[Floats, Floats]:
    """log|V| + log|BᵀV⁻¹B| and the sum of squares left of runs (r, n) together at each of STIFFNESS_RATIOS; the
    noise has variance 1.

    Across the straight line B, V = I + ratio · C has the same eigenvectors at every ratio.
    """
    if runs.time.shape[1] > MOST_DENSE_VISITS:
        return long_temperature_run.likelihoods(runs.time, runs.value, STIFFNESS_RATIOS)
    V, B = _covariance(runs.time, 1.0)
    across = np.linalg.qr(B, mode="complete")[0][..., 2:]
    C = across.swapaxes(-1, -2) @ (V - np.eye(V.shape[-1])) @ across
    values, vectors = np.linalg.eigh(C)
    along = ((across @ vectors).swapaxes(-1, -2) @ runs.value[..., None])[..., 0]
    grown = 1 + STIFFNESS_RATIOS[:, None, None] * np.maximum(values, 0.0)
    line = float(np.sum(np.linalg.slogdet(B.swapaxes(-1, -2) @ B)[1]))
    return np.asarray(line + np.log(grown).sum((1, 2))), np.asarray(np.sum(along**2 / grown, axis=(1, 2)))


def _covariance(t: Floats, ratio: float) -> tuple[Floats, Floats]:
    """V = I + ratio · cov(f) at times (…, n), and the straight line B (…, n, 2)."""
    low, high = (f(t[..., :, None], t[..., None, :]) for f in (np.minimum, np.maximum))
    return np.eye(t.shape[-1]) + ratio * (low**2 * high / 2 - low**3 / 6), np.stack([np.ones_like(t), t], -1)


def _slope(runs: RunTemperatures, ratio: float, noise: float) -> tuple[Floats, Floats]:
    """Slopes (r, n) per length of the longest run, and the modes of their errors (r, n, MODES)."""
    t = runs.time
    still = ~(np.ptp(t, axis=1) > 0)
    if t.shape[1] < 2 or still.any():
        # A run that never goes on has no slope, and one of a single stop none either.
        return _with_constant_runs(runs, still | (t.shape[1] < 2), ratio, noise)
    if t.shape[1] > MOST_DENSE_VISITS:
        each = [long_temperature_run.slope_and_modes(t, T, ratio, MODES) for t, T in zip(*runs, strict=True)]
        return np.stack([slope for slope, _ in each]), noise * np.stack([modes for _, modes in each])
    V, B = _covariance(t, ratio)
    # cov(f'(s), f(t)): ∫₀ᵗ min(s, u) du.
    low = np.minimum(t[:, :, None], t[:, None, :])
    with_f = ratio * (low * t[:, None, :] - low**2 / 2)
    solved = np.linalg.solve(V, np.concatenate([B, runs.value[..., None], with_f.swapaxes(1, 2)], axis=2))
    precision = B.swapaxes(1, 2) @ solved[..., :2]
    own = np.asarray(np.linalg.solve(precision, B.swapaxes(1, 2) @ solved[..., 2:3]))
    normal, line = _drawn_together(precision, own, noise)
    toward = np.array([0.0, 1.0]) - with_f @ solved[..., :2]
    slope = line[:, 1] + (with_f @ (solved[..., 2:3] - solved[..., :2] @ line))[..., 0]
    unknown = ratio * low - with_f @ solved[..., 3:] + toward @ normal @ toward.swapaxes(1, 2)
    values, vectors = np.linalg.eigh((unknown + unknown.swapaxes(1, 2)) / 2)
    modes = vectors[..., -MODES:] * (noise * np.sqrt(np.maximum(values[:, None, -MODES:], 0.0)))
    return slope, np.pad(modes, ((0, 0), (0, 0), (0, MODES - modes.shape[2])))


def _drawn_together(precision: Floats, line: Floats, noise: float) -> tuple[Floats, Floats]:
    """Covariance (r, 2, 2), in units of noise², and means (r, 2, 1) of the runs' lines, β₁ normal about its mean.

    precision, line: the same of each run by itself. Variance between runs by moments (DerSimonian and Laird 1986).
    """
    normal = np.asarray(np.linalg.inv(precision))
    if len(line) < RUNS_TO_POOL or not noise > 0:
        return normal, line
    slope, own = line[:, 1, 0], noise**2 * normal[:, 1, 1]
    weight = 1 / own
    mean = float(np.average(slope, weights=weight))
    free = weight.sum() - np.sum(weight**2) / weight.sum()
    between = float(np.sum(weight * (slope - mean) ** 2) - (len(slope) - 1)) / free
    # None seen is no proof of none: as much as one standard deviation of that estimate may be there.
    between = max(between, float(np.sqrt(2 / (len(slope) - 1)) / np.mean(weight)))
    mean = float(np.average(slope, weights=1 / (own + between)))
    prior = np.zeros_like(precision)
    prior[:, 1, 1] = noise**2 / between
    normal = np.asarray(np.linalg.inv(precision + prior))
    return normal, normal @ (precision @ line + prior[:, :, 1:] * mean)


def _with_constant_runs(runs: RunTemperatures, still: Array, ratio: float, noise: float) -> tuple[Floats, Floats]:
    """The same where some runs (r) have no slope: 0."""
    slope, modes = np.zeros(runs.time.shape), np.zeros((*runs.time.shape, MODES))
    if not still.all():
        slope[~still], modes[~still] = _slope(RunTemperatures(runs.time[~still], runs.value[~still]), ratio, noise)
    return slope, modes
