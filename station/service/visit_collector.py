"""One visit of every nest while it comes in: each frame is laid out for the log, hashed and decoded once."""

from collections.abc import Iterable, Sequence
from functools import reduce

import numpy as np

from station.domain.can.decode import Samples
from station.domain.can.sample_decoder import SampleDecoder
from station.domain.capture.visit import CapturedVisit, Visit
from station.domain.core.types import ERROR, Floats, Frames
from station.domain.recipe.plan import PlannedVisit
from station.domain.records.framepack.plain import PlainFrames, PlainFramesBuilder
from station.messages import Message
from station.service.station import Job
from station.service.unit import Unit


class VisitCollector:
    """What a visit keeps. A unit's frames are those of its node and of the gold reference, and the bus's error frames,
    which are everybody's. `finish` says when the dwell was; `captured`, `encoded` and `visit` are read after it."""

    def __init__(self, units: Sequence[Unit], job: Job, arrived_ns: int, earlier: Iterable[Frames] = ()) -> None:
        self._job, self._arrived_ns = job, arrived_ns
        self._pending = list(earlier)
        self._builders = {u.seat.serial: (job.ids(u.seat.node), PlainFramesBuilder()) for u in units}
        self._decoders = {u.seat.serial: SampleDecoder(job.layout, u.seat.node) for u in units}
        self._gold = None if job.gold_node is None else SampleDecoder(job.layout, job.gold_node)
        self._dwell_ns = arrived_ns, arrived_ns
        self._drops = 0
        self._gold_samples: Samples | None = None

    def add(self, frames: Frames) -> None:
        """The next frames, whoever sent them."""
        self._pending.append(frames)

    def update(self) -> None:
        """Lays out, hashes and decodes what was added since; done while a dwell goes on, little is left for its end."""
        new, self._pending = Frames.join(self._pending), []
        errors = (new.can_id & np.uint32(ERROR)) != 0
        for serial, (ids, builder) in self._builders.items():
            own = new[reduce(np.logical_or, (new.can_id == np.uint32(i) for i in ids), errors)]
            builder.add(own)
            self._decoders[serial].add(own)
        if self._gold is not None:
            self._gold.add(new)

    def newest(self) -> dict[str, Samples]:
        """What the last update brought, by serial."""
        return {serial: decoder.newest() for serial, decoder in self._decoders.items()}

    def recent(self, from_ns: int) -> list[Samples]:
        """What each unit read from then on."""
        self.update()
        return [decoder.recent(from_ns) for decoder in self._decoders.values()]

    def readings(self, from_ns: int) -> dict[str, Floats]:
        """Usable readings (n, 3) of each unit from then on, by serial."""
        return {serial: decoder.samples(from_ns).readings for serial, decoder in self._decoders.items()}

    def gold_readings(self, from_ns: int) -> Floats | None:
        """The same of the gold reference; None where the recipe has another truth."""
        return None if self._gold is None else self._gold.samples(from_ns).readings

    def finish(self, from_ns: int, to_ns: int, drops: int) -> None:
        """The dwell was [from_ns, to_ns); drops: frames that the kernel dropped in it."""
        self.update()
        self._dwell_ns, self._drops = (from_ns, to_ns), drops
        self._gold_samples = None if self._gold is None else self._gold.samples(from_ns, to_ns)

    def captured(self, unit: Unit, planned: PlannedVisit) -> CapturedVisit:
        """The visit as the record keeps it."""
        return CapturedVisit(
            run=planned.run,
            visit=planned.visit,
            position=planned.position,
            seating=planned.seating,
            arrived_ns=self._arrived_ns,
            from_ns=self._dwell_ns[0],
            to_ns=self._dwell_ns[1],
            frames=self._builders[unit.seat.serial][1].frames(),
        )

    def encoded(self, unit: Unit) -> PlainFrames:
        """Its frames as the log keeps them."""
        return self._builders[unit.seat.serial][1].done()

    def visit(self, unit: Unit, planned: PlannedVisit, emergencies: tuple[Message, ...] = ()) -> Visit:
        """The visit as everything else takes it; without a new temperature the unit's last one counts."""
        samples = self._decoders[unit.seat.serial].samples(*self._dwell_ns)
        degC = samples.temperature_degC
        return Visit(
            run=planned.run,
            visit=planned.visit,
            position=planned.position,
            seating=planned.seating,
            arrived_ns=self._arrived_ns,
            from_ns=self._dwell_ns[0],
            to_ns=self._dwell_ns[1],
            samples=samples,
            gold=self._gold_samples,
            drops=self._drops,
            temperature_degC=float(degC[-1]) if len(degC) else unit.temperature_degC,
            emergencies=emergencies,
        )
