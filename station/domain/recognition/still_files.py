"""Several recordings that hold one still pose each → one recording of one unit, a visit a file.

People who turn a unit by hand often record each pose into a file of its own. Six such files are no six units of one
pose if their poses complement one another; and one scale holds for all of them, for the size of gravity in a single
pose is as much the sensor's gain as the unit of its readings.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from station.domain.capture import rest_segments
from station.domain.core.types import Floats
from station.domain.recognition import header_unit, quantities
from station.domain.recognition.quantities import QUANTITIES, UnitScale
from station.domain.recognition.recording import Recording
from station.errors import SamplesError
from station.messages import Message

#: Files of one unit hold at least so many different orientations, so there are at least so many files …
LEAST_POSES = 3
#: … and each rests for at least this share of its time.
LEAST_REST = 0.5
#: A file too short to look for rest in holds none where its parts lie this share of their size apart.
MOVES = 0.1
#: Between the last reading of a file and the first of the next, s: how long it really took is in no file.
PAUSE_S = 10.0
#: How the visits of such a unit were found.
FOUND_BY = "files"

Rest = tuple[int, int]
#: A file's folder and its name without ending.
FileName = tuple[str, str]


def units_of_poses(
    files: Sequence[FileName], recordings: Sequence[Recording], serial: str | None
) -> list[tuple[str, Recording]] | None:
    """The units whose poses are in those files, each by its serial with one recording of all its visits; None where
    the files are no different poses of one unit or of several. serial: what a person calls the one unit. Errors:
    SamplesError where one file alone of a unit does not rest."""
    for groups in _groupings(files):
        found: list[tuple[str, Recording]] = []
        for group in groups:
            own = [files[i] for i in group]
            name = serial if serial is not None and len(groups) == 1 else _serial_of(own)
            whole = _join([recordings[i] for i in group], [stem for _, stem in own], name)
            if whole is None:
                break
            found.append((name, whole))
        else:
            return found
    return None


def _groupings(files: Sequence[FileName]) -> Iterator[list[list[int]]]:
    """Places of the files of each unit: told apart by the beginning of their names, the longest first; by their folder;
    or all of one unit."""
    words = [re.split(r"[-_. ]+", stem) for _, stem in files]
    keys: list[list[tuple[str, ...]]] = [
        [(folder, *w[:k]) for (folder, _), w in zip(files, words, strict=True)]
        for k in range(max(map(len, words)) - 1, -1, -1)
    ]
    for key in keys:
        groups = [[i for i, other in enumerate(key) if other == one] for one in dict.fromkeys(key)]
        if len(groups) > 1 and min(map(len, groups)) >= LEAST_POSES:
            yield groups
    yield [list(range(len(files)))]


def _serial_of(files: Sequence[FileName]) -> str:
    """What the names of one unit's files begin with, else their folder's name."""
    stems = [stem for _, stem in files]
    shared = next(
        (i for i, letters in enumerate(zip(*stems, strict=False)) if len(set(letters)) > 1), min(map(len, stems))
    )
    return stems[0][:shared].rstrip("-_. ") or re.split(r"[/\\]", files[0][0])[-1].strip(".") or "unit"


def _join(recordings: Sequence[Recording], names: Sequence[str], serial: str) -> Recording | None:
    """One recording of unit `serial` whose visits are those files, called `names`, with the remark that they are; None
    where the files are no different poses of one unit.

    The rest in each file is its visit. Readings are brought to one scale, which all files tell together. Errors:
    SamplesError where one file alone does not rest.
    """
    if len(recordings) < LEAST_POSES or len({(r.axes, r.unit) for r in recordings}) > 1:
        return None
    rests = [_rest(r) for r in recordings]
    scale, doubts = _common_scale(recordings, rests)
    moving = [r for r, own in zip(recordings, rests, strict=True) if not own]
    if len(moving) == 1 and _join([r for r in recordings if r is not moving[0]], names, serial) is not None:
        raise SamplesError("pose-file-moves", file=moving[0].source, files=len(recordings) - 1)
    if scale is None or moving:
        return None
    readings = [(_raw(r) - scale.zero) * scale.factor for r in recordings]
    means = np.array([y[a:b].mean(axis=0) for y, own in zip(readings, rests, strict=True) for a, b in own])
    pose = rest_segments.orientations(means)
    file = np.repeat(np.arange(len(rests)), [len(own) for own in rests])
    one_each = all(len(set(pose[file == i].tolist())) == 1 for i in range(len(rests)))
    poses = len(set(pose.tolist()))
    if not one_each or poses < LEAST_POSES:
        return None
    whole = _concatenated(recordings, readings, [max(own, key=_length) for own in rests], names, scale)
    remark = Message("files-of-one-unit", first=names[0], last=names[-1], files=len(names), poses=poses, unit=serial)
    return replace(whole, remarks=(*whole.remarks, *doubts, remark))


def _length(rest: Rest) -> int:
    return rest[1] - rest[0]


def _rest(r: Recording) -> list[Rest]:
    """Where a recording rests, if it does for most of its time; all of one that is too short to tell and goes
    nowhere."""
    try:
        found = [(int(a), int(b)) for a, b in rest_segments.find(r.time_s, r.reading)]
    except SamplesError:
        size = float(np.median(np.linalg.norm(r.reading, axis=1)))
        return [(0, len(r))] if rest_segments.wandering(r.reading) < MOVES * size else []
    return found if sum(map(_length, found)) >= LEAST_REST * len(r) else []


def _raw(r: Recording) -> Floats:
    return np.asarray(r.reading / r.scale.factor + r.scale.zero)


def _common_scale(
    recordings: Sequence[Recording], rests: Sequence[list[Rest]]
) -> tuple[UnitScale | None, tuple[Message, ...]]:
    """The scale that was stated for every file, if all poses together do not contradict a header; else the one that
    they tell; None where no pose does. And what is said of it."""
    scales = [r.scale for r in recordings]
    stated = not any(s.inferred or s.unit == "LSB" for s in scales)
    if stated and len(set(scales)) > 1:
        return None, ()
    raws = [_raw(r) for r in recordings]
    means = np.array([raw[a:b].mean(axis=0) for raw, own in zip(raws, rests, strict=True) for a, b in own])
    quantity = QUANTITIES[recordings[0].unit]
    whole = all(bool(np.all(np.abs(raw - np.round(raw)) < 1e-6 * np.maximum(np.abs(raw), 1))) for raw in raws)
    if stated:
        return header_unit.believed(recordings[0].source, means, scales[0], quantity, whole=whole)
    if not len(means):
        return None, ()
    found = quantities.from_magnitude(means, quantity, whole=whole)
    return replace(found, inferred=any(s.inferred for s in scales)), ()


def _concatenated(
    recordings: Sequence[Recording],
    readings: Sequence[Floats],
    rests: Sequence[Rest],
    names: Sequence[str],
    scale: UnitScale,
) -> Recording:
    first = recordings[0]
    begin = np.cumsum([0, *(len(r) for r in recordings[:-1])])
    start_s = np.cumsum([0.0, *(float(r.time_s[-1]) + PAUSE_S for r in recordings[:-1])])
    time_s = np.concatenate([r.time_s + t for r, t in zip(recordings, start_s, strict=True)])
    warm = [r.temperature_degC for r in recordings]
    clock = replace(
        first.clock,
        time_s=time_s,
        order=np.arange(len(time_s)),
        rate_hz=float(np.median([r.clock.rate_hz for r in recordings])),
        jitter_s=max(r.clock.jitter_s for r in recordings),
        gaps=sum(r.clock.gaps for r in recordings),
        restarts=sum(r.clock.restarts for r in recordings),
    )
    return replace(
        first,
        source=f"{first.source} … {names[-1]}",
        time_s=time_s,
        reading=np.concatenate(readings),
        temperature_degC=None if any(w is None for w in warm) else np.concatenate([w for w in warm if w is not None]),
        edges=np.array([(a + k, b + k) for (a, b), k in zip(rests, begin.tolist(), strict=True)], np.int64),
        names=tuple(names),
        declared=FOUND_BY,
        clock=clock,
        scale=scale,
        remarks=tuple(dict.fromkeys(m for r in recordings for m in r.remarks)),
    )
