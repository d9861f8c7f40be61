"""A simulated campaign as CAN frames: what a logger on the bus of the fixture would have recorded, moves included."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.can import encode
from station.domain.can.sensor_layout import SensorLayout
from station.domain.capture.annotations import Annotation, Annotations
from station.domain.core import rotation
from station.domain.core.types import Floats, Frames
from station.errors import UsageError
from station.model.campaign import Campaign, campaign_of
from station.model.forward import sensor_signal, signal_during_moves
from station.model.recording import arrivals, repetition_delay_s, run_slices, thermometer_noise
from station.model.scene import Scene
from station.model.simulate import SimulatedUnits, SimulationJob, device_output, rates_of
from station.model.timeline import FleetPart

#: Where simulated time starts: 2026-01-01T00:00:00Z.
SIMULATION_EPOCH_NS = 1_767_225_600_000_000_000
#: A device tells its temperature once in so many seconds.
TEMPERATURE_EVERY_S = 1.0
#: The last node id that frames may have; each nest of the fixture has its own.
MAX_NODE_ID = 127


@dataclass(frozen=True, slots=True, eq=False)
class FrameRecording:
    """Frames in the order of time, the marks of every dwell, and what they were made of."""

    frames: Frames
    marks: Annotations
    made: SimulatedUnits


def simulate_frames(job: SimulationJob, layout: SensorLayout) -> FrameRecording:
    """The frames of all units of a job. The unit in the fixture's k-th seat has node id k."""
    job, part = job.with_drawn_form(), FleetPart(job.units)
    if job.line.nests > MAX_NODE_ID:
        raise UsageError("too-many-nests", nests=job.line.nests, limit=MAX_NODE_ID)
    rates = rates_of(job, part)
    campaign = campaign_of(job.recipe, part, job.seed, job.line)
    scene, moving = _every_sample(campaign, rates)
    made = SimulatedUnits(part.units, job.base(part.units), job.active(scene), scene)
    signal = signal_during_moves(sensor_signal(scene, made.active), moving, _plate(campaign, scene, moving))
    reading = device_output(job, signal, made.base, made.active)
    frames = Frames.join(_sent(job, layout, made, reading))
    frames = frames[np.argsort(frames.time_ns, kind="stable")]
    return FrameRecording(frames, _marks(campaign, frames), made)


def node_of(unit: int, nests: int) -> int:
    """Node id of the unit of that number: its seat in the fixture, from 1."""
    return unit % nests + 1


def _every_sample(campaign: Campaign, rate_hz: Floats) -> tuple[Scene, NDArray[np.bool_]]:
    """Every sample of every run from its first move to its last dwell, and which (n) are on the way to their visit."""
    visits, since, first = [], [], 0
    for rate in rate_hz:
        for done in campaign.rounds:
            time_s = np.arange(int(done.duration_s * rate)) / rate
            leaves = done.arrival_s + campaign.recipe.settle.time_s + done.dwell_s
            stop = np.searchsorted(leaves[:-1], time_s, side="right")
            visits.append(first + stop)
            since.append(time_s - done.arrival_s[stop])
            first += len(done.position)
    since_s = np.concatenate(since)
    return campaign.scene(np.concatenate(visits), since_s), since_s < 0


def _plate(campaign: Campaign, scene: Scene, moving: NDArray[np.bool_]) -> Floats:
    """Nest → station rotation (m, 3, 3) of the moving samples: from the last visit, or the park, the shortest way."""
    visits, row = scene.visits, scene.visit[moving]
    previous, arrival = visits.previous, campaign.arrival_s()
    known = previous >= 0
    origin = np.where(known[:, None, None], visits.nest_R[previous], np.eye(3))
    stay = campaign.recipe.settle.time_s + campaign.dwell_s()
    departs = np.where(known, arrival[previous] + stay, 0.0)
    turn = rotation.to_vector(visits.nest_R @ np.swapaxes(origin, 1, 2))
    share = (scene.time_s[moving] - departs[row]) / (arrival - departs)[row]
    smooth = share * share * (3 - 2 * share)
    return np.asarray(rotation.from_vector(smooth[:, None] * turn[row]) @ origin[row])


def _sent(job: SimulationJob, layout: SensorLayout, made: SimulatedUnits, reading: Floats) -> list[Frames]:
    """Sample frames of every unit's every run, after the faults of the bus, and temperature frames."""
    scene, rate_hz = made.scene, job.recipe.device.rate_hz
    time_ns = SIMULATION_EPOCH_NS + np.rint((scene.require("started_s") + scene.time_s) * 1e9).astype(np.int64)
    shown = scene.require("temperature_degC") + thermometer_noise(scene, job.seed)
    readings, temperatures = [], []
    for unit, rows in run_slices(scene):
        node = node_of(unit, job.line.nests)
        count = round(float(scene.require("since_power_s")[rows.start]) * rate_hz)
        sent = encode.sample_frames(
            layout, node, time_ns[rows], reading[rows], first_count=count, temperature_degC=shown[rows]
        )
        readings.append(sent)
        slow = slice(rows.start, rows.stop, max(1, round(TEMPERATURE_EVERY_S * rate_hz)))
        temperatures.append(encode.temperature_frames(layout, node, time_ns[slow], shown[slow]))
    sent_index, arrived_index = arrivals(scene, made.active, job.seed)
    late_ns = np.rint(repetition_delay_s(sent_index) * 1e9).astype(np.int64)
    return [replace(Frames.join(readings)[arrived_index], time_ns=time_ns[sent_index] + late_ns), *temperatures]


def _marks(campaign: Campaign, frames: Frames) -> Annotations:
    """The dwells, s from the log's first frame."""
    visits = campaign.visits
    zero_s = (int(frames.time_ns[0]) - SIMULATION_EPOCH_NS) / 1e9
    begins = campaign.started_s() + campaign.arrival_s() + campaign.recipe.settle.time_s - zero_s
    dwell = campaign.dwell_s()
    texts = zip(visits.unit.text(), visits.position.text(), visits.seating.text(), strict=True)
    marks = (
        Annotation(
            unit=unit,
            node=node_of(int(visits.unit.code[i]), campaign.line.nests),
            run=int(visits.run[i]),
            visit=int(visits.visit[i]),
            position=position,
            start_s=round(float(begins[i]), 6),
            end_s=round(float(begins[i] + dwell[i]), 6),
            seating=seating,
        )
        for i, (unit, position, seating) in enumerate(texts)
    )
    return Annotations(recipe=campaign.recipe.name, marks=tuple(marks))
