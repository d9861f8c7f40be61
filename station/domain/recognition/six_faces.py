"""Visits on the six faces, which need no recipe to be told by: they are called after the faces, as `six-faces` calls
its positions."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from station.domain.capture.rest_detection import face
from station.domain.core.types import Floats
from station.domain.evaluation.quality import FACE_DEG
from station.domain.recognition.samples import UnitRecording, Visits
from station.domain.recognition.understanding import orientation_count
from station.messages import Message

#: The recipe of the six faces by hand, and the orientations that a recipe without known poses needs.
SIX_FACES, LEAST_POSES = "six-faces", 9


def called_after_faces(visited: Sequence[tuple[UnitRecording, Visits]]) -> list[tuple[UnitRecording, Visits]]:
    """The visits of all passes, called after the faces that point up where all lie on these; else as they came."""
    if not all(one.recording.unit == "g" and _lie_on_faces(pose_readings(one, v)) for one, v in visited):
        return list(visited)
    return [(one, _called(one, v)) for one, v in visited]


def pose_readings(one: UnitRecording, visits: Visits) -> Floats:
    """Mean readings (k, 3)."""
    return np.array([one.recording.reading[a:b].mean(axis=0) for a, b in visits.edges])


def are_faces(visits: Visits) -> bool:
    """Whether visits are called so."""
    return set(visits.names) <= set(_NAMES.values())


_NAMES = {f"{sign}{axis}": f"{axis}-{up}" for axis in "xyz" for sign, up in (("+", "up"), ("-", "down"))}


def _called(one: UnitRecording, visits: Visits) -> Visits:
    names = tuple(_NAMES[face(m)] for m in pose_readings(one, visits))
    if names == visits.names:
        return visits
    note = Message("visits-on-faces", file=one.recording.source, recipe=SIX_FACES)
    return replace(visits, names=names, remarks=(*visits.remarks, note))


def _lie_on_faces(means: Floats) -> bool:
    """Whether visits show all six faces and, at fewer orientations than tell a whole calibration, nothing else."""
    cosine = np.abs(means).max(axis=1) / np.maximum(np.linalg.norm(means, axis=1), 1e-300)
    near = bool((cosine > np.cos(np.radians(FACE_DEG))).all())
    return near and len({face(m) for m in means}) == 6 and orientation_count(means, "g") < LEAST_POSES
