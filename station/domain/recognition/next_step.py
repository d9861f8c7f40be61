"""What a person does next with the visits that an import found: which recipe calibrates them."""

from collections.abc import Sequence

import numpy as np

from station.domain.capture.rest_detection import face
from station.domain.core.types import Floats
from station.domain.evaluation.quality import FACE_DEG
from station.domain.recognition.samples import UnitRecording, Visits
from station.domain.recognition.understanding import orientation_count
from station.messages import Message

#: The recipe for visits whose poses nobody knows, by unit.
HAND_HELD = {"g": "hand-held", "uT": "magnetometer-hand-held"}
#: The recipe of the six faces, and the orientations that hand-held needs.
FACES, LEAST_POSES = "six-point", 9


def of(visited: Sequence[tuple[UnitRecording, Visits]], recipe: str | None, file: str) -> Message | None:
    """The command that goes on with a table of visits in `file`, or the option that import lacked; recipe: the one that
    was stated. None where no recipe is known."""
    unit = visited[0][0].recording.unit
    if recipe is None and unit == "g" and all(_lies_on_faces(one.recording.reading, v) for one, v in visited):
        return Message("next-import-faces", recipe=FACES, poses=LEAST_POSES)
    known = recipe or HAND_HELD.get(unit)
    poses = min(orientation_count(_means(one.recording.reading, v), one.recording.unit) for one, v in visited)
    if recipe is None and known is not None and poses < LEAST_POSES:
        return Message("next-more-poses", recipe=known, poses=poses, needed=LEAST_POSES)
    return None if known is None else Message("next-calibrate", file=file, recipe=known)


def _means(reading: Floats, visits: Visits) -> Floats:
    return np.array([reading[a:b].mean(axis=0) for a, b in visits.edges])


def _lies_on_faces(reading: Floats, visits: Visits) -> bool:
    """Whether visits show all six faces and, at fewer orientations than tell a whole calibration, nothing else."""
    means = _means(reading, visits)
    cosine = np.abs(means).max(axis=1) / np.maximum(np.linalg.norm(means, axis=1), 1e-300)
    near = bool((cosine > np.cos(np.radians(FACE_DEG))).all())
    return near and len({face(m) for m in means}) == 6 and orientation_count(means, "g") < LEAST_POSES
