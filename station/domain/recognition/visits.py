"""Visits that a recording declares: blocks of so many readings or labels; or that its readings themselves show: blocks,
or a pose each."""

import numpy as np
from numpy.typing import NDArray

from station.domain.capture import rest_segments
from station.domain.core.types import Array, Floats
from station.domain.recognition.quantities import spans
from station.domain.recognition.raw_table import RawColumn
from station.errors import SamplesError, UsageError
from station.messages import Message

Ints = NDArray[np.int64]
#: A jump from one reading to the next is larger than this many times the usual difference.
JUMP = 12.0
#: This share of the jumps must lie at multiples of one number of readings to make blocks of it.
ON_GRID = 0.95
LEAST_BLOCK, LEAST_BLOCKS = 8, 6
#: Readings of a pose each: at least so many, in so many orientations, this near to one ellipsoid, of its size.
LEAST_READINGS, LEAST_POSES, NEAR_ELLIPSOID = 12, 9, 0.1
#: Readings that range over less than this share of their size hardly turn.
LEAST_REACH = 0.2
#: A list of a row a pose that is too short for one has at least so many rows, the longest at most so many times the
#: shortest: offsets may be half of gravity.
LEAST_ROWS, LONGEST_ROW = 4, 3.0
#: Its longest axis is at most so many times its shortest: a circle that is turned in one plane lies on many.
LONGEST_AXIS = 8.0
#: What scatters by this share of its own size does not rest, however quiet it is beside the rest of the recording.
RESTLESS = 0.2
#: Nor does a stretch rest whose parts lie this share apart: six degrees.
TURNS = 0.1
#: So many readings show an ellipsoid.
MOST_SHOWN = 2000
#: This share of them may be off it: one beside iron, one written wrongly.
FEW_OFF = 0.05


