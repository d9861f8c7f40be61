"""The calibration goes into the device: intent before, fact after, read back bit for bit, saved, reset, read again."""

from collections.abc import Iterator, Mapping, Sequence

from station.domain.core.types import Calibration
from station.domain.product import writeback
from station.domain.product.device_map import DeviceMap
from station.domain.product.sdo_codes import address
from station.domain.product.writeback import ObjectWrite
from station.domain.run.progress import Event, ObjectWritten
from station.domain.run.unit_state import UNCERTAIN, UnitState
from station.errors import (
    DeviceChanged,
    DeviceRefused,
    DeviceSilent,
    ReadBackDiffers,
    StationError,
    StationFault,
    UnitFault,
    WrongUnit,
)
from station.messages import Message
from station.ports.store import WriteRecord
from station.service import process_data
from station.service.download import download
from station.service.identify import check_still_set, objects_to_text, set_compensated
from station.service.record import message_entry
from station.service.station import Job, Station
from station.service.unit import Address, Unit, check_no_foreign_master, check_not_rebooted, check_same_unit

#: A write, how far it has come, and what was read back.
WriteStage = tuple[ObjectWrite, str, bytes | None]


class WriteBack:
    """Writes one unit. plan() refuses what does not fit before anything is touched.

    After any failure of write() the old values stand in the device again, or the record says that they may not.
    """

    def __init__(self, unit: Unit, station: Station, job: Job) -> None:
        self._unit, self._station, self._job = unit, station, job
        self._map = job.product.map
        self._writes: tuple[ObjectWrite, ...] = ()

    def plan(self, calibration: Calibration) -> None:
        """Every write, worked out in full. Errors: UnitFault when a coefficient does not fit its object."""
        self._writes = writeback.sequence(
            self._map,
            writeback.composed(self._map, calibration, self._unit.old),
            record=self._unit.attempt,
            temperature_degC=self._unit.temperature_degC,
            epoch_ns=self._station.clock.epoch_ns(),
        )

    def write(self) -> Iterator[Event]:
        """Writes and reads back every object; then output and settings as they must be saved."""
        unit = self._unit
        check_not_rebooted(unit, Message("while-measured"))
        check_no_foreign_master(unit, self._station.foreign)
        check_same_unit(unit, self._job)
        process_data.check_unchanged(unit, self._job)
        check_still_set(unit, self._job, raw=True)
        # The whole plan stands in the log before the first write: a crash in between is then recognised.
        self._station.store.result(unit.attempt, "write-plan", {"objects": objects_to_text(self._wanted())})
        done = False
        try:
            self._keep(*((first, "intent", None) for first in self._writes[:1]))
            unit.enter(UnitState.WRITING)
            for number, write in enumerate(self._writes, 1):
                self._write_one(write, self._writes[number : number + 1])
                yield ObjectWritten(unit.seat.serial, write.name, number, len(self._writes))
            self._check_checksum()
            set_compensated(unit, self._job)
            unit.enter(UnitState.WRITTEN)
            done = True
        finally:
            if not done:
                self.put_back()

    def save(self) -> None:
        """Stores in the device's flash: once, with its own time-out. An answer that does not come decides nothing."""
        unit, command = self._unit, writeback.save(self._map)
        if command is None:
            return
        try:
            check_not_rebooted(unit, Message("between-write-and-save"))
        except UnitFault:
            self.put_back()
            raise
        self._keep((command, "intent", None))
        unit.enter(UnitState.SAVING)
        try:
            download(unit, command.address, command.raw, command.timeout_s)
        except DeviceRefused:
            self._keep((command, "refused", None))
            self._read_state_after_reset()
            raise
        except DeviceSilent as exc:
            self._keep((command, "unknown", None))
            self._station.store.event(unit.attempt, "save-unanswered", message_entry(exc.message))
            # It may still be writing its flash: a reset now would break that off.
            self._station.clock.sleep(self._station.settings.timeouts.save_s)
        else:
            self._keep((command, "written", None))

    def restart(self) -> None:
        """Resets the device and waits until it is back. Errors: DeviceSilent."""
        unit = self._unit
        unit.device.nmt("reset-node")
        unit.device.wait_boot_up(self._station.settings.timeouts.boot_s)
        unit.boot_ups, unit.switched = unit.device.boot_ups(), False
        unit.enter(UnitState.RESTARTED)

    def read_again(self) -> None:
        """Reads every object after the reset; whatever differs is said, and the record says what the device holds."""
        unit = self._unit
        check_same_unit(unit, self._job)
        wanted = self._wanted()
        read = {at: unit.device.upload(*at) for at in wanted}
        state = writeback.classify(unit.old, wanted, read)
        self._state(state)
        if state != "new":
            names = tuple(w.name for w in self._writes if w.address in wanted and read[w.address] != w.raw)
            raise ReadBackDiffers(f"{state}-values-after-reset", unit=unit.label, names=names)
        self._check_checksum()
        unit.enter(UnitState.STORED)

    def confirm(self) -> None:
        """The device is still what was verified: it did not restart, it is the same unit, it holds the same objects and
        sends them as before.

        Errors: WrongUnit, DeviceChanged.
        """
        unit = self._unit
        restarted, wanted = unit.device.boot_ups() != unit.boot_ups, self._wanted()
        try:
            check_same_unit(unit, self._job)
        except WrongUnit:
            unit.enter(UnitState.CHANGED)
            raise
        read = {at: unit.device.upload(*at) for at in wanted}
        state = writeback.classify(unit.old, wanted, read)
        if state != "new":
            unit.enter(UnitState.CHANGED)
            self._state(state)
            names = tuple(w.name for w in self._writes if w.address in wanted and read[w.address] != w.raw)
            raise DeviceChanged("changed-after-verification", unit=unit.label, names=names)
        self._check_checksum()
        process_data.check_unchanged(unit, self._job)
        check_still_set(unit, self._job, raw=False)
        if restarted or unit.device.boot_ups() != unit.boot_ups:
            raise DeviceChanged("unit-restarted", unit=unit.label, when=Message("while-verified"))
        if (age_s := unit.device.heartbeat_age_s()) > (limit_s := unit.heartbeat_limit_s):
            raise DeviceChanged("heartbeat-gap", unit=unit.label, age_s=age_s, limit_s=limit_s)

    def _write_one(self, write: ObjectWrite, after: Sequence[ObjectWrite]) -> None:
        """Writes what the log already intends, and reads it back; the fact is kept together with the next intent."""
        unit, following = self._unit, [(w, "intent", None) for w in after]
        try:
            download(unit, write.address, write.raw, write.timeout_s)
        except DeviceRefused:
            self._keep((write, "refused", None))
            raise
        except DeviceSilent:
            self._keep((write, "unknown", None))
            raise
        if not write.read_back:
            self._keep((write, "written", None), *following)
            return
        read = unit.device.upload(*write.address)
        if read != write.raw:
            self._keep((write, "written", read))
            where = {"name": write.name, "object": address(*write.address)}
            raise ReadBackDiffers(
                "read-back-differs", unit=unit.label, read=read.hex(), written=write.raw.hex(), **where
            )
        self._keep((write, "verified", read), *following)

    def put_back(self) -> None:
        """Old values into the device again, so that no mixture is left; the record says how that went."""
        unit = self._unit
        if unit.state not in UNCERTAIN:
            return
        # An empty text cannot be written by SDO; it is no coefficient either.
        wanted = {w.address: unit.old[w.address] for w in self._writes if w.read_back and unit.old[w.address]}
        try:
            put_back(unit, writeback.unlock(self._map), flag_last(self._map, wanted), wanted)
        except StationError as exc:
            self._station.store.event(unit.attempt, "put-back-failed", message_entry(exc.message))
            self._read_state_after_reset()
        else:
            unit.enter(UnitState.PUT_BACK)
            self._state("old")

    def _read_state_after_reset(self) -> None:
        """What the flash holds is known only after a reset."""
        wanted, state = self._wanted(), "unknown"
        try:
            self.restart()
            state = writeback.classify(self._unit.old, wanted, {at: self._unit.device.upload(*at) for at in wanted})
        except StationError as exc:
            self._station.store.event(self._unit.attempt, "state-unknown", message_entry(exc.message))
        if state == "old":
            self._unit.enter(UnitState.REVERTED)
        self._state(state)

    def _wanted(self) -> dict[Address, bytes]:
        """What must be read after the reset: the last write of each address."""
        return {w.address: w.raw for w in self._writes if w.read_back}

    def _check_checksum(self) -> None:
        expected = writeback.expected_checksum(self._map, self._wanted())
        if expected is None or self._map.checksum is None:
            return
        read = self._unit.device.upload(*self._map.checksum.address)
        if read != expected:
            checksums = {"read": read[::-1].hex(), "expected": expected[::-1].hex()}
            raise ReadBackDiffers("checksum-differs", unit=self._unit.label, **checksums)

    def _state(self, state: str) -> None:
        self._station.store.result(self._unit.attempt, "device-state", {"state": state})

    def _keep(self, *stages: WriteStage) -> None:
        """Stages of writes, in one commit."""
        self._station.store.write(
            self._unit.attempt,
            *(
                WriteRecord(
                    index=write.index,
                    sub=write.sub,
                    name=write.name,
                    old=self._unit.old.get(write.address),
                    written=write.raw,
                    read_back=read_back,
                    value=write.value,
                    stage=stage,
                )
                for write, stage, read_back in stages
            ),
        )


def flag_last(device_map: DeviceMap, wanted: Mapping[Address, bytes]) -> Sequence[Address]:
    """Coefficients first, the valid flag last: until then the device itself knows that they are not to be used."""
    flag = device_map.valid.address if device_map.valid is not None else None
    return sorted(wanted, key=lambda at: at == flag)


def put_back(unit: Unit, unlock: ObjectWrite | None, order: Sequence[Address], wanted: Mapping[Address, bytes]) -> None:
    """Brings every object of `wanted` to its value; what already holds it is left alone. Errors: those of SDO."""
    different = [at for at in order if unit.device.upload(*at) != wanted[at]]
    if different and unlock is not None:
        download(unit, unlock.address, unlock.raw, unlock.timeout_s)
    for at in different:
        download(unit, at, wanted[at])
        if unit.device.upload(*at) != wanted[at]:
            raise StationFault("old-value-not-restored", unit=unit.label, object=address(*at))
