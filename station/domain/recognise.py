"""A log without marks: finds the stills of each node, and which position of the recipe each of them is."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from station.domain.frames import SensorLayout
from station.domain.marks import Mark
from station.domain.recipe import Position, Recipe
from station.domain.stillness import angle_deg, at_rest, expected_noise
from station.domain.stop_check import FACE_DEG
from station.domain.stream import samples
from station.domain.types import Floats, Frames

#: Readings are looked at in blocks of this length, s; a still is this long at least.
BLOCK_S, LEAST_S = 0.2, 0.6
#: Beginning and end of a still are left out: the part was being let go, or taken up.
MARGIN_S = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """A stretch of rest. start_s, end_s since the log's first frame; mean (3) reading."""

    start_s: float
    end_s: float
    mean: Floats


def nodes_in(frames: Frames, layout: SensorLayout) -> tuple[int, ...]:
    """Node ids whose sample frames are in a log."""
    seen = set(np.unique(frames.can_id).tolist())
    return tuple(node for node in range(1, 128) if _id(layout, node) in seen)


def stills(frames: Frames, layout: SensorLayout, node: int, recipe: Recipe) -> list[Still]:
    """Stretches in which a node was at rest, in order of time."""
    told = samples(frames, layout, node)
    keep = told.usable
    time_s = (told.time_ns[keep] - frames.time_ns[0]) / 1e9
    xyz = told.xyz[keep]
    noise = expected_noise(recipe)
    lsb = max(abs(axis.scale) for axis in layout.axes)
    found: list[list[slice]] = []
    for block in _blocks(time_s):
        resting = at_rest(xyz[block], noise, lsb)
        if resting and found and found[-1] and _same(xyz, found[-1][-1], block, noise, lsb):
            found[-1].append(block)
        elif resting:
            found.append([block])
        elif found and found[-1]:
            found.append([])
    return [s for s in (_still(time_s, xyz, blocks) for blocks in found if blocks) if s.end_s - s.start_s >= LEAST_S]


def marks(frames: Frames, layout: SensorLayout, node: int, recipe: Recipe) -> tuple[Mark, ...]:
    """One mark for each position of the recipe, the longest still that shows it; none when a position is missing."""
    found = stills(frames, layout, node, recipe)
    best: dict[str, Still] = {}
    for still in found:
        name = _position(still, recipe)
        if name and (name not in best or still.end_s - still.start_s > best[name].end_s - best[name].start_s):
            best[name] = still
    if set(best) != {p.name for p in recipe.positions}:
        return ()
    ordered = sorted(best.items(), key=lambda item: item[1].start_s)
    return tuple(
        Mark(unit=f"node-{node}", node=node, run=0, visit=i, position=name, start_s=s.start_s, end_s=s.end_s)
        for i, (name, s) in enumerate(ordered)
    )


def _blocks(time_s: Floats) -> Iterator[slice]:
    if not len(time_s):
        return
    number = np.floor((time_s - time_s[0]) / BLOCK_S).astype(np.int64)
    edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(time_s)]
    for begin, end in pairwise(edges):
        yield slice(begin, end)


def _same(xyz: Floats, before: slice, block: slice, noise: float, lsb: float) -> bool:
    """Whether two blocks of rest are one still: their means agree."""
    return at_rest(np.concatenate([xyz[before], xyz[block]]), noise, lsb)


def _still(time_s: Floats, xyz: Floats, blocks: list[slice]) -> Still:
    rows = slice(blocks[0].start, blocks[-1].stop)
    start, end = float(time_s[rows.start]) + MARGIN_S, float(time_s[rows.stop - 1]) - MARGIN_S
    return Still(start, end, np.asarray(xyz[rows].mean(axis=0)))


def _position(still: Still, recipe: Recipe) -> str:
    """The position whose stimulus the still's mean points along; '' when none is near."""
    angles = {p.name: angle_deg(still.mean, _true(recipe, p)) for p in recipe.positions}
    name = min(angles, key=lambda n: angles[n], default="")
    return name if name and angles[name] <= FACE_DEG else ""


def _true(recipe: Recipe, position: Position) -> Floats:
    return recipe.true_vector(position, recipe.runs[0].seating)


def _id(layout: SensorLayout, node: int) -> int:
    return layout.sample.can_id - layout.map.node_of_dbc + node
