"""Frames of one stop as they come in: all of them, and each unit's own, laid out for the log and hashed at once."""

from collections.abc import Sequence

import numpy as np

from station.domain.framepack.plain import Laid, Laying
from station.domain.types import ERROR, Frames
from station.service.station import Job
from station.service.unit import Unit


class Intake:
    """What a stop keeps. A unit's frames are those of its node and of the gold reference, and the bus's error frames,
    which are everybody's. What is done here is done while the dwell goes on, not when it is over."""

    def __init__(self, units: Sequence[Unit], job: Job) -> None:
        self._parts: list[Frames] = []
        self._units = {u.seat.serial: (np.array(job.ids(u.seat.node), np.uint32), Laying()) for u in units}

    def add(self, frames: Frames) -> None:
        """The next frames, whoever sent them."""
        self._parts.append(frames)
        errors = (frames.can_id & np.uint32(ERROR)) != 0
        for ids, laying in self._units.values():
            laying.add(frames[np.isin(frames.can_id, ids) | errors])

    def frames(self) -> Frames:
        """Everything that came, in the order of arrival."""
        return Frames.join(self._parts)

    def frames_of(self, unit: Unit) -> Frames:
        """What the unit keeps of it."""
        return self._units[unit.seat.serial][1].frames()

    def laid(self, unit: Unit) -> Laid:
        """The same as the log keeps it."""
        return self._units[unit.seat.serial][1].done()
