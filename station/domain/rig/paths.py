"""The shortest safe way through the angles of a rig.

The axes are not coupled: while they move, the rig may be anywhere in the box between start and goal. A hop is safe
only where that whole box lies within the limits and meets no forbidden zone; then it stays safe however late one axis
starts, and wherever the rig is stopped. Ways around a zone go through the corners of the zones: among boxes a shortest
way needs no other points.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from station.domain.recipe.moves import turn_s

Angles = tuple[float, ...]
Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Zone:
    """A box of angles, degrees, in which the rig would hit something; one range an axis."""

    name: str
    ranges: tuple[Range, ...]

    def meets(self, low: Angles, high: Angles) -> bool:
        """Whether a box of angles touches it."""
        return all(a < zone_high and b > zone_low for a, b, (zone_low, zone_high) in zip(low, high, self.ranges))  # noqa: B905 - three of one length


@dataclass(frozen=True, slots=True)
class Space:
    """Where a rig may go. clearance_deg: how far ways keep away from the zones."""

    limits: tuple[Range, ...]
    zones: tuple[Zone, ...]
    speeds_deg_s: tuple[float, ...]
    accelerations_deg_s2: tuple[float, ...]
    clearance_deg: float = 1.0

    def zone_at(self, angles: Angles) -> Zone | None:
        """The zone that a point lies in; None in the open."""
        return next((zone for zone in self.zones if zone.meets(angles, angles)), None)

    def is_open(self, start: Angles, goal: Angles) -> bool:
        """Whether the whole box between two points may be entered."""
        low, high = tuple(map(min, start, goal)), tuple(map(max, start, goal))
        inside = all(a >= lo - 1e-6 and b <= hi + 1e-6 for a, b, (lo, hi) in zip(low, high, self.limits, strict=True))
        return inside and not any(zone.meets(low, high) for zone in self.zones)

    def hop_s(self, start: Angles, goal: Angles) -> float:
        """Time of one hop: the slower axis, each by its trapezium of speed."""
        turned = np.abs(np.subtract(goal, start))
        times = [
            float(turn_s(np.array(t), v, a))
            for t, v, a in zip(turned.tolist(), self.speeds_deg_s, self.accelerations_deg_s2, strict=True)
        ]
        return max(times)


def safe_way(space: Space, start: Angles, goals: Sequence[Angles]) -> tuple[float, tuple[Angles, ...]] | None:
    """Time, s, and points after `start` of the quickest safe way to any of the goals; None where there is none."""
    best: dict[Angles, float] = {start: 0.0}
    queue: list[tuple[float, Angles, tuple[Angles, ...]]] = [(0.0, start, ())]
    wanted = {tuple(goal) for goal in goals if space.zone_at(tuple(goal)) is None}
    points = _points(space, start, wanted)
    while queue:
        time_s, at, way = heapq.heappop(queue)
        if at in wanted:
            return time_s, way or (at,)
        if time_s > best[at]:
            continue
        for point in points:
            if point == at or not space.is_open(at, point):
                continue
            there_s = time_s + space.hop_s(at, point)
            if there_s < best.get(point, np.inf) - 1e-12:
                best[point] = there_s
                heapq.heappush(queue, (there_s, point, (*way, point)))
    return None


def quickest_way(
    space: Space, starts: Sequence[Angles], goals: Sequence[Angles]
) -> tuple[float, tuple[Angles, ...]] | None:
    """The same from whichever of the starts is nearest."""
    return min((way for start in starts if (way := safe_way(space, start, goals))), default=None)


def _points(space: Space, start: Angles, goals: set[Angles]) -> list[Angles]:
    """The goals, and where there are zones the crossings of all lines that a way around them may follow."""
    if all(space.is_open(start, goal) for goal in goals):
        return sorted(goals)
    lines: list[set[float]] = []
    for axis, (low, high) in enumerate(space.limits):
        edges = {edge for zone in space.zones for edge in _edges(zone.ranges[axis], space.clearance_deg)}
        own = {start[axis], *(goal[axis] for goal in goals)}
        lines.append(own | {edge for edge in edges if low <= edge <= high})
    return [*sorted(goals), *(p for p in product(*map(sorted, lines)) if p not in goals and space.zone_at(p) is None)]


def _edges(zone: Range, clearance_deg: float) -> Range:
    return zone[0] - clearance_deg, zone[1] + clearance_deg
