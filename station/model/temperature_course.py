"""The course of a recorded temperature: how warm it was, how fast that changed, and how well the latter is known.

Within a run T = β₀ + β₁ t + f(t) + noise, f an integrated Wiener process: the cubic smoothing spline (Wahba 1978). Its
stiffness is the one that restricted likelihood prefers over all runs; the slope at each visit is its conditional mean,
and what is not known of it its conditional covariance. Few visits tell little of the stiffness: values are means over
all that are likely. β₁ is normal from run to run: noisy slopes are drawn to their
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
#: Odds, beside the likeliest one, below which a stiffness is ruled out.
LEAST_ODDS = 0.02
#: A thermometer's noise from visit to visit is no more than this, degC, nor than so many times what visits usually are
#: off their neighbours: what is more was as warm as it read. The median of |x| beside the deviation of normal x.
MOST_NOISE_DEGC, MOST_BEYOND_SCATTER, MEDIAN_PER_SIGMA = 0.1, 2.0, 0.6745
#: Noise of less than this share of the deviation of all temperatures blurs no cause.
LEAST_NOISE_SHARE = 0.01
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


class Stiffness(NamedTuple):
    """A stiffness, the standard deviation of a visit's noise with it, and how likely it is beside others."""

    ratio: float
    noise: float
    share: float


class TemperatureCourse(NamedTuple):
    """Temperature (n) and its slope (n) at each visit of a run, and modes (n, MODES) of the slope's error: their sum,
    each times a standard normal number, is the error."""

    value: Floats
    slope: Floats
    modes: Floats


def temperature_courses(runs: Sequence[tuple[Floats, Floats]]) -> list[TemperatureCourse]:
    """The courses of runs, each given as times (n) in s and means (n) of its visits."""
    longest = max((float(np.ptp(t)) for t, _ in runs), default=0.0) or 1.0
    by_length: dict[int, list[int]] = {}
    for i, (t, _) in enumerate(runs):
        by_length.setdefault(len(t), []).append(i)
    scaled = {n: _stacked([runs[i] for i in places], longest) for n, places in by_length.items()}
    likely = _stiffness(list(scaled.values()))
    smooth = _is_smooth(list(scaled.values()), likely)
    found: dict[int, TemperatureCourse] = {}
    for n, places in by_length.items():
        course = _course(scaled[n], likely)
        for i, value, slope, modes in zip(places, *course, strict=True):
            found[i] = TemperatureCourse(value if smooth else runs[i][1], slope / longest, modes / longest)
    return [found[i] for i in range(len(runs))]


def _is_smooth(kinds: Sequence[RunTemperatures], likely: Sequence[Stiffness]) -> bool:
    """Whether what a smooth course leaves is a thermometer's noise, and worth taking off: no more than such ones have,
    nor than visits scatter about their neighbours (a jump would be far more), nor nothing beside the changes."""
    noise = float(np.sqrt(sum(each.share * each.noise**2 for each in likely)))
    off = [_off_neighbours(runs).ravel() for runs in kinds if runs.time.shape[1] > 2]
    usual = float(np.median(np.abs(np.concatenate(off)))) / MEDIAN_PER_SIGMA if off else np.inf
    changes = float(np.std(np.concatenate([runs.value.ravel() for runs in kinds])))
    return LEAST_NOISE_SHARE * changes < noise <= min(MOST_NOISE_DEGC, MOST_BEYOND_SCATTER * usual)


def _off_neighbours(runs: RunTemperatures) -> Floats:
    """How far each visit (r, n − 2) is off the straight line between its neighbours, for noise of a visit as large."""
    before, after = np.diff(runs.time, axis=1)[:, :-1], np.diff(runs.time, axis=1)[:, 1:]
    late = before / np.maximum(before + after, 1e-300)
    line = runs.value[:, :-2] * (1 - late) + runs.value[:, 2:] * late
    return np.asarray((runs.value[:, 1:-1] - line) / np.sqrt(1 + late**2 + (1 - late) ** 2))


def _stacked(runs: Sequence[tuple[Floats, Floats]], longest: float) -> RunTemperatures:
    time = np.stack([t - t.min(initial=np.inf) for t, _ in runs])
    return RunTemperatures(time / longest, np.stack([T for _, T in runs]))


