"""One visit of one unit: as frames, which the record keeps, and as samples, which everything else takes."""

from dataclasses import dataclass, replace

from station.domain.can.decode import Samples, decode_samples, decode_temperatures
from station.domain.can.sensor_layout import SensorLayout
from station.domain.core.types import Floats, Frames
from station.messages import Message


@dataclass(frozen=True, slots=True, eq=False)
class CapturedVisit:
    """A visit as the record keeps it. The dwell is [from_ns, to_ns); frames may reach beyond it."""

    run: int
    visit: int
    position: str
    seating: str
    arrived_ns: int
    from_ns: int
    to_ns: int
    frames: Frames


@dataclass(frozen=True, slots=True, eq=False)
class Visit:
    """A visit decoded, once for all that follows: checks, statistics, calibration, verification.

    samples: the dwell's readings, with the temperatures since the arrival; gold: the dwell of the gold reference, or
    None; drops: frames that the kernel dropped; temperature_degC: the last one read, or None; emergencies: EMCY
    messages in words.
    """

    run: int
    visit: int
    position: str
    seating: str
    arrived_ns: int
    from_ns: int
    to_ns: int
    samples: Samples
    gold: Samples | None = None
    drops: int = 0
    temperature_degC: float | None = None
    emergencies: tuple[Message, ...] = ()

    @property
    def lasted_s(self) -> float:
        """Length of the dwell, s."""
        return (self.to_ns - self.from_ns) / 1e9

    @property
    def readings(self) -> Floats:
        """The usable readings of the dwell (n, 3)."""
        return self.samples.readings


def decode_visit(captured: CapturedVisit, layout: SensorLayout, node: int, gold_node: int | None = None) -> Visit:
    """The visit of a record or recording; the same samples, bit for bit, as a live run decoded from these frames.

    gold_node: of a gold reference whose frames are among the visit's.
    """
    dwell = dwell_frames(captured)
    temperature_time_ns, temperature_degC = decode_temperatures(captured.frames, layout, node)
    samples = replace(
        decode_samples(dwell, layout, node), temperature_time_ns=temperature_time_ns, temperature_degC=temperature_degC
    )
    return Visit(
        run=captured.run,
        visit=captured.visit,
        position=captured.position,
        seating=captured.seating,
        arrived_ns=captured.arrived_ns,
        from_ns=captured.from_ns,
        to_ns=captured.to_ns,
        samples=samples,
        gold=None if gold_node is None else decode_samples(dwell, layout, gold_node),
        temperature_degC=float(temperature_degC[-1]) if len(temperature_degC) else None,
    )


def dwell_frames(visit: CapturedVisit) -> Frames:
    """The frames of the dwell proper, in the order of arrival."""
    time_ns = visit.frames.time_ns
    return visit.frames[(time_ns >= visit.from_ns) & (time_ns < visit.to_ns)]
