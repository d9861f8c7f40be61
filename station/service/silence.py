"""Why a unit sends no readings, in one sentence: what the bus, its NMT state, its errors and its PDOs say."""

from collections.abc import Iterator

from station.errors import DeviceSilent, StationError
from station.messages import Message
from station.service import process_data
from station.service.bus_errors import STATE_REMEDIES
from station.service.station import Job, Station
from station.service.unit import Unit

#: A unit that has sent nothing for so long after it was started sends nothing.
SILENT_S = 2.0


def explain(unit: Unit, station: Station, job: Job, position: str) -> Message:
    """The whole sentence; every part of it is read now, which takes a second at most where the device is dead."""
    found = tuple(_causes(unit, station, job)) or (Message("silent-unexplained"),)
    return Message("visit-silent-because", position=position, causes=found)


def _causes(unit: Unit, station: Station, job: Job) -> Iterator[Message]:
    if (state := station.bus.state()) in STATE_REMEDIES:
        yield Message(STATE_REMEDIES[state], bus=station.bus.name)
        return
    restarted = unit.device.boot_ups() != unit.boot_ups
    if restarted:
        yield Message("silent-restarted")
    nmt = unit.device.state()
    if nmt not in ("operational", "unknown"):
        yield Message("silent-not-operational", state=Message(f"nmt-{nmt}"))
    if unit.emergency is not None:
        yield unit.emergency
    if not restarted:
        try:
            yield from process_data.why_silent(unit, job)
        except DeviceSilent:
            yield Message("silent-altogether")
        except StationError as exc:
            yield exc.message
    counters = station.bus.counters()
    if counters is not None and (counters.sending or counters.receiving):
        yield Message("silent-error-counters", sending=counters.sending, receiving=counters.receiving)
