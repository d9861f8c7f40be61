"""A gold reference that moves while the campaign runs: a drift, or a jump.

At each nest and position the length of the gold's reading is compared with its mean there, so that a tilt, the gold's
own gains and gravity fall out. What is left of visit v is c(t)·â, â the nominal direction in the nest's frame and c
what the gold's offset has moved by: a line in the campaign's time, or a step at the likeliest time. Scatter is what a
fit leaves: with n numbers free, n/2·ln(RSS₀/RSS) nats are gained.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults.gross_fault import (
    BlockGain,
    FaultParameter,
    GrossFault,
    block_gain,
    halves_of,
)
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.scene import Scene

#: Nats for three coefficients beyond the number of times tried: chance one in a hundred thousand.
MIN_NATS = 15.0
#: Visits at the least, and times of a jump tried at the most.
MIN_VISITS, MAX_TIMES = 12, 200


@dataclass(frozen=True, slots=True, eq=False)
class GoldCourse:
    """What the gold's offset moves by: offset (3), recipe's unit, in the nest's frame, for each unit of `share`; share
    (v) of it at each visit; at_s of a jump on the campaign's clock and its standard deviation, NaN of a drift; seconds
    it took."""

    offset: Floats
    std: Floats
    share: Floats
    at_s: float
    at_std: float
    seconds: float
    nats: float
    gain: BlockGain | None


def find(scene: Scene, reading: Floats, t: Floats) -> GoldCourse | None:
    """The course that the gold's readings (v, 3), its own calibration taken off, show over the times t (v) of the
    visits on the campaign's clock, s; None where they show none."""
    visits = scene.visits
    nominal = np.einsum("vji,vj->vi", visits.nest_R, visits.stimulus)
    length = np.linalg.norm(nominal, axis=1)
    along = nominal / np.maximum(length, 1e-300)[:, None]
    nest = visits.groups["nest"].code if "nest" in visits.groups else np.zeros(len(visits), np.int32)
    _, place = np.unique(nest * len(visits.position.names) + visits.position.code, return_inverse=True)
    y = _about_means(np.sum(reading * along, axis=1)[:, None], place)[:, 0]
    free = len(y) - int(place.max()) - 1
    if free < MIN_VISITS or np.ptp(t) <= 0 or not np.any(y):
        return None
    span = float(np.ptp(t))
    line = (t - t.min()) / span
    times = np.unique(t)
    middle = (times[1:] + times[:-1]) / 2
    middle = middle[:: max(1, -(-len(middle) // MAX_TIMES))]
    shapes = [(line, np.nan), *(((t > at).astype(float), float(at)) for at in middle)]
    fits = [_fit(y, _about_means(share[:, None] * along, place), free) for share, _ in shapes]
    costs = [0.0] + [float(np.log(len(middle)))] * len(middle)
    best = max(range(len(fits)), key=lambda i: fits[i][0] - costs[i])
    nats, offset, std = fits[best]
    if nats - costs[best] < MIN_NATS:
        return None
    share, at_s = shapes[best]
    gain = held_out_gain(y, _about_means(share[:, None] * along, place))
    at_std = _time_std(times, middle, np.array([f[0] for f in fits[1:]]), at_s)
    return GoldCourse(offset, std, share, at_s, at_std, span, nats - costs[best], gain)


def _time_std(times: Floats, tried: Floats, nats: Floats, at_s: float) -> float:
    """How far a jump may be from at_s: over the times tried (n), by nats (n), and the gap around each."""
    if not np.isfinite(at_s):
        return float("nan")
    weight = np.exp(nats - nats.max())
    # Where not every gap was tried, one stands for those up to the next.
    ends = np.append(times[np.searchsorted(times, tried, side="right") - 1], times[-1])
    gap2 = np.diff(ends) ** 2 / 12
    return float(np.sqrt(np.sum(weight * ((tried - at_s) ** 2 + gap2)) / np.sum(weight)))


def fault(course: GoldCourse, recipe: Recipe) -> GrossFault:
    """The course as a finding."""
    numbers = [
        FaultParameter("offset", axis, "common", float(v), float(s), recipe.unit)
        for axis, v, s in zip("xyz", course.offset, course.std, strict=True)
    ]
    size = float(np.linalg.norm(course.offset))
    if np.isfinite(course.at_s):
        numbers.append(FaultParameter("at", None, "common", course.at_s, course.at_std, "s"))
        sentence = f"the gold jumps by {size:.2g} {recipe.unit} at {course.at_s:.0f} s"
    else:
        along = float(np.linalg.norm(course.offset * course.std)) / max(size, 1e-300)
        rate = FaultParameter("rate", None, "common", size / course.seconds, along / course.seconds, f"{recipe.unit}/s")
        numbers.append(rate)
        sentence = f"the gold drifts by {size:.2g} {recipe.unit} in {course.seconds:.0f} s"
    return GrossFault("gold-drift", "common", tuple(numbers), sentence, course.nats, gain=course.gain)


def without(recipe: Recipe, table: SampleTable, visit: NDArray[np.intp], course: GoldCourse) -> SampleTable:
    """The table with the gold as it was at the start of the campaign."""
    own = recipe.reference.gold
    offset = course.offset if own is None else np.array(own.matrix) @ course.offset
    assert table.gold is not None
    return replace(table, gold=table.gold - course.share[visit][:, None] * offset)


def _about_means(values: Floats, code: Array) -> Floats:
    """Values (v, k) without the mean of those at the same place, numbered without gaps."""
    count = np.bincount(code)[:, None]
    mean = np.stack([np.bincount(code, x) for x in values.T], axis=1) / count
    return np.asarray(values - mean[code])


def _fit(y: Floats, X: Floats, free: int) -> tuple[float, Floats, Floats]:
    """Nats gained, coefficients (3) and their standard deviations."""
    normal = X.T @ X
    inverse = np.asarray(np.linalg.pinv(normal, 1e-9, hermitian=True), float)
    found = inverse @ (X.T @ y)
    before, after = float(y @ y), float(np.sum((y - X @ found) ** 2))
    after = max(after, 1e-12 * before)
    variance = after / max(free - 3, 1)
    return 0.5 * free * float(np.log(before / after)), found, np.sqrt(variance * np.diag(inverse))


def held_out_gain(y: Floats, X: Floats) -> BlockGain | None:
    """What one half of the visits tells of the other: of y (v) by the columns X (v, k)."""
    half = halves_of(len(y))
    score = np.zeros(len(y))
    squares = np.zeros(2)
    for part in (0, 1):
        fitted, judged = half != part, half == part
        _, c, _ = _fit(y[fitted], X[fitted], int(fitted.sum()))
        residual = y - X @ c
        variances = [max(float(np.mean(x[fitted] ** 2)), 1e-300) for x in (y, residual)]
        each = [-0.5 * (x[judged] ** 2 / v + np.log(v)) for x, v in zip((y, residual), variances, strict=True)]
        score[judged] = each[1] - each[0]
        squares += [float(np.sum(x[judged] ** 2)) for x in (y, residual)]
    before, after = np.sqrt(squares / len(y))
    return block_gain(score, np.ones(len(y)), None, rms=(float(before), float(after)))
