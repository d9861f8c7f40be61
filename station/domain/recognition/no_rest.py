"""Why a recording never rests: what it looks like, and what to do."""

import re

import numpy as np

from station.domain.core.types import Floats
from station.domain.recognition.recording import Recording
from station.errors import SamplesError

_WITHOUT_GRAVITY = re.compile(r"linear|user|free", re.IGNORECASE)
#: A counter goes on by one step, within this factor, at so many of its readings.
SAME_STEP, ALWAYS = 2.0, 0.98


def are_without_gravity(recording: Recording) -> bool:
    """Whether the names of the axes say that gravity was taken out of them."""
    return _WITHOUT_GRAVITY.search(" ".join(recording.axes)) is not None


def error_of(recording: Recording) -> SamplesError:
    """What to tell the person whose recording has no rest."""
    file, duration_s = recording.source, float(recording.time_s[-1])
    for name, reading in zip(recording.axes, recording.reading.T, strict=True):
        if _counts(reading):
            return SamplesError("axis-goes-on", file=file, axis=name)
    if recording.unit == "g" and are_without_gravity(recording):
        return SamplesError("linear-acceleration", file=file, axes=recording.axes)
    if recording.unit == "deg/s":
        return SamplesError("no-spins", file=file, rest_percent=0.0)
    return SamplesError("never-at-rest", file=file, duration_s=duration_s)


def _counts(reading: Floats) -> bool:
    """Whether an axis (n) goes on by the same step at nearly every reading, as no sensor does."""
    step = np.diff(reading)
    middle = float(np.median(step))
    if middle == 0:
        return False
    ratio = step / middle
    return bool(np.mean((ratio > 1 / SAME_STEP) & (ratio < SAME_STEP)) > ALWAYS)