def _stiffness(kinds: Sequence[RunTemperatures]) -> list[Stiffness]:
    """Every stiffness that restricted likelihood does not rule out."""
    long = [runs for runs in kinds if runs.time.shape[1] > 2]
    if not long:
        return [Stiffness(1.0, 0.0, 1.0)]
    by_length = max(long, key=lambda runs: len(runs.time))
    every = max(1, len(by_length.time) // MAX_LIKELIHOOD_RUNS)
    judges = RunTemperatures(by_length.time[::every], by_length.value[::every])
    logdet, squares = _likelihoods(judges)
    free = len(judges.time) * (judges.time.shape[1] - 2)
    variance = np.maximum(squares / free, 1e-24)
    nats = -0.5 * (logdet + free * np.log(variance))
    odds = np.exp(nats - nats.max())
    likely = np.flatnonzero(odds > LEAST_ODDS)
    share = odds[likely] / odds[likely].sum()
    noise = np.sqrt(variance[likely])
    found = zip(STIFFNESS_RATIOS[likely], noise, share, strict=True)
    return [Stiffness(float(r), float(n), float(s)) for r, n, s in found]


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


def _course(runs: RunTemperatures, likely: Sequence[Stiffness]) -> tuple[Floats, Floats, Floats]:
    """Values (r, n), slopes (r, n) per length of the longest run, and the modes of their errors (r, n, MODES)."""
    t = runs.time
    still = ~(np.ptp(t, axis=1) > 0)
    if t.shape[1] < 2 or still.any():
        # A run that never goes on has no slope, and one of a single stop none either.
        return _with_constant_runs(runs, still | (t.shape[1] < 2), likely)
    if t.shape[1] > MOST_DENSE_VISITS:
        # So many visits tell the stiffness.
        best = max(likely, key=lambda each: each.share)
        each = [long_temperature_run.course_and_modes(t, T, best.ratio, MODES) for t, T in zip(*runs, strict=True)]
        value, slope, modes = (np.stack([one[i] for one in each]) for i in range(3))
        return value, slope, best.noise * modes
    slope, modes = _slope(runs, max(likely, key=lambda each: each.share))
    return np.asarray(sum(each.share * _value(runs, each) for each in likely)), slope, modes


def _value(runs: RunTemperatures, given: Stiffness) -> Floats:
    """Values (r, n) where the stiffness is known: what was read without what passes for noise."""
    V, B = _covariance(runs.time, given.ratio)
    return runs.value - _fit(V, B, runs.value, given.noise, B[..., :0]).left[..., 0]


def _slope(runs: RunTemperatures, given: Stiffness) -> tuple[Floats, Floats]:
    """Slopes (r, n) and the modes of their errors (r, n, MODES) where the stiffness is known."""
    t, ratio = runs.time, given.ratio
    V, B = _covariance(t, ratio)
    # cov(f'(s), f(t)): ∫₀ᵗ min(s, u) du.
    low = np.minimum(t[:, :, None], t[:, None, :])
    with_f = ratio * (low * t[:, None, :] - low**2 / 2)
    fitted = _fit(V, B, runs.value, given.noise, with_f.swapaxes(1, 2))
    toward = np.array([0.0, 1.0]) - with_f @ fitted.base
    slope = fitted.line[:, 1] + (with_f @ fitted.left)[..., 0]
    unknown = ratio * low - with_f @ fitted.others + toward @ fitted.normal @ toward.swapaxes(1, 2)
    values, vectors = np.linalg.eigh((unknown + unknown.swapaxes(1, 2)) / 2)
    modes = vectors[..., -MODES:] * (given.noise * np.sqrt(np.maximum(values[:, None, -MODES:], 0.0)))
    return slope, np.pad(modes, ((0, 0), (0, 0), (0, MODES - modes.shape[2])))


class FittedLine(NamedTuple):
    """The runs' straight lines (r, 2, 1) with their covariance (r, 2, 2) in units of noise²; and V⁻¹ of what they leave
    (r, n, 1), of the lines' columns (r, n, 2) and of others (r, n, k)."""

    line: Floats
    normal: Floats
    left: Floats
    base: Floats
    others: Floats


def _fit(V: Floats, B: Floats, value: Floats, noise: float, others: Floats) -> FittedLine:
    """The lines of values (r, n), with other columns (r, n, k) solved beside them."""
    solved = np.linalg.solve(V, np.concatenate([B, value[..., None], others], axis=2))
    base, of_value = solved[..., :2], solved[..., 2:3]
    precision = B.swapaxes(1, 2) @ base
    own = np.asarray(np.linalg.solve(precision, B.swapaxes(1, 2) @ of_value))
    normal, line = _drawn_together(precision, own, noise)
    return FittedLine(line, normal, of_value - base @ line, base, solved[..., 3:])


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


def _with_constant_runs(
    runs: RunTemperatures, still: Array, likely: Sequence[Stiffness]
) -> tuple[Floats, Floats, Floats]:
    """The same where some runs (r) have no slope: 0."""
    value, slope, modes = runs.value.copy(), np.zeros(runs.time.shape), np.zeros((*runs.time.shape, MODES))
    if not still.all():
        moving = RunTemperatures(runs.time[~still], runs.value[~still])
        value[~still], slope[~still], modes[~still] = _course(moving, likely)
    return value, slope, modes
