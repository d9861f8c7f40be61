"""How a device sends its readings: its TPDOs as they are, and what must be otherwise for the run."""

from collections.abc import Iterator, Sequence

from station.domain.can.sensor_layout import SensorLayout
from station.domain.core.types import EXTENDED
from station.domain.product import map_check
from station.domain.product.device_map import PdoSetup
from station.domain.product.sdo_codes import address
from station.domain.product.sending_pdo import (
    COB_ID,
    COMMUNICATION,
    EVENT,
    EVENT_TIMER,
    LAST_SYNC,
    LONG_ID,
    MAPPING,
    OFF,
    TRANSMISSION,
    SendingPdo,
)
from station.errors import DeviceChanged, DeviceRefused, StationFault
from station.messages import Message
from station.ports.store import Store
from station.service.station import Job
from station.service.unit import RunSetting, Unit

#: PDOs that are looked through for those that carry readings.
MOST_PDOS = 8
#: An event timer counts milliseconds (CiA 301, sub-index 5 of the communication parameters).
FASTEST_TIMER_HZ = 1000.0
#: An event timer whose rate is below this share of the recipe's explains why readings are missing.
SLOW_SHARE = 0.9


def read(unit: Unit, job: Job, store: Store) -> None:
    """Finds the TPDOs of the readings and what the run needs of them: `unit.settings` and `unit.sync_every` say it."""
    own = [s for s in unit.settings if not _is_pdo(s)]
    setups = {setup.number - 1: _of_node(setup, unit, job) for setup in job.product.map.pdo}
    found = tuple(_found(unit, job.layout, setups))
    for pdo in found:
        document = {"number": pdo.number + 1, "cob_id": pdo.cob_id, "transmission": pdo.transmission}
        more = {"event_timer_ms": pdo.event_timer_ms, "mapping": [f"{entry:08X}" for entry in pdo.mapping]}
        store.event(unit.attempt, "pdo", document | more)
    changes = [s for pdo in found for s in _changes(pdo, setups.get(pdo.number), job.recipe.device.rate_hz, own)]
    unit.settings = (*own, *changes)
    unit.pdos = found
    unit.sync_every = max((_sync_every(pdo, setups.get(pdo.number)) for pdo in found), default=0)


def _of_node(setup: PdoSetup, unit: Unit, job: Job) -> PdoSetup:
    """The setup for the unit's node: the map gives identifiers as the DBC does."""
    if setup.can_id is None:
        return setup
    return setup.model_copy(update={"can_id": setup.can_id - job.product.frames.node_of_dbc + unit.seat.node})


def check_unchanged(unit: Unit, job: Job) -> None:
    """DeviceChanged when a PDO of the readings maps other objects than the run began with."""
    set_up = {s.number - 1: s.mapping for s in job.product.map.pdo if s.mapping is not None}
    for pdo in unit.pdos:
        if _mapping(unit, pdo.number) != set_up.get(pdo.number, pdo.mapping):
            raise DeviceChanged("pdo-mapping-changed", unit=unit.label, pdo=pdo.number + 1)


def remapped(unit: Unit, job: Job) -> DeviceChanged | None:
    """What explains a unit that reads wrongly: what `check_unchanged` says. A unit that restarted lost what it was set
    to, which is no change of anybody's."""
    if unit.device.boot_ups() != unit.boot_ups:
        return None
    try:
        check_unchanged(unit, job)
    except DeviceChanged as changed:
        return changed
    except (DeviceRefused, StationFault):
        return None
    return None


def _found(unit: Unit, layout: SensorLayout, setups: dict[int, PdoSetup]) -> Iterator[SendingPdo]:
    """The PDOs that carry the messages of a reading, and those that are to be set up."""
    missing = {layout.id_of(message, unit.seat.node) for message in layout.messages}
    for number in range(MOST_PDOS):
        if not missing and not any(n >= number for n in setups):
            return
        cob_id = _number(unit, COMMUNICATION + number, COB_ID)
        if cob_id is None:
            return
        pdo = SendingPdo(number, cob_id, 0, None, ())
        if pdo.can_id not in missing and number not in setups:
            continue
        missing.discard(pdo.can_id)
        yield _whole(unit, pdo)


