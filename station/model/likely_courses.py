"""Likely courses of a temperature: their mean with what is not known of it, and those of groups of runs together."""

from collections.abc import Sequence
from itertools import product
from math import prod
from typing import NamedTuple

import numpy as np

from station.domain.core.types import Floats

#: Odds, beside the likeliest one, below which a stiffness, or a course, is ruled out.
LEAST_ODDS = 0.02
#: Modes kept of what is not known of a slope, and of a value.
MODES = 3


class TemperatureCourse(NamedTuple):
    """Temperature (n) and its slope (n) at each visit of a run, and modes (n, MODES) of the slope's error: their sum,
    each times a standard normal number, is the error. value_modes (n, MODES): the same of the temperature's error about
    the run's mean, 0 where it is as it was read."""

    value: Floats
    slope: Floats
    modes: Floats
    value_modes: Floats


#: Times (n) in s and mean temperatures (n) of a run's visits; how likely courses of all runs are, and these.
RunMeans = tuple[Floats, Floats]
LikelyCourses = tuple[float, list[TemperatureCourse]]


def courses_of_all(groups: Sequence[Sequence[int]], likely: Sequence[Sequence[LikelyCourses]]) -> list[LikelyCourses]:
    """Likely courses of all runs by those of groups of them, at these places each, which know nothing of each other."""
    if len(groups) == 1:
        return list(likely[0])
    order = np.argsort(np.concatenate([np.asarray(places) for places in groups]))
    shares = [prod(share for share, _ in some) for some in product(*likely)]
    least = LEAST_ODDS * max(shares)
    total = sum(share for share in shares if share > least)
    found = []
    for share, some in zip(shares, product(*likely), strict=True):
        if share > least:
            courses = [course for _, mine in some for course in mine]
            found.append((share / total, [courses[i] for i in order]))
    return found


def mean_course(share: Floats, likely: Sequence[TemperatureCourse]) -> TemperatureCourse:
    """The mean of the likely courses of one run; what they differ by is not known of its slope either."""
    if len(likely) == 1:
        return likely[0]
    slope = np.asarray(share @ np.stack([c.slope for c in likely]))
    # Of values that are as read in all, those.
    value = likely[0].value
    if any(c.value is not value for c in likely):
        value = value + share @ np.stack([c.value - value for c in likely])
    off = _largest(share, np.stack([c.slope for c in likely]) - slope, np.stack([c.modes for c in likely]))
    warm = _largest(share, np.stack([c.value for c in likely]) - value, np.stack([c.value_modes for c in likely]))
    return TemperatureCourse(value, slope, off, warm)


def _largest(share: Floats, off: Floats, modes: Floats) -> Floats:
    """The largest modes (n, MODES) of what likely courses (s), each of such a share, are off by: their means (s, n),
    and modes (s, n, MODES)."""
    every = np.concatenate([off[..., None], modes], axis=2) * np.sqrt(share)[:, None, None]
    every = every.swapaxes(0, 1).reshape(off.shape[1], -1)
    if not every.any():
        return np.zeros((len(every), MODES))
    vectors, size, _ = np.linalg.svd(every, full_matrices=False)
    return padded((vectors * size)[:, :MODES])


def padded(modes: Floats) -> Floats:
    """Modes (…, n, some) as MODES of them, those that are missing 0."""
    missing = MODES - modes.shape[-1]
    return np.concatenate([modes, np.zeros((*modes.shape[:-1], missing))], axis=-1) if missing > 0 else modes