def blocks(file: str, reading: Floats, length: int) -> Ints:
    """First row and one past the last (k, 2) of blocks of `length` readings (n, 3). A last part shorter than half
    belongs to the block before it where it goes on in that pose, so that one rest is whole however it is cut."""
    readings = len(reading)
    if not 1 <= length <= readings // 2:
        raise UsageError("blocks-do-not-fit", file=file, blocks=length, readings=readings)
    begin = np.arange(0, readings, length)
    edges = np.stack([begin, np.minimum(begin + length, readings)], axis=1)
    whole = np.asarray(edges[edges[:, 1] - edges[:, 0] > length // 2])
    first, end = (int(edge) for edge in whole[-1])
    if end < readings:
        here, there = reading[first:end].mean(axis=0), reading[end:].mean(axis=0)
        if np.linalg.norm(there - here) < rest_segments.STEP_SHARE * np.linalg.norm(here):
            whole[-1, 1] = readings
    return whole


def labelled(file: str, column: RawColumn, keep: Array) -> tuple[Ints, tuple[str, ...]]:
    """Runs of one label (k, 2) among the rows kept, and the labels; rows without a label belong to none."""
    if column.text is not None:
        text = column.text.text()[keep]
    else:
        assert column.values is not None
        text = np.array([f"{v:g}" if np.isfinite(v) else "" for v in np.asarray(column.values, float)[keep]], object)
    begin = np.flatnonzero(np.r_[True, text[1:] != text[:-1]])
    end = np.r_[begin[1:], len(text)]
    listed = len(begin) == len(text)
    least = 1 if listed else 2  # of single readings among parts each is a slip
    runs = [
        (a, b) for a, b in zip(begin.tolist(), end.tolist(), strict=True) if str(text[a]).strip() and b - a >= least
    ]
    if not runs:
        raise SamplesError("labels-empty", file=file, column=column.name)
    return np.array(runs, np.int64), tuple(str(text[a]).strip() for a, _ in runs)


def rests(reading: Floats, size: float) -> bool:
    """Whether a stretch (n, 3) that is quiet beside the rest of its recording rests beside what it measures, too."""
    quiet = np.linalg.norm(reading.std(axis=0)) < RESTLESS * size
    return bool(quiet and rest_segments.wandering(reading) < TURNS * size)


def mostly_rest(reading: Floats, edges: Ints) -> bool:
    """Whether at least half of parts (k, 2) of readings rest: phases of a flight, or gestures, do not."""
    size = float(np.median(np.linalg.norm(reading, axis=1)))
    return 2 * sum(rests(reading[a:b], size) for a, b in edges) >= len(edges)


def shown_blocks(reading: Floats) -> int:
    """Readings of a block, where the readings (n, 3) jump at multiples of one number and nowhere else; else 0."""
    apart = np.linalg.norm(np.diff(reading, axis=0), axis=1)
    usual = float(np.median(apart))
    jumps = np.flatnonzero(apart > JUMP * usual) + 1 if usual > 0 else np.zeros(0, np.int64)
    if len(jumps) < LEAST_BLOCKS - 1:
        return 0
    lengths, times = np.unique(np.diff(np.r_[0, jumps]), return_counts=True)
    length = int(lengths[np.argmax(times)])
    on_grid = float(np.mean(jumps % length == 0)) if length >= LEAST_BLOCK else 0.0
    # Most of the places where a block may end show a jump.
    filled = len(jumps) / max(len(reading) // length - 1, 1) if length else 0.0
    return length if on_grid >= ON_GRID and filled > 0.7 else 0


def is_pose_each(reading: Floats, *, any_offset: bool = False) -> bool:
    """Whether readings (n, 3) that never rest are a pose each, as lists for compass programs are: all but a few lie on
    one ellipsoid and go round it, which nothing that drives or shakes does. any_offset: of a compass, whose iron may
    be many times the field."""
    return why_no_poses(reading, any_offset=any_offset) is None


def why_no_poses(reading: Floats, *, any_offset: bool = False) -> Message | None:
    """What keeps readings (n, 3) from being a pose each of a stimulus of one magnitude; None where nothing does."""
    if len(reading) < LEAST_READINGS:
        return Message("list-of-few", readings=len(reading), least=LEAST_READINGS)
    found = _drawn_to_a_sphere(reading)
    size, reach = float(np.median(np.linalg.norm(reading, axis=1))), float(np.ptp(reading, axis=0).max())
    if reach < LEAST_REACH * size and not (any_offset and found is not None and _goes_round(found)):
        return Message("list-in-one-pose", readings=len(reading), percent=100 * reach / size)
    if found is None:
        return Message("list-on-no-ellipsoid", readings=len(reading))
    off = _off(found)
    if off >= NEAR_ELLIPSOID:
        return Message("list-off-ellipsoid", readings=len(reading), percent=100 * off, most=100 * NEAR_ELLIPSOID)
    if not _goes_round(found):
        poses = int(rest_segments.orientations(found).max()) + 1
        return Message("list-on-one-side", readings=len(reading), poses=poses)
    return None


def _goes_round(points: Floats) -> bool:
    """Whether points (n, 3) about the unit sphere lie on all its sides, in as many orientations as tell one."""
    enough = int(rest_segments.orientations(points).max()) + 1 >= LEAST_POSES
    return enough and spans(points, np.zeros(3), 1.0)


def is_row_a_pose(reading: Floats) -> bool:
    """Whether readings (n, 3), too few for an ellipsoid, are of one size in as many orientations, as a list of means
    is."""
    size = np.linalg.norm(reading, axis=1)
    if not LEAST_ROWS <= len(reading) < LEAST_READINGS or not size.min() > 0:
        return False
    poses = int(rest_segments.orientations(reading).max()) + 1
    return poses == len(reading) and bool(size.max() < LONGEST_ROW * size.min())


def off_ellipsoid(reading: Floats) -> float:
    """How far readings (n, 3) stand off one ellipsoid, of its size (rms), all but a few; endless where they lie on
    none or do not go round it."""
    found = _drawn_to_a_sphere(reading[:: len(reading) // MOST_SHOWN + 1])
    return np.inf if found is None or not spans(found, np.zeros(3), 1.0) else _off(found)


def _off(points: Floats) -> float:
    return float(np.sqrt(np.mean((np.linalg.norm(points, axis=1) - 1) ** 2)))


def _drawn_to_a_sphere(reading: Floats) -> Floats | None:
    """All but a few readings (n, 3), drawn to a sphere about zero by their ellipsoid; None where they lie on none."""
    middle, size = reading.mean(axis=0), float(reading.std(axis=0).max())
    if not size > 0:
        return None
    points = (reading - middle) / size
    found = _on_unit_sphere(points)
    if found is None:
        return None
    off = np.abs(np.linalg.norm(found, axis=1) - 1)
    return _on_unit_sphere(points[off <= np.quantile(off, 1 - FEW_OFF)])


def _on_unit_sphere(points: Floats) -> Floats | None:
    """Points (n, 3) drawn to a sphere by the ellipsoid fitted to them; None where they lie on none."""
    x, y, z = points.T
    terms = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z], axis=1)
    p = np.linalg.lstsq(terms, np.ones(len(terms)), rcond=None)[0]
    shape = np.array([[p[0], p[3], p[4]], [p[3], p[1], p[5]], [p[4], p[5], p[2]]])
    values, axes = np.linalg.eigh(shape)
    if not values[0] > values[-1] / LONGEST_AXIS**2:
        return None
    centre = -np.linalg.solve(shape, p[6:])
    radius = np.sqrt(1 + centre @ shape @ centre)
    return np.asarray(((points - centre) @ axes) * np.sqrt(values) / radius)
