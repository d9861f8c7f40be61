"""Beside the page, a process of its own listens to the units of a full load before its run, and sends nothing.

So the page itself opens no bus, and a frame that crashes a reader takes nothing from it. What a unit does not send by
itself is not shown: only a run may start it.
"""

import json
import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path

from station.adapters.clock import SystemClock
from station.config.documents import Document
from station.config.settings import PositionerSettings, Settings, load_config
from station.domain.can.sample_decoder import SampleDecoder
from station.domain.core.types import NestAssignment
from station.errors import StationError
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.nest_readings import NestReading, remove_readings, write_readings
from station.panel_protocol.owner import owner_pid
from station.panel_protocol.queue import LoadQueue
from station.ports.bus import Channel
from station.ports.clock import Clock
from station.service.station import Job
from station.wiring.beside import running_beside
from station.wiring.buses import bus_kind, open_buses, used_buses
from station.wiring.driven_fixture import DRIVEN
from station.wiring.jobs import Source, load_job
from station.wiring.rehearsal import rehearsed
from station.wiring.run_order import RunOrder
from station.wiring.simulated import SimulatedFixture

#: A reading is the mean over so long; whether a load is ready is looked up as often, s.
EVERY_S = 0.25
#: After a bus that could not be opened or has failed, s.
AGAIN_S = 2.0
#: NMT: every node, start. Only simulated devices are ever sent it from here.
_START_ALL = bytes((0x01, 0x00))


@contextmanager
def listening_in_background(order: RunOrder, settings: Settings) -> Iterator[None]:
    """While the block lasts, the file of Companion.READINGS holds what the units of a ready load send.

    order: as runs of the page get it; database must be said. A bus that only one process can open is left alone.
    """
    if not _can_be_listened_to(order, settings):
        yield
        return
    try:
        with running_beside("-P", "-m", __name__, json.dumps(asdict(order), default=str)):
            yield
    finally:
        with suppress(OSError):
            remove_readings(Path(str(order.database)))


def _can_be_listened_to(order: RunOrder, settings: Settings) -> bool:
    return order.simulate or all(bus_kind(bus).interface_of_kernel for bus in used_buses(settings).values())


class NestListener:
    """Listens while all nests are taken and nobody runs. `step` does the work of one moment."""

    def __init__(self, order: RunOrder) -> None:
        self._settings, self._document = load_config(order.config)
        self._order = rehearsed(order, self._settings)
        self._job, self._source = load_job(order.recipe or self._settings.recipe)
        self._database = Path(str(order.database))
        self._queue = LoadQueue(companion_file(self._database, Companion.QUEUE))
        self._opened = ExitStack()
        self._seats: tuple[NestAssignment, ...] = ()
        self._ears: _Ears | None = None

    def step(self) -> None:
        """Takes what the units have sent since the last step. Errors: BusFault, ConfigError, OSError; then nothing is
        open."""
        seats = self._ready_seats()
        if seats != self._seats:
            self.close()
            if seats:
                self._ears = _listen(self._opened, self._settings, self._document, self._job, self._source, self._order)
                self._ears.hear(seats)
            self._seats = seats
        if self._ears is not None:
            write_readings(self._database, self._ears.readings())

    def close(self) -> None:
        """Lets go of the bus."""
        self._opened.close()
        self._seats, self._ears = (), None
        remove_readings(self._database)

    def _ready_seats(self) -> tuple[NestAssignment, ...]:
        """The units of the next load; nothing where a nest is free or a run is under way. While the page seals, it owns
        the log for a moment."""
        waiting, nests = self._queue.waiting, self._settings.nests
        if not all(nest.name in waiting for nest in nests) or owner_pid(self._database) not in (None, os.getppid()):
            return ()
        return tuple(NestAssignment(waiting[n.name].serial, n.name, n.node) for n in nests)


class _Ears:
    """What the units of one load send, moment by moment. fixture: where the units are simulated."""

    def __init__(self, job: Job, channel: Channel, clock: Clock, fixture: SimulatedFixture | None) -> None:
        self._job, self._channel, self._clock, self._fixture = job, channel, clock, fixture
        self._decoders: dict[NestAssignment, SampleDecoder] = {}
        self._temperatures: dict[NestAssignment, float] = {}

    def hear(self, seats: tuple[NestAssignment, ...]) -> None:
        """These units are in the nests."""
        if self._fixture is not None:
            self._fixture.place(seats)
            starter = self._fixture.bus.service(())
            starter.send(0, _START_ALL)
        self._decoders = {seat: SampleDecoder(self._job.layout, seat.node) for seat in seats}

    def readings(self) -> Mapping[str, NestReading]:
        """Nest → mean of what came in the last moment; nests of which nothing came are left out."""
        self._clock.sleep(EVERY_S if self._fixture is not None else 0.0)
        frames = self._channel.receive(0.0)
        found = {}
        for seat, decoder in self._decoders.items():
            decoder.forget(self._clock.epoch_ns())
            decoder.add(frames)
            newest = decoder.newest()
            if len(newest.temperature_degC):
                self._temperatures[seat] = float(newest.temperature_degC[-1])
            if len(xyz := newest.readings):
                vector = tuple(float(v) for v in xyz.mean(axis=0))
                found[seat.nest] = NestReading(seat.serial, vector, self._temperatures.get(seat))
        return found


def _listen(
    opened: ExitStack, settings: Settings, document: Document, job: Job, source: Source, order: RunOrder
) -> _Ears:
    """Opens the bus, or the simulated units'. Errors: BusFault, ConfigError."""
    can_ids = tuple(i for nest in settings.nests for i in job.layout.ids(nest.node))
    if order.simulate:
        if settings.positioner.kind in DRIVEN:  # drives would be simulated for nothing
            settings = settings.model_copy(update={"positioner": PositionerSettings(kind="simulated")})
        fixture = SimulatedFixture(settings, document, job, source, replace(order, mounted=None))
        opened.callback(fixture.close)
        return _Ears(job, fixture.bus.stream(can_ids), fixture.clock, fixture)
    clock = SystemClock()
    bus = open_buses(settings, document, clock)
    opened.callback(bus.close)
    return _Ears(job, bus.stream(can_ids), clock, None)


def _main(text: str) -> None:
    """Listens until the page has gone, however it went."""
    given = json.loads(text)
    paths = {k: Path(given[k]) for k in ("config", "database", "model", "device_state") if given[k]}
    listener = NestListener(RunOrder(**{**given, **paths, "effects": (), "faults": tuple(given["faults"])}))
    page = os.getppid()
    while os.getppid() == page:
        try:
            listener.step()
            time.sleep(EVERY_S)
        except (StationError, OSError):
            with suppress(OSError):
                listener.close()
            time.sleep(AGAIN_S)


if __name__ == "__main__":
    _main(sys.argv[1])
