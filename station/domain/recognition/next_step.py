"""What a person does next with the visits that an import found: which recipe calibrates them."""

from collections.abc import Sequence

from station.domain.recognition.samples import UnitRecording, Visits
from station.domain.recognition.six_faces import LEAST_POSES, SIX_FACES, are_faces, pose_readings
from station.domain.recognition.understanding import orientation_count
from station.messages import Message

#: The recipe for visits whose poses nobody knows, by unit.
HAND_HELD = {"g": "hand-held", "uT": "magnetometer-hand-held"}


def of(visited: Sequence[tuple[UnitRecording, Visits]], recipe: str | None, file: str) -> Message | None:
    """The command that goes on with a table of visits in `file`, or the poses that it lacks; recipe: the one that was
    stated. None where no recipe is known."""
    unit = visited[0][0].recording.unit
    if recipe is None and unit == "g" and all(are_faces(v) for _, v in visited):
        return Message("next-calibrate", file=file, recipe=SIX_FACES)
    known = recipe or HAND_HELD.get(unit)
    poses = min(orientation_count(pose_readings(one, v), one.recording.unit) for one, v in visited)
    if recipe is None and known is not None and poses < LEAST_POSES:
        return Message("next-more-poses", recipe=known, poses=poses, needed=LEAST_POSES)
    return None if known is None else Message("next-calibrate", file=file, recipe=known)