def _whole(unit: Unit, pdo: SendingPdo) -> SendingPdo:
    transmission = _number(unit, COMMUNICATION + pdo.number, TRANSMISSION)
    kind = EVENT if transmission is None else transmission
    at = (COMMUNICATION + pdo.number, EVENT_TIMER)
    known = next((s.found for s in unit.settings if s.address == at), None)
    timer = known if known is not None or kind < EVENT else _raw(unit, *at)
    return SendingPdo(pdo.number, pdo.cob_id, kind, timer, _mapping(unit, pdo.number))


def _mapping(unit: Unit, number: int) -> tuple[int, ...]:
    count = _number(unit, MAPPING + number, 0) or 0
    entries = [_number(unit, MAPPING + number, sub) for sub in range(1, min(count, 64) + 1)]
    return tuple(entry for entry in entries if entry is not None)


def refused(unit: Unit, setting: RunSetting) -> None:
    """The device keeps what it was found with: a PDO that stays with every n-th SYNC needs n of them for a reading."""
    if setting.address[1] == TRANSMISSION and _is_pdo(setting):
        unit.sync_every = max(unit.sync_every, setting.found[0])


def _sync_every(pdo: SendingPdo, setup: PdoSetup | None) -> int:
    """SYNCs from one PDO to the next in the run; 0 where it needs none."""
    if setup is None or setup.transmission is None:
        return int(pdo.transmission <= LAST_SYNC)
    return max(setup.transmission, 1) if setup.transmission <= LAST_SYNC else 0


def _changes(
    pdo: SendingPdo, setup: PdoSetup | None, rate_hz: float, own: Sequence[RunSetting]
) -> Iterator[RunSetting]:
    """What a PDO needs to send readings at the recipe's rate, in the order in which a device takes it."""
    if setup is not None:
        yield from _set_up(pdo, setup)
        return
    kind = pdo.transmission
    if 1 < kind <= LAST_SYNC:  # units that differ in it must not be sent too many, and no bus carries 240 a reading
        yield _setting(pdo, TRANSMISSION, bytes([kind]), b"\1", may_refuse=True)
    timed = any(s.address == (COMMUNICATION + pdo.number, EVENT_TIMER) and s.wanted is not None for s in own)
    # Faster than its unit of a millisecond no timer sends: such a device has another event of its own.
    silent = pdo.event_timer is not None and pdo.event_timer_ms == 0 and rate_hz <= FASTEST_TIMER_HZ
    if kind >= EVENT and pdo.event_timer is not None and silent and not timed:
        wanted = max(1, round(1000 / rate_hz)).to_bytes(2, "little")
        yield _setting(pdo, EVENT_TIMER, pdo.event_timer, wanted, may_refuse=True)
    if pdo.is_off:
        yield _setting(pdo, COB_ID, pdo.cob_id.to_bytes(4, "little"), (pdo.cob_id & ~OFF).to_bytes(4, "little"))


def _set_up(pdo: SendingPdo, setup: PdoSetup) -> Iterator[RunSetting]:
    """Off, then its mapping, its kind and timer, then on: a PDO that exists cannot be mapped (CiA 301, 7.5.2.38)."""
    found = pdo.cob_id.to_bytes(4, "little")
    bare = pdo.cob_id & ~OFF if setup.can_id is None else setup.can_id | (LONG_ID if setup.can_id > 0x7FF else 0)
    yield _setting(pdo, COB_ID, found, (pdo.cob_id | OFF).to_bytes(4, "little"))
    if setup.mapping is not None and setup.mapping != pdo.mapping:
        yield RunSetting((MAPPING + pdo.number, 0), "PDO mapping", bytes([len(pdo.mapping)]), b"\0")
        for sub, entry in enumerate(setup.mapping, 1):
            old = pdo.mapping[sub - 1] if sub <= len(pdo.mapping) else 0
            at = (MAPPING + pdo.number, sub)
            yield RunSetting(at, "PDO mapping", old.to_bytes(4, "little"), entry.to_bytes(4, "little"))
        yield RunSetting((MAPPING + pdo.number, 0), "PDO mapping", b"\0", bytes([len(setup.mapping)]))
    if setup.transmission is not None and setup.transmission != pdo.transmission:
        yield _setting(pdo, TRANSMISSION, bytes([pdo.transmission]), bytes([setup.transmission]))
    if setup.event_timer_ms is not None and setup.event_timer_ms != pdo.event_timer_ms:
        timer = pdo.event_timer if pdo.event_timer is not None else bytes(2)
        yield _setting(pdo, EVENT_TIMER, timer, setup.event_timer_ms.to_bytes(2, "little"))
    yield _setting(pdo, COB_ID, (pdo.cob_id | OFF).to_bytes(4, "little"), bare.to_bytes(4, "little"))


