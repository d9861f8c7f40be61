"""Frames of one stop as they come in: all of them, and each unit's own, laid out for the log and hashed at once."""

from collections.abc import Sequence
from functools import reduce

import numpy as np

from station.domain.core.types import ERROR, Frames
from station.domain.records.framepack.plain import PlainFrames, PlainFramesBuilder
from station.service.station import Job
from station.service.unit import Unit


class FrameCollector:
    """What a stop keeps. A unit's frames are those of its node and of the gold reference, and the bus's error frames,
    which are everybody's."""

    def __init__(self, units: Sequence[Unit], job: Job) -> None:
        self._parts: list[Frames] = []
        self._laid = 0
        self._units = {u.seat.serial: (job.ids(u.seat.node), PlainFramesBuilder()) for u in units}

    def add(self, frames: Frames) -> None:
        """The next frames, whoever sent them."""
        self._parts.append(frames)

    def encode_pending(self) -> None:
        """Lays out and hashes what has been added since; done while a dwell goes on, little is left for its end."""
        new = Frames.join(self._parts[self._laid :])
        self._laid = len(self._parts)
        errors = (new.can_id & np.uint32(ERROR)) != 0
        for ids, laying in self._units.values():
            laying.add(new[reduce(np.logical_or, (new.can_id == np.uint32(i) for i in ids), errors)])

    def frames(self) -> Frames:
        """Everything that came, in the order of arrival."""
        return Frames.join(self._parts)

    def frames_of(self, unit: Unit) -> Frames:
        """What the unit keeps of what is laid out."""
        return self._units[unit.seat.serial][1].frames()

    def laid(self, unit: Unit) -> PlainFrames:
        """The same as the log keeps it."""
        return self._units[unit.seat.serial][1].done()
