"""What a start-up does with attempts that never ended, and with units that may be half written."""

from collections.abc import Mapping
from datetime import UTC, datetime

from station.domain.core.types import Outcome
from station.domain.product import writeback
from station.errors import DeviceRefused, ReadBackDiffers
from station.messages import Message
from station.ports.store import SuspectAttempt
from station.service.download import download
from station.service.identify import objects_from_text
from station.service.record import message_entry
from station.service.station import Job, Station
from station.service.unit import Address, Unit
from station.service.write_back import flag_last, put_back


def device_state(state: str) -> Message:
    """What a unit's objects hold: old, new, mixed or other values."""
    return Message(f"device-state-{state}")


def close_unfinished(station: Station) -> tuple[Message, ...]:
    """Ends every attempt that a crash left open as INTERRUPTED; messages for the operator."""
    notices = []
    for interrupted in station.store.unfinished():
        station.store.event(
            interrupted.attempt, "interrupted", {"after": interrupted.last_event, "visits": interrupted.visits}
        )
        station.store.finish(interrupted.attempt, Outcome.INTERRUPTED, station.clock.epoch_ns())
        id_ = "attempt-interrupted-in-write" if interrupted.writes else "attempt-interrupted"
        notices.append(Message(id_, serial=interrupted.serial, began=_when(interrupted.started_ns)))
    return tuple(notices)


def read_device_state(unit: Unit, suspect: SuspectAttempt, station: Station) -> str:
    """Resets the device, reads every planned object back and says which values they are; the log keeps the answer.

    The reset brings what the flash holds: working memory may still show what was never saved.
    """
    reset(unit, station)
    old = {at: raw for at, raw in objects_from_text(suspect.old).items() if raw}
    # An object that was empty before (a text) says nothing about the calibration, and SDO cannot make it empty again.
    planned = {at: raw for at, raw in objects_from_text(suspect.planned).items() if at in old}
    state = str(writeback.classify(old, planned, {at: unit.device.upload(*at) for at in planned}))
    station.store.event(suspect.attempt, "device-state", {"state": state, "source": "read back after a reset"})
    return state


def check_suspect_unit(unit: Unit, station: Station) -> Message | None:
    """Examines a unit that an earlier attempt may have left half written; None or a message for the operator.

    Errors: ReadBackDiffers with the remedy when it holds a mixture; nothing is guessed.
    """
    suspect = station.store.suspect(unit.seat.serial)
    if suspect is None:
        return None
    state = read_device_state(unit, suspect, station)
    began = _when(suspect.started_ns)
    found = Message("unit-left-in-attempt", unit=unit.label, began=began, state=device_state(state))
    if state == "mixed":
        raise ReadBackDiffers("unit-needs-recovery", found=found, serial=unit.seat.serial)
    return found


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
        if save is not None:
            download(unit, save.address, save.raw, save.timeout_s)
    except DeviceRefused as exc:
        station.store.event(suspect.attempt, "recovery-failed", message_entry(exc.message))
        raise
    state = read_device_state(unit, suspect, station)
    if state != ("old" if restore else "new"):
        raise ReadBackDiffers("recovery-not-stored", unit=unit.label, state=device_state(state))
    return state


def reset(unit: Unit, station: Station) -> None:
    """NMT reset and boot-up. Errors: DeviceSilent."""
    unit.device.nmt("reset-node")
    unit.device.wait_boot_up(station.settings.timeouts.boot_s)
    unit.boot_ups = unit.device.boot_ups()


def _when(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M UTC")
