"""The station as it stands in front of a person: ports, job, nests, and how units come into the nests."""

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from types import TracebackType
from typing import Protocol

from pydantic import ValidationError

from station.adapters.canopen.foreign_traffic import ForeignTrafficWatch
from station.adapters.clock import SystemClock
from station.adapters.malloc_tuning import retain_freed_memory
from station.config.documents import Document, content_hash
from station.config.settings import Settings, load_config
from station.config.validation_messages import mistakes
from station.domain.core.types import NestAssignment
from station.domain.recipe import references
from station.domain.records.stored_attempt import utc_day
from station.errors import RecipeError, UsageError
from station.messages import Message, render
from station.ports.bus import Bus, TellsLimits
from station.ports.clock import Clock
from station.ports.device import Device
from station.ports.positioner import Positioner
from station.service.itinerary import check_reach
from station.service.learnt_model import with_model
from station.service.recovery import close_unfinished
from station.service.station import Job, Station
from station.wiring.alerts import read_book
from station.wiring.bus_owner import claim_bus
from station.wiring.buses import bus_kind, bus_options, open_buses, used_buses
from station.wiring.devices import open_devices
from station.wiring.driven_fixture import replaced_positioner
from station.wiring.jobs import Source, load_job
from station.wiring.logs import open_store
from station.wiring.positioners import connected_positioner, refuse_numbers_for_real_units
from station.wiring.rehearsal import rehearsed
from station.wiring.run_order import RunOrder
from station.wiring.simulated import Rehearsal, SimulatedFixture


class Fixture(Protocol):
    """Where units come into the nests: by hand, or out of the simulation."""

    def place(self, seats: Sequence[NestAssignment]) -> None:
        """The units of a load sit in their nests from now on."""


class _ByHand:
    """People place units; nothing to do."""

    def place(self, seats: Sequence[NestAssignment]) -> None:
        """Nothing to do."""


@dataclass(frozen=True, slots=True)
class Bench:
    """An opened station with its job. Use as a context manager: it lets go of bus and log.

    notices: what the start-up found and the operator should know.
    """

    station: Station
    job: Job
    source: Source
    fixture: Fixture
    database: Path
    simulated: bool
    notices: tuple[str, ...]
    _open: ExitStack = field(repr=False)

    def loads(self, serials: Sequence[str]) -> list[tuple[NestAssignment, ...]]:
        """Serials in the order given, nest by nest; more than there are nests make several fixture loads."""
        nests = self.station.settings.nests
        count = math.ceil(len(serials) / len(nests))
        parts = [serials[i * len(nests) : (i + 1) * len(nests)] for i in range(count)]
        return [tuple(NestAssignment(s, n.name, n.node) for s, n in zip(part, nests, strict=False)) for part in parts]

    def close(self) -> None:
        """Closes bus and log; closing twice is harmless."""
        self._open.close()

    def __enter__(self) -> "Bench":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_bench(order: RunOrder) -> Bench:
    """Opens everything. Errors: those of recipe, config, product, bus and log, each before anything moves."""
    settings, document = load_config(order.config)
    ordered, order = order, rehearsed(order, settings)
    settings = _overridden(settings, order)
    for name, one in used_buses(settings).items():  # before anything else, also where nothing is on the bus
        bus_options(one, document, ("buses", name) if name else ("bus",))
    job, source = load_job(order.recipe or settings.recipe)
    _check_simulation_options(order)
    job, learnt = with_model(job, order.model)
    _check_references(job, settings)
    retain_freed_memory()
    with ExitStack() as opened:
        if order.simulate:
            made = _simulated(settings, document, job, source, order)
            opened.callback(made.close)
            fixture: Fixture = made
            clock: Clock = made.clock
            bus: Bus = made.bus
            turned_by: Positioner = made.positioner
        else:
            fixture = _ByHand()
            clock = SystemClock()
            for one in used_buses(settings).values():
                if bus_kind(one).without_units:
                    raise UsageError("bus-without-units", interface=one.interface)
            units_bus = cache(lambda: units_bus_of(settings, document, clock, opened))
            turned_by = connected_positioner(settings, document, clock, units_bus, opened)
            refuse_numbers_for_real_units(settings, turned_by)
            bus = units_bus()
        opened.callback(bus.close)
        check_reach(job.recipe, turned_by)
        database = order.database or Path(settings.database)
        store = open_store(database, settings, clock.epoch_ns)
        opened.callback(store.close)
        device, foreign = _devices(bus, clock, settings, job)
        config_hash = content_hash(settings)
        alerts = partial(read_book, database)
        station = Station(settings, config_hash, bus, turned_by, store, clock, device, foreign, order.simulate, alerts)
        limits = [bus.limits] if isinstance(bus, TellsLimits) else []
        if isinstance(fixture, Rehearsal):
            limits.append(Message("rehearsal", bus=bus.name))
        if order.simulate:
            limits += replaced_positioner(settings, document)
        notices = (*learnt, *(render(m) for m in limits), *(render(m) for m in close_unfinished(station)))
        if order.simulate and not ordered.simulate:
            notices = (render(Message("rehearsal-bench", file=str(document.path))), *notices)
        return Bench(station, job, source, fixture, database, order.simulate, notices, opened.pop_all())
    raise AssertionError("unreachable: ExitStack swallows nothing")


