"""The wait for a person who turns the fixture: which nests show the wanted face, are still, or cannot tell."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from station.domain.can.decode import Samples
from station.domain.can.sample_decoder import SampleDecoder
from station.domain.capture import turn_check
from station.domain.capture.rest_detection import FACE_DEG, angle_deg, at_rest, expected_noise, face, has_direction
from station.domain.core.types import Floats, Frames
from station.domain.recipe import sensor
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.recipe import Recipe
from station.messages import Message
from station.service.silence import SILENT_S
from station.service.station import Job
from station.service.unit import Unit

#: The readings that tell rest at least.
HOLD_READINGS = 16
#: A hand needs so long to let go, s.
HOLD_BY_HAND_S = 0.6
#: Where any pose will do, the next one is so far from the last, degrees.
POSE_CHANGE_MIN_DEG = 15.0
#: Where the first position cannot be told from the readings, it counts once the fixture was turned, or stood still for
#: so long, s: it may have stood there already.
FIRST_STANDS_S = 10.0
#: A fixture turns all nests alike: a nest that shows something else while others have been right and still for so
#: long, s, is not waited for. It is measured with them, and the visit's check says what is wrong with it.
OUTVOTED_S = 30.0


class FaceWait:
    """What the nests show, look by look. begun_s: monotonic; face_s: how long is waited in all.

    over: the fixture stands as it should; silent: units that send nothing, for which nobody needs to turn it. A unit
    whose frames hold no reading cannot tell how it lies either: it is measured with the others, for its check to name
    what is wrong with the frames.
    """

    def __init__(self, units: Sequence[Unit], job: Job, planned: PlannedVisit, begun_s: float, face_s: float) -> None:
        self._units, self._recipe, self._planned, self._map = units, job.recipe, planned, job.product.map
        self._decoders = [SampleDecoder(job.layout, unit.seat.node) for unit in units]
        self._noise, self._lsb = expected_noise(job.recipe), max(abs(axis.scale) for axis in job.layout.axes)
        self._window_s = window_s(HOLD_BY_HAND_S, job.recipe)
        self._outvoted_s = min(OUTVOTED_S, face_s / 2)
        self._period_s = max(SILENT_S, self._window_s)
        self._until_s, self._agreed_s = begun_s + self._period_s, begun_s
        self._heard: set[str] = set()
        self._readable: set[str] = set()
        self._unreadable: set[str] = set()
        self._turned, self._stands_at_s, self._stands = False, begun_s + FIRST_STANDS_S, False
        self._shown: Mapping[str, Message | None] = {}
        self.over = False
        self.silent: tuple[Unit, ...] = ()

    def look(self, newest: Frames, now_s: float, now_ns: int) -> None:
        """The frames that came since the last look; now_s: monotonic, now_ns: on the frames' clock."""
        from_ns = now_ns - round(self._window_s * 1e9)
        self._stands = now_s >= self._stands_at_s
        windows: dict[str, Floats] = {}
        for unit, decoder in zip(self._units, self._decoders, strict=True):
            decoder.add(newest)
            decoder.forget(from_ns)
            recent, serial = decoder.recent(from_ns), unit.seat.serial
            windows[serial] = rest_window(recent, HOLD_BY_HAND_S, self._recipe)
            self._heard |= {serial} if recent.frame_errors.frames else set()
            self._readable |= {serial} if len(windows[serial]) else set()
        if now_s >= self._until_s:
            self._end_period(now_s)
        if not self.silent:
            self._decide(windows, now_s)

    def wrong_faces(self) -> Iterator[Message]:
        """What is up instead, once the fixture was turned and everything is still."""
        found = [message for message in self._shown.values() if message is not None]
        if self._turned and not any(message.id == "nest-not-still" for message in found):
            yield from found

    @property
    def found(self) -> tuple[Message, ...]:
        """What the nests that are not as they should be show."""
        return tuple(message for message in self._shown.values() if message is not None)

    def _end_period(self, now_s: float) -> None:
        """Who has sent nothing, or nothing that can be read."""
        serials = {unit.seat.serial for unit in self._units}
        self.silent = tuple(unit for unit in self._units if unit.seat.serial not in self._heard)
        self._unreadable = serials - self._readable
        self._heard, self._readable, self._until_s = set(), set(), now_s + self._period_s
        self.over = bool(self.silent)

    def _decide(self, windows: Mapping[str, Floats], now_s: float) -> None:
        asked = [unit for unit in self._units if unit.seat.serial not in self._unreadable]
        self._shown = {u.seat.serial: self._instead(u, windows[u.seat.serial]) for u in asked}
        self._turned = self._turned or (
            all(len(windows[u.seat.serial]) for u in asked) and any(m.id == "nest-not-still" for m in self.found)
        )
        wrong = [serial for serial, message in self._shown.items() if message is not None]
        right = [serial for serial in self._shown if serial not in wrong]
        if not right or not self._recipe.pose_known or any(self._agrees(windows, s, right) for s in wrong):
            self._agreed_s = now_s
        self.over = not wrong or now_s - self._agreed_s >= self._outvoted_s

    def _instead(self, unit: Unit, window: Floats) -> Message | None:
        """What the nest shows instead; None where it is right. Where any pose will do, it must be another one."""
        nest = unit.seat.nest
        if not at_rest(window, self._noise, self._lsb):
            return Message("nest-not-still", nest=nest)
        mean = np.asarray(window.mean(axis=0))
        if not self._recipe.pose_known:
            last = unit.last_shown
            same = last is not None and angle_deg(mean, last[0]) < POSE_CHANGE_MIN_DEG
            return Message("same-face-up", nest=nest) if same else None
        true = self._planned.true
        if has_direction(true, self._recipe):
            return None if angle_deg(mean, true) <= FACE_DEG else Message("other-face-up", nest=nest, face=face(mean))
        return None if self._shows(unit, mean) else Message("other-position", nest=nest)

    def _shows(self, unit: Unit, mean: Floats) -> bool:
        """Whether a unit whose readings have no face of their own shows the position that was asked for."""
        recipe, true = self._recipe, self._planned.true
        if not sensor.of(recipe).large_offset:
            return True
        found = None if unit.fit is None else unit.fit.calibration
        if found is not None:
            return turn_check.shows_calibrated(mean if self._map.corrects else found.correct(mean), true, recipe)
        if unit.last_shown is None and not recipe.converts:
            return self._turned or self._stands
        return turn_check.shows(mean, true, unit.last_shown, recipe)

    def _agrees(self, windows: Mapping[str, Floats], serial: str, right: Sequence[str]) -> bool:
        """Whether a nest that is still, but not right, shows what a right one does: it lies at the limit of both."""
        message = self._shown[serial]
        if message is None or message.id != "other-face-up":
            return False
        mean = np.asarray(windows[serial].mean(axis=0))
        return any(angle_deg(mean, np.asarray(windows[other].mean(axis=0))) <= FACE_DEG for other in right)


def window_s(hold_s: float, recipe: Recipe) -> float:
    """How far back readings are looked at for rest: twice what it takes, for slow devices too."""
    return 2 * max(hold_s, HOLD_READINGS / recipe.device.rate_hz)


def rest_window(samples: Samples, hold_s: float, recipe: Recipe) -> Floats:
    """The newest readings (n, 3), long enough to tell rest from movement; none when they are too few."""
    count = max(HOLD_READINGS, round(hold_s * recipe.device.rate_hz))
    readings = samples.readings
    return readings[-count:] if len(readings) >= count else readings[:0]
