"""The course of a recorded temperature: how warm it was, how fast that changed, and how well both are known.

Within a run T = β₀ + β₁ t + f(t) + noise, beside what the bench warms after power-on (`bench_heating.py`), f an
integrated Wiener process: the cubic smoothing spline (Wahba 1978); the value and the slope at each visit are its
conditional means, and what is not known of them its conditional covariances. β₁ is normal from run to
run: noisy slopes are drawn to their mean, because a cause in proportion to them as they are comes out too small
(regression calibration: Carroll, Ruppert, Stefanski and Crainiceanu, Measurement Error in Nonlinear Models, 2nd ed.,
ch. 4). Few visits tell little of the stiffness, and few runs of how far slopes scatter: all are means over what
restricted likelihood does not rule out. Runs in which the recipe makes the temperature turn have a stiffness of their
own, and do not tell how the bench warms.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from station.domain.core.types import Floats
from station.model import long_temperature_run, slope_scatter
from station.model.bench_heating import COLD, Heating, bench_heating
from station.model.likely_courses import (
    LEAST_ODDS,
    MODES,
    LikelyCourses,
    RunMeans,
    TemperatureCourse,
    courses_of_all,
    mean_course,
    padded,
)
from station.model.slope_scatter import Scatter

#: Stiffness tried: variance of f over a whole run beside that of the noise of a visit.
STIFFNESS_RATIOS = np.geomspace(1e-1, 1e8, 19)
#: A thermometer's noise from visit to visit is no more than this, degC, nor than so many times what visits usually are
#: off their neighbours: what is more was as warm as it read. The median of |x| beside the deviation of normal x.
MOST_NOISE_DEGC, MOST_BEYOND_SCATTER, MEDIAN_PER_SIGMA = 0.1, 2.0, 0.6745
#: Noise of less than this share of the deviation of all temperatures blurs no cause.
LEAST_NOISE_SHARE = 0.01
#: Visits of the runs that the stiffness is judged by, at most.
MAX_LIKELIHOOD_VISITS = 12_000
#: A bend of fewer runs is that of their own course as well.
LEAST_HEATED_RUNS = 2
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


class ReadNoise(NamedTuple):
    """Sum of squares, degC², of so many free numbers that a thermometer's noise left."""

    squares: float
    free: int


def temperature_courses(
    runs: Sequence[RunMeans],
    since_s: Sequence[Floats] | None = None,
    turning: Sequence[bool] | None = None,
) -> list[TemperatureCourse]:
    """The courses of runs, each given as times (n) in s and means (n) of its visits; since_s: times since power-on (n)
    of each, where these are known; turning: in which the temperature is made to rise and fall, in none if None."""
    groups, each, finish = _of_groups(runs, since_s, turning)
    courses: dict[int, TemperatureCourse] = {}
    for places, likely in zip(groups, each, strict=True):
        share, some = zip(*likely, strict=True)
        means = (mean_course(np.array(share), mine) for mine in zip(*some, strict=True))
        courses |= zip(places, means, strict=True)
    return finish([courses[i] for i in range(len(runs))])


def likely_courses(
    runs: Sequence[RunMeans],
    since_s: Sequence[Floats] | None = None,
    turning: Sequence[bool] | None = None,
) -> list[LikelyCourses]:
    """The same for each likely stiffness and scatter of the slopes between runs, with its probability. Runs made to
    turn have a stiffness and a scatter of their own, and do not tell how the bench warms."""
    groups, each, finish = _of_groups(runs, since_s, turning)
    return [(share, finish(courses)) for share, courses in courses_of_all(groups, each)]


def _of_groups(
    runs: Sequence[RunMeans], since_s: Sequence[Floats] | None, turning: Sequence[bool] | None
) -> tuple[
    list[list[int]], list[list[LikelyCourses]], Callable[[Sequence[TemperatureCourse]], list[TemperatureCourse]]
]:
    """Places of the runs that are alike, the likely courses of each of these groups beside what the bench warms, and
    what adds that to courses of all runs."""
    since = [t - t.min(initial=np.inf) for t, _ in runs] if since_s is None else since_s
    turning = [False] * len(runs) if turning is None else turning
    groups = [places for turns in (False, True) if (places := [i for i, x in enumerate(turning) if x == turns])]
    heating = _heating([runs[i] for i in groups[0]], [since[i] for i in groups[0]])
    cool = runs if heating is COLD else [(t, T - heating.value(p)) for (t, T), p in zip(runs, since, strict=True)]
    noise: ReadNoise | None = None
    each = []
    for places in groups:
        likely, noise = _likely_beside_heating([cool[i] for i in places], noise)
        each.append(likely)

    def finish(courses: Sequence[TemperatureCourse]) -> list[TemperatureCourse]:
        if heating is COLD:
            return list(courses)
        return [_heated(*one, heating) for one in zip(courses, cool, runs, since, strict=True)]

    return groups, each, finish


