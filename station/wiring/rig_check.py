"""`station rig check`: the rig of config.yaml, its drives and the units in its nests, opened for commissioning."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.network import ServiceNetwork, service_ids
from station.adapters.clock import SystemClock
from station.adapters.positioner.cia402 import Cia402Positioner
from station.config.rigs import load_rig
from station.config.settings import load_config
from station.domain.can.sample_decoder import SampleDecoder
from station.domain.core.types import Floats, Frames, NestAssignment
from station.domain.rig.rig_map import RigMap
from station.errors import PositionerFault, UsageError
from station.messages import Message
from station.ports.bus import Bus
from station.ports.clock import Clock
from station.service.rig_check import RigCheck, check_rig
from station.service.station import Job
from station.wiring.bench import units_bus_of
from station.wiring.jobs import load_job
from station.wiring.positioners import SIMULATED, bus_of_drives, positioner_options
from station.wiring.rehearsal import is_rehearsal
from station.wiring.run_order import RunOrder
from station.wiring.simulated import SimulatedFixture

KIND = "cia402"
#: Until the units feel nothing of the move, and how long they are read then, s.
SETTLE_S, READ_S = 0.5, 0.5
_MIN_READINGS = 8


def commission(order: RunOrder, speed_deg_s: float, tell: Callable[[Message], None]) -> RigCheck:
    """Commissions the rig.

    Errors: UsageError, ConfigError, RecipeError before anything moves; PositionerFault, BusFault, DeviceSilent.
    """
    settings, document = load_config(order.config)
    if settings.positioner.kind != KIND:
        raise UsageError("rig-check-kind", kind=settings.positioner.kind)
    job, source = load_job(order.recipe or settings.recipe)
    if job.recipe.sensor != "accelerometer" or job.recipe.unit != "g":
        raise UsageError("rig-check-sensor", recipe=job.recipe.name)
    options = positioner_options(settings, document)
    rig = load_rig(options.map)
    nodes = [nest.node for nest in settings.nests]
    with ExitStack() as opened:
        if order.simulate or is_rehearsal(settings):
            twin = settings.positioner.model_copy(update={"channel": SIMULATED})
            in_process = settings.model_copy(update={"positioner": twin})
            fixture = SimulatedFixture(in_process, document, job, source, order)
            fixture.place([NestAssignment(f"SN{i + 1:04d}", n.name, n.node) for i, n in enumerate(settings.nests)])
            clock: Clock = fixture.clock
            bus: Bus = fixture.bus
            drives = bus
        else:
            clock = SystemClock()
            if options.channel == SIMULATED:
                raise UsageError("rig-without-bus")
            bus = units_bus_of(settings, document, clock, opened)
            drives = bus_of_drives(settings, document, clock, lambda: bus, opened)
        opened.callback(bus.close)
        read = _reader(bus, clock, job, nodes)

        def make(of: RigMap) -> Cia402Positioner:
            return Cia402Positioner(options, clock, drives, of)

        return check_rig(rig, make, read, tell, speed_deg_s)
    raise AssertionError("unreachable: ExitStack swallows nothing")


def _reader(bus: Bus, clock: Clock, job: Job, nodes: Sequence[int]) -> Callable[[], Mapping[str, Floats]]:
    """Mean readings of the units that answer, started once. Errors of the call: PositionerFault without any."""
    network = ServiceNetwork(bus.service(service_ids(tuple(nodes))), clock)
    devices = [CanopenDevice(network, node) for node in nodes]
    stream = bus.stream(tuple(i for node in nodes for i in job.ids(node)))
    clock.sleep(SETTLE_S)  # simulated devices boot meanwhile

    def read() -> Mapping[str, Floats]:
        for device in devices:
            device.nmt("start")
        clock.sleep(SETTLE_S)
        while len(stream.receive(0.0)):
            pass
        until_s, parts = clock.monotonic_s() + READ_S, list[Frames]()
        while (left_s := until_s - clock.monotonic_s()) > 0:
            parts.append(stream.receive(min(left_s, 0.1)))
        found = {}
        for node in nodes:
            decoder = SampleDecoder(job.layout, node)
            decoder.add(Frames.join(parts))
            readings = decoder.samples().readings
            if len(readings) >= _MIN_READINGS:
                found[f"node {node}"] = readings.mean(axis=0)
        if not found:
            raise PositionerFault("rig-check-no-units", nodes=nodes)
        return found

    return read
