"""Points of a picture in groups along its axis, none of which reaches over a gap where nothing was measured."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats


class PointGroups(NamedTuple):
    """Which group each point (n) is in, and how many each group (g) has; the groups rise along the axis."""

    code: NDArray[np.intp]
    size: Floats

    def mean(self, value: Floats) -> Floats:
        """Means (g)."""
        return np.asarray(np.bincount(self.code, value) / self.size)

    def scatter(self, value: Floats) -> Floats:
        """Standard deviations (g), 0 of a single point."""
        off = value - self.mean(value)[self.code]
        return np.asarray(np.sqrt(np.bincount(self.code, off**2) / np.maximum(self.size - 1, 1)))


def group_points(at: Floats, most: int, *, even: bool = False) -> PointGroups:
    """One group for each value (n) where there are `most` at the most, else about so many of equal steps, or of equally
    many points (even). Points on either side of a gap as wide as half a step are never in one."""
    at = np.round(at, 9)
    places, code = np.unique(at, return_inverse=True)
    if len(places) > most:
        islands = np.cumsum((np.diff(places, prepend=places[0]) > np.ptp(at) / (2 * most)).astype(np.intp))
        code = _even(code, islands, most) if even else _in_steps(at, islands[code], most)
    return PointGroups(code.astype(np.intp), np.bincount(code).astype(float))


def _in_steps(at: Floats, island: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    step = np.minimum((at - at.min()) / np.ptp(at) * most, most - 1).astype(np.intp)
    return np.unique(step + island * most, return_inverse=True)[1]


def _even(code: NDArray[np.intp], islands: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """By the place (n) of each point and the island of each place: an island has as many groups as it has of the
    points, at least one; points of one place are together."""
    here = np.bincount(code)
    size = np.bincount(islands, here).astype(np.intp)
    groups = np.maximum(np.round(size * most / len(code)).astype(np.intp), 1)
    within = (np.cumsum(here) - here) - (np.cumsum(size) - size)[islands]
    of_place = (np.cumsum(groups) - groups)[islands] + within * groups[islands] // size[islands]
    return np.unique(of_place[code], return_inverse=True)[1]