def _setting(pdo: SendingPdo, sub: int, found: bytes, wanted: bytes, *, may_refuse: bool = False) -> RunSetting:
    name = {COB_ID: "PDO identifier", TRANSMISSION: "PDO transmission type", EVENT_TIMER: "PDO event timer"}[sub]
    return RunSetting((COMMUNICATION + pdo.number, sub), name, found, wanted, may_refuse=may_refuse)


def _is_pdo(setting: RunSetting) -> bool:
    return setting.name.startswith("PDO ")


def _raw(unit: Unit, index: int, sub: int) -> bytes | None:
    """Bytes of an object; None where the device has none."""
    try:
        return unit.device.upload(index, sub)
    except DeviceRefused:
        return None


def _number(unit: Unit, index: int, sub: int) -> int | None:
    raw = _raw(unit, index, sub)
    return None if raw is None else int.from_bytes(raw, "little")


def slow_timer(unit: Unit, job: Job) -> Message | None:
    """What the run left as it found it: an event timer by which readings come more rarely than the recipe says."""
    frames_hz = job.recipe.device.rate_hz / job.layout.samples_a_frame
    set_up = {s.address[0] - COMMUNICATION for s in unit.settings if _is_pdo(s) and s.address[1] == EVENT_TIMER}
    for pdo in unit.pdos:
        timer_ms = pdo.event_timer_ms
        if pdo.transmission < EVENT or not timer_ms or pdo.number in set_up:
            continue
        if 1000 / timer_ms < SLOW_SHARE * frames_hz:
            at = address(COMMUNICATION + pdo.number, EVENT_TIMER)
            wanted_ms = 1000 / frames_hz
            return Message("event-timer-slow", object=at, pdo=pdo.number + 1, timer_ms=timer_ms, wanted_ms=wanted_ms)
    return None


def why_silent(unit: Unit, job: Job) -> Iterator[Message]:
    """What the communication parameters of the readings' PDOs say against frames, as they are now; of a device without
    PDOs, that it answers. Errors: those of SDO."""
    layout = job.layout
    if job.product.map.protocol != "canopen":
        for at in map_check.readable(job.product.map)[:1]:
            unit.device.upload(*at)
        return
    wanted = [layout.id_of(message, unit.seat.node) for message in layout.messages]
    sent: dict[int, SendingPdo] = {}
    for number in range(MOST_PDOS):
        cob_id = _number(unit, COMMUNICATION + number, COB_ID)
        if cob_id is None:
            break
        pdo = SendingPdo(number, cob_id, 0, None, ())
        sent.setdefault(pdo.can_id, pdo)
    if not sent:
        return
    for can_id in wanted:
        if can_id not in sent:
            ids = tuple(f"0x{i & ~EXTENDED:X}" for i in sent)
            yield Message("silent-other-id", can_id=can_id & ~EXTENDED, ids=ids)
            continue
        yield from _why_not_sent(_whole(unit, sent[can_id]))


def _why_not_sent(pdo: SendingPdo) -> Iterator[Message]:
    where = {"pdo": pdo.number + 1}
    if pdo.is_off:
        yield Message("silent-pdo-off", object=address(COMMUNICATION + pdo.number, COB_ID), **where)
    elif pdo.transmission <= LAST_SYNC:
        yield Message("silent-pdo-sync", kind=pdo.transmission, **where)
    elif pdo.event_timer_ms in (0, None):
        yield Message("silent-event-timer", object=address(COMMUNICATION + pdo.number, EVENT_TIMER), **where)