def _heated(
    course: TemperatureCourse,
    cool: tuple[Floats, Floats],
    read: tuple[Floats, Floats],
    since_s: Floats,
    heating: Heating,
) -> TemperatureCourse:
    """A course of the rest, with what the bench warms; what is as it was read stays so to the last digit."""
    value = read[1] if course.value is cool[1] else course.value + heating.value(since_s)
    return course._replace(value=value, slope=course.slope + heating.slope(since_s))


def _heating(runs: Sequence[RunMeans], since_s: Sequence[Floats]) -> Heating:
    """How the bench warms, by runs that are alike in length; not by very long ones, which tell every bend."""
    lengths = [len(t) for t, _ in runs if 2 < len(t) <= MOST_DENSE_VISITS and np.ptp(t) > 0]
    if len(lengths) < LEAST_HEATED_RUNS:
        return COLD
    usual = max(lengths, key=lambda n: (n * lengths.count(n), n))
    chosen = [i for i, (t, _) in enumerate(runs) if len(t) == usual and np.ptp(t) > 0]
    chosen = chosen[:: max(1, len(chosen) * usual // MAX_LIKELIHOOD_VISITS)]
    longest = max(float(np.ptp(runs[i][0])) for i in chosen)
    judges = _stacked([runs[i] for i in chosen], longest)
    since = np.stack([since_s[i] for i in chosen])
    t = judges.time
    sloping = _covariance(t) + t[:, :, None] * t[:, None, :]
    return bench_heating(since, judges.value, sloping, STIFFNESS_RATIOS, longest)


def _likely_beside_heating(
    runs: Sequence[RunMeans], beside: ReadNoise | None
) -> tuple[list[LikelyCourses], ReadNoise | None]:
    """The same of a bench that does not warm by itself, and the noise; beside: that of other runs, where it is
    known."""
    longest = max((float(np.ptp(t)) for t, _ in runs), default=0.0) or 1.0
    kinds: dict[tuple[int, bool], list[int]] = {}
    for i, (t, _) in enumerate(runs):
        kinds.setdefault((len(t), len(t) > 1 and float(np.ptp(t)) > 0), []).append(i)
    scaled = [_stacked([runs[i] for i in places], longest) for places in kinds.values()]
    likely, read_noise = _stiffness(scaled, beside)
    fitted = [_fitted(each, likely) if goes_on else () for each, (_, goes_on) in zip(scaled, kinds, strict=True)]
    share = _joint_probabilities(likely, fitted)
    smooth = _is_smooth(scaled, [g._replace(share=float(w)) for g, w in zip(likely, share.sum(1), strict=True)])
    found = []
    for s, b in np.argwhere(share):
        courses: dict[int, TemperatureCourse] = {}
        for (_, goes_on), places, each, lines in zip(kinds, kinds.values(), scaled, fitted, strict=True):
            at = (lines[s], int(b)) if lines else None
            course = _course(each, likely[s], at) if goes_on else _standing_still(each)
            for i, value, slope, modes, blur in zip(places, *course, strict=True):
                own = (value, blur) if smooth else (runs[i][1], np.zeros_like(blur))
                courses[i] = TemperatureCourse(own[0], slope / longest, modes / longest, own[1])
        found.append((float(share[s, b]), [courses[i] for i in range(len(runs))]))
    return found, read_noise


def _joint_probabilities(likely: Sequence[Stiffness], fitted: Sequence[Sequence["FittedLine"]]) -> Floats:
    """How likely each stiffness and scatter (s, b) is, 0 where it is ruled out: by the runs' courses, by how the slopes
    of all kinds of runs scatter, and by those of most runs by how far. Of scatters that do alike, one."""
    share = np.array([each.share for each in likely])[:, None] * np.eye(slope_scatter.LIKELY)[0]
    told = [each for each in fitted if each]
    if not told:
        # So many visits tell the stiffness, or none goes on.
        share = np.where(share == share.max(), 1.0, 0.0)
    else:
        nats = np.sum([[f.scatter.evidence for f in each] for each in told], axis=0)
        lines = max(told, key=lambda each: len(each[0].line))
        scatter = np.stack([f.scatter.probability for f in lines])
        if all(f.scatter.known for f in lines):
            scatter = np.eye(slope_scatter.LIKELY)[scatter.argmax(axis=1)]
        share = share.sum(1, keepdims=True) * np.exp(nats - nats.max())[:, None] * scatter
    share = np.where(share > LEAST_ODDS * share.max(), share, 0.0)
    return np.asarray(share / share.sum())


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


def _stacked(runs: Sequence[RunMeans], longest: float) -> RunTemperatures:
    time = np.stack([t - t.min(initial=np.inf) for t, _ in runs])
    return RunTemperatures(time / longest, np.stack([T for _, T in runs]))


def _stiffness(kinds: Sequence[RunTemperatures], beside: ReadNoise | None) -> tuple[list[Stiffness], ReadNoise | None]:
    """Every stiffness that restricted likelihood does not rule out, and what the noise left with the best; beside: what
    it left in other runs."""
    long = [runs for runs in kinds if runs.time.shape[1] > 2]
    if not long:
        return [Stiffness(1.0, 0.0, 1.0)], beside
    by_length = max(long, key=lambda runs: len(runs.time))
    every = max(1, by_length.time.size // MAX_LIKELIHOOD_VISITS)
    judges = RunTemperatures(by_length.time[::every], by_length.value[::every])
    logdet, squares = _likelihoods(judges)
    free = len(judges.time) * (judges.time.shape[1] - 2)
    own = free
    if beside is not None:
        squares, free = squares + beside.squares, free + beside.free
    variance = np.maximum(squares / free, 1e-24)
    nats = -0.5 * (logdet + free * np.log(variance))
    odds = np.exp(nats - nats.max())
    likely = np.flatnonzero(odds > LEAST_ODDS)
    share = odds[likely] / odds[likely].sum()
    noise = np.sqrt(variance[likely])
    found = zip(STIFFNESS_RATIOS[likely], noise, share, strict=True)
    left = ReadNoise(float(variance[odds.argmax()]) * own, own)
    return [Stiffness(float(r), float(n), float(s)) for r, n, s in found], left


def _likelihoods(runs: RunTemperatures) -> tuple[Floats, Floats]:
    """log|V| + log|BᵀV⁻¹B| and the sum of squares left of runs (r, n) together at each of STIFFNESS_RATIOS; the
    noise has variance 1.

    Across the straight line B, V = I + ratio · C has the same eigenvectors at every ratio.
    """
    if runs.time.shape[1] > MOST_DENSE_VISITS:
        return long_temperature_run.likelihoods(runs.time, runs.value, STIFFNESS_RATIOS)
    B = _line(runs.time)
    across = np.linalg.qr(B, mode="complete")[0][..., 2:]
    values, vectors = np.linalg.eigh(across.swapaxes(-1, -2) @ _covariance(runs.time) @ across)
    along = ((across @ vectors).swapaxes(-1, -2) @ runs.value[..., None])[..., 0]
    grown = 1 + STIFFNESS_RATIOS[:, None, None] * np.maximum(values, 0.0)
    line = float(np.sum(np.linalg.slogdet(B.swapaxes(-1, -2) @ B)[1]))
    return np.asarray(line + np.log(grown).sum((1, 2))), np.asarray(np.sum(along**2 / grown, axis=(1, 2)))


def _line(t: Floats) -> Floats:
    """The straight line at times (…, n) as columns (…, n, 2)."""
    return np.stack([np.ones_like(t), t], -1)


def _covariance(t: Floats) -> Floats:
    """cov(f) (…, n, n) at times (…, n), for a stiffness of 1."""
    low, high = (f(t[..., :, None], t[..., None, :]) for f in (np.minimum, np.maximum))
    return np.asarray(low**2 * high / 2 - low**3 / 6)


class FittedLine(NamedTuple):
    """Of runs (r) with a stiffness: their straight lines (r, 2, 1) with their precision (r, 2, 2) in units of noise²,
    each by itself; V⁻¹ of the readings (r, n, 1), of the lines' columns (r, n, 2) and of cov(f, f′) (r, n, n), and
    itself (r, n, n); scatter: of their slopes."""

    given: Stiffness
    line: Floats
    precision: Floats
    of_value: Floats
    base: Floats
    with_f: Floats
    inverse: Floats
    scatter: Scatter


def _fitted(runs: RunTemperatures, likely: Sequence[Stiffness]) -> tuple[FittedLine, ...]:
    """The lines at every likely stiffness; none of so many visits that they tell all."""
    return () if runs.time.shape[1] > MOST_DENSE_VISITS else tuple(_fit(runs, given) for given in likely)


def _fit(runs: RunTemperatures, given: Stiffness) -> FittedLine:
    V, B = np.eye(runs.time.shape[1]) + given.ratio * _covariance(runs.time), _line(runs.time)
    with_f = _slope_covariance(runs.time, given.ratio)[0]
    inverse = np.asarray(np.linalg.inv(V), float)
    base, of_value = inverse @ B, inverse @ runs.value[..., None]
    precision = B.swapaxes(1, 2) @ base
    line = np.asarray(np.linalg.solve(precision, B.swapaxes(1, 2) @ of_value))
    own = np.asarray(given.noise**2 * np.linalg.inv(precision)[:, 1, 1], float)
    scatter = slope_scatter.scatter(line[:, 1, 0], own)
    return FittedLine(given, line, precision, of_value, base, inverse @ with_f.swapaxes(1, 2), inverse, scatter)


def _slope_covariance(t: Floats, ratio: float) -> tuple[Floats, Floats]:
    """cov(f′(s), f(t)): ∫₀ᵗ min(s, u) du, and cov(f′, f′) (r, n, n)."""
    low = np.minimum(t[:, :, None], t[:, None, :])
    return ratio * (low * t[:, None, :] - low**2 / 2), ratio * low


def _course(
    runs: RunTemperatures, given: Stiffness, fitted: tuple[FittedLine, int] | None
) -> tuple[Floats, Floats, Floats, Floats]:
    """Values (r, n), slopes (r, n) per length of the longest run, the modes of their errors (r, n, MODES) and those of
    the values', where the stiffness is known; fitted: their lines, and which scatter these have, None of so many visits
    that tell all."""
    if fitted is None:
        each = [long_temperature_run.course_and_modes(t, T, given.ratio, MODES) for t, T in zip(*runs, strict=True)]
        value, slope, modes = (np.stack([one[i] for one in each]) for i in range(3))
        return value, slope, given.noise * modes, np.zeros_like(modes)
    value, slope, of_slope, of_value = _given(runs, *fitted)
    return value, slope, _modes(of_slope), _modes(of_value)


def _modes(unknown: Floats) -> Floats:
    """The largest modes (r, n, MODES) of covariances (r, n, n)."""
    values, vectors = np.linalg.eigh((unknown + unknown.swapaxes(1, 2)) / 2)
    modes = vectors[..., -MODES:] * np.sqrt(np.maximum(values[:, None, -MODES:], 0.0))
    return padded(modes)


def _standing_still(runs: RunTemperatures) -> tuple[Floats, Floats, Floats, Floats]:
    """The same of runs that never go on, or of a single stop: they have no slope."""
    modes = np.zeros((*runs.time.shape, MODES))
    return runs.value, np.zeros(runs.time.shape), modes, modes


def _given(runs: RunTemperatures, fitted: FittedLine, b: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Values (r, n), which are what was read without what passes for noise, slopes (r, n) and the covariances of their
    errors (r, n, n) and of the values' about a run's mean, where the stiffness and the scatter of the slopes are known.
    What is left of the noise given the readings: I − V⁻¹ + V⁻¹B·cov(β)·BᵀV⁻¹."""
    noise = fitted.given.noise
    with_f, of_slopes = _slope_covariance(runs.time, fitted.given.ratio)
    normal, line = slope_scatter.drawn_together(fitted.precision, fitted.line, noise, float(fitted.scatter.between[b]))
    left = fitted.of_value - fitted.base @ line
    toward = np.array([0.0, 1.0]) - with_f @ fitted.base
    slope = line[:, 1] + (with_f @ left)[..., 0]
    unknown = of_slopes - with_f @ fitted.with_f + toward @ normal @ toward.swapaxes(1, 2)
    count = runs.time.shape[1]
    within = np.eye(count) - 1 / count
    blur = within @ (np.eye(count) - fitted.inverse + fitted.base @ normal @ fitted.base.swapaxes(1, 2)) @ within
    return runs.value - left[..., 0], slope, noise**2 * unknown, noise**2 * blur
