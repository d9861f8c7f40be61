"""What a start-up does with attempts that never ended, and with units that may be half written."""

from collections.abc import Mapping
from datetime import UTC, datetime

from station.domain.core.types import Outcome
from station.domain.product import writeback
from station.errors import DeviceRefused, ReadBackDiffers
from station.ports.store import SuspectAttempt
from station.service.identify import objects_from_text
from station.service.station import Job, Station
from station.service.unit import Address, Unit
from station.service.write_back import flag_last, put_back

STATE_SENTENCES = {
    "old": "all its objects hold the old values: nothing of that attempt is left in it",
    "new": "all its objects hold the new values, which were never verified",
    "mixed": "some of its objects hold old values and some new ones: it must not be used as it is",
    "other": "it holds values that are neither the old nor the new ones: somebody else has written it since",
}


def close_unfinished(station: Station) -> tuple[str, ...]:
    """Ends every attempt that a crash left open as INTERRUPTED; sentences for the operator."""
    told = []
    for left in station.store.unfinished():
        station.store.event(left.attempt, "interrupted", {"after": left.last_event, "visits": left.visits})
        station.store.finish(left.attempt, Outcome.INTERRUPTED, station.clock.epoch_ns())
        more = "; its device may be half written and is looked at when it comes again" if left.writes else ""
        told.append(f"the attempt of {left.serial} begun {_when(left.started_ns)} was interrupted{more}")
    return tuple(told)


def read_device_state(unit: Unit, suspect: SuspectAttempt, station: Station) -> str:
    """Resets the device, reads every planned object back and says which values they are; the log keeps the answer.

    The reset brings what the flash holds: working memory may still show what was never saved.
    """
    reset(unit, station)
    old = {at: raw for at, raw in objects_from_text(suspect.old).items() if raw}
    # An object that was empty before (a text) says nothing about the calibration, and SDO cannot make it empty again.
    planned = {at: raw for at, raw in objects_from_text(suspect.planned).items() if at in old}
    state = str(writeback.classify(old, planned, {at: unit.device.upload(*at) for at in planned}))
    station.store.event(suspect.attempt, "device-state", {"state": state, "seen": "read back after a reset"})
    return state


def check_suspect_unit(unit: Unit, station: Station) -> str:
    """The first look at a unit that an earlier attempt may have left half written; '' or a sentence to tell.

    Errors: ReadBackDiffers with the remedy when it holds a mixture; nothing is guessed.
    """
    suspect = station.store.suspect(unit.seat.serial)
    if suspect is None:
        return ""
    state = read_device_state(unit, suspect, station)
    said = f"{unit.name} was left in an attempt of {_when(suspect.started_ns)}; {STATE_SENTENCES[state]}"
    if state == "mixed":
        serial = unit.seat.serial
        raise ReadBackDiffers(
            f"{said}; `station recover {serial} --restore` brings the old values back, "
            f"`station recover {serial} --continue` finishes the new ones"
        )
    return said


def recover(unit: Unit, suspect: SuspectAttempt, station: Station, job: Job, *, restore: bool) -> str:
    """Brings the unit to all old or all new values, saves, resets and reads back; the state it then holds.

    Errors: those of SDO; ReadBackDiffers when it does not keep them.
    """
    wanted = {at: raw for at, raw in objects_from_text(suspect.old if restore else suspect.planned).items() if raw}
    objects: Mapping[Address, bytes] = {at: wanted[at] for at in objects_from_text(suspect.planned) if at in wanted}
    station.store.event(suspect.attempt, "recovery", {"restore": restore})
    device_map = job.product.map
    put_back(unit, writeback.unlock(device_map), flag_last(device_map, objects), objects)
    save = writeback.save(device_map)
    try:
        unit.device.download(*save.address, save.raw, save.timeout_s)
    except DeviceRefused as exc:
        station.store.event(suspect.attempt, "recovery-failed", {"sentence": exc.sentence})
        raise
    state = read_device_state(unit, suspect, station)
    if state != ("old" if restore else "new"):
        raise ReadBackDiffers(
            f"{unit.name} does not keep what it is told: {STATE_SENTENCES[state]}; take it out of the line"
        )
    return state


def reset(unit: Unit, station: Station) -> None:
    """NMT reset and boot-up. Errors: DeviceSilent."""
    unit.device.nmt("reset-node")
    unit.device.wait_boot_up(station.settings.timeouts.boot_s)
    unit.boot_ups = unit.device.boot_ups()


def _when(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M UTC")