def units_bus_of(settings: Settings, document: Document, clock: Clock, opened: ExitStack) -> Bus:
    """The units' bus, or all of them as one, owned by this station. Errors: ConfigError, BusFault."""
    for one in used_buses(settings).values():
        if bus_kind(one).interface_of_kernel:
            opened.callback(claim_bus(one, settings.station).release)
    return open_buses(settings, document, clock)


#: Interfaces without hardware: `--simulate` puts its devices on them, in real time.
REHEARSED = ("virtual", "udp_multicast")


def _simulated(settings: Settings, document: Document, job: Job, source: Source, order: RunOrder) -> SimulatedFixture:
    """The simulated fixture: in simulated time, or in real time on the bus that was asked for."""
    used = used_buses(settings).values()
    in_real_time = order.interface is not None or all(bus.interface in REHEARSED for bus in used)
    if not in_real_time or any(bus_kind(bus).without_units for bus in used):
        if order.channel is not None:
            raise UsageError("channel-without-bus", channel=order.channel)
        return SimulatedFixture(settings, document, job, source, order)
    clock = SystemClock()
    near, far = (open_buses(settings, document, clock) for _ in range(2))
    rehearsal = Rehearsal(settings, document, job, source, order, near=near, far=far)
    rehearsal.begin()
    return rehearsal


def _overridden(settings: Settings, order: RunOrder) -> Settings:
    """Settings with what the order says otherwise, checked again."""
    bus = {k: v for k, v in {"interface": order.interface, "channel": order.channel}.items() if v is not None}
    same_kind = order.interface in (None, settings.bus.interface)
    given_bus = settings.bus.model_dump() if same_kind else {}
    own = {k: v for k, v in {"operator": order.operator, "lot": order.lot}.items() if v is not None}
    stored = settings.model_dump(by_alias=True)
    try:
        return Settings.model_validate({**stored, **own, "bus": {**given_bus, **bus}})
    except ValidationError as exc:
        raise UsageError("options-mistakes", mistakes=mistakes(exc, Settings)) from None


def _check_simulation_options(order: RunOrder) -> None:
    given = {
        "--effect": order.effects,
        "--fault": order.faults,
        "--device-state": order.device_state,
        "--mounted": order.mounted,
    }
    for option, value in given.items():
        if value and not order.simulate:
            raise UsageError("option-needs-simulate", option=option)


def _check_references(job: Job, settings: Settings) -> None:
    """No reference may be overdue, and a gold one must be there to be read. Errors: RecipeError, ReferenceOverdue."""
    today = utc_day(SystemClock().epoch_ns())
    references.check_due(job.recipe, today)
    gold = job.recipe.reference.gold
    if job.recipe.reference.source != "gold" or gold is None:
        return
    if gold.node is None:
        raise RecipeError("gold-node-missing", recipe=job.recipe.name)
    for nest in settings.nests:
        if nest.node == gold.node:
            raise RecipeError("gold-node-of-nest", node=gold.node, nest=nest.name)


def _devices(
    bus: Bus, clock: Clock, settings: Settings, job: Job
) -> tuple[Callable[[int], Device], ForeignTrafficWatch]:
    """The devices of all nests and of a gold reference, and who else commands them."""
    gold = () if job.gold_node is None else (job.gold_node,)
    return open_devices(
        bus, clock, (*(nest.node for nest in settings.nests), *gold), job.product, settings.timeouts.sdo_s
    )
