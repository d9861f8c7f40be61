"""A log without marks: finds the stills of each node, and which position of the recipe each of them is."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from station.domain.can.decode import decode_samples
from station.domain.can.sensor_layout import SensorLayout
from station.domain.capture import rest_segments
from station.domain.capture.annotations import Annotation
from station.domain.capture.rest_detection import FACE_DEG, angle_deg
from station.domain.core.types import Floats, Frames
from station.domain.recipe.position import Position
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError

#: Readings in a block, and how many standard deviations of a difference of two blocks' means are a step.
BLOCK_READINGS, STEP_SIGMA = 20, 7.0


@dataclass(frozen=True, slots=True, eq=False)
class RestSegment:
    """A stretch of rest. start_s, end_s since the log's first frame; mean (3) reading."""

    start_s: float
    end_s: float
    mean: Floats


def nodes_in(frames: Frames, layout: SensorLayout) -> tuple[int, ...]:
    """Node ids whose sample frames are in a log."""
    observed_ids = set(np.unique(frames.can_id).tolist())
    return tuple(node for node in range(1, 128) if _id(layout, node) in observed_ids)


def segments_of_node(frames: Frames, layout: SensorLayout, node: int) -> list[RestSegment]:
    """Stretches in which a node was at rest, in order of time; none when it said too little to tell."""
    decoded = decode_samples(frames, layout, node)
    time_s = (decoded.time_ns[decoded.usable] - frames.time_ns[0]) / 1e9
    xyz = decoded.xyz[decoded.usable]
    try:
        found = rest_segments.find(time_s, xyz)
    except SamplesError:
        return []
    parts = [part for a, b in found.tolist() for part in _split_at_steps(xyz, a, b)]
    return [
        RestSegment(float(time_s[a]), float(time_s[b - 1]), np.asarray(xyz[a:b].mean(axis=0)))
        for a, b in parts
        if b - a >= BLOCK_READINGS
    ]


def _split_at_steps(xyz: Floats, begin: int, end: int) -> Iterator[tuple[int, int]]:
    """Parts of a stretch without a step: two rests with a quick turn, or a switched output, between them are two."""
    edges = [*range(begin, end - BLOCK_READINGS + 1, BLOCK_READINGS), end]
    blocks = [xyz[a:b] for a, b in pairwise(edges)]
    start = begin
    spread = np.median([b.std(axis=0) for b in blocks], axis=0) * np.sqrt(2 / BLOCK_READINGS)
    for i, (before, after) in enumerate(pairwise(blocks), 1):
        if (np.abs(before.mean(axis=0) - after.mean(axis=0)) > STEP_SIGMA * spread).any():
            yield start, edges[i] - BLOCK_READINGS
            start = edges[i] + BLOCK_READINGS
    yield start, end


def annotate_log(frames: Frames, layout: SensorLayout, node: int, recipe: Recipe) -> tuple[Annotation, ...]:
    """One mark for each position of the recipe, the first still that shows it; none when a position is missing.

    Later ones may have come through the device's own corrected output, as the visits of a verification do.
    """
    first: dict[str, RestSegment] = {}
    for still in segments_of_node(frames, layout, node):
        name = _position(still, recipe)
        if name:
            first.setdefault(name, still)
    if set(first) != {p.name for p in recipe.positions}:
        return ()
    return tuple(
        Annotation(unit=f"node-{node}", node=node, run=0, visit=i, position=name, start_s=s.start_s, end_s=s.end_s)
        for i, (name, s) in enumerate(first.items())
    )


def _position(still: RestSegment, recipe: Recipe) -> str:
    """The position whose stimulus the still's mean points along; '' when none is near."""
    angles = {p.name: angle_deg(still.mean, _true(recipe, p)) for p in recipe.positions}
    name = min(angles, key=lambda n: angles[n], default="")
    return name if name and angles[name] <= FACE_DEG else ""


def _true(recipe: Recipe, position: Position) -> Floats:
    return recipe.true_vector(position, recipe.runs[0].seating)


def _id(layout: SensorLayout, node: int) -> int:
    return layout.sample.can_id - layout.map.node_of_dbc + node
