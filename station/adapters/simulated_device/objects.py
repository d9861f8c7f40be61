"""The objects of a simulated device: values, checks with their abort codes, the lock, and what is kept at power-off."""

import math
import struct
from collections.abc import Callable, Mapping

from canopen.sdo import constants as sdo

from station.adapters.simulated_device.nonvolatile import NonVolatileMemory, SavedObjects, object_key
from station.adapters.simulated_device.program import SimulatedProgram
from station.adapters.simulated_device.sdo_serving import SdoAbort
from station.domain.core.types import Floats
from station.domain.product import writeback
from station.domain.product.device_map import DeviceMap
from station.domain.product.firmware import PROGRAM_CONTROL, PROGRAM_DATA, PROGRAM_STATUS, SOFTWARE_ID
from station.domain.product.object_dictionary import Address, ObjectDictionary, ObjectEntry, Value
from station.domain.product.preset import PresetAxis, preset_axes
from station.errors import InvalidValue, UnitFault, UsageError

_LONGEST = {"STRING": 255, "OCTETS": 255, "DOMAIN": 4096}
_COB_ID_FLAGS = 0xC000_0000
_COMMUNICATION = range(0x1000, 0x2000)
_SOFTWARE_VERSION = 0x100A
#: What is written to a program is no object that a save keeps.
_PROGRAM = ((PROGRAM_DATA, 1), (PROGRAM_CONTROL, 1))
#: The parts of a map that its lock protects.
_LOCKED = ("temperature", "record", "valid")


class SimulatedObjects:
    """Implements sdo_serving.Objects. `computed` gives the present value of objects that are measured.

    command: save or restore, set by a write of the right signature and taken by the device, which needs time
    for it; spoil: lets a fault replace what is read.
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        device_map: DeviceMap,
        memory: NonVolatileMemory,
        *,
        fixed: Mapping[Address, Value],
        computed: Mapping[Address, Callable[[], Value]],
        spoil: Callable[[int, int], Value | None],
    ) -> None:
        self.dictionary = dictionary
        self.map = device_map
        self.memory = memory
        self.command: str | None = None
        self.changes = 0
        self._fixed = dict(fixed)
        self._computed = computed
        self._spoil = spoil
        self._values: dict[Address, bytes] = {}
        self._locked = True
        self._restoring = False
        self._correction: tuple[Floats, Floats] | None = None
        self._protected = _protected(device_map)
        self._presets = {axis.command.address: axis for axis in preset_axes(device_map).values()}
        self._kept_offsets = frozenset(axis.offset.address for axis in self._presets.values())
        version = dictionary.entries.get((_SOFTWARE_VERSION, 0))
        self.program = SimulatedProgram(memory.program_path, str(version.default) if version is not None else "")
        self.start()

    def start(self, *, communication_only: bool = False) -> None:
        """Values as after power-on: factory values, then what was saved; a lock is locked again."""
        if self._restoring:
            self.memory.clear()
            self._restoring = False
        self.changes += 1
        saved = self.memory.objects()
        for address, entry in self.dictionary.entries.items():
            if communication_only and entry.index not in _COMMUNICATION:
                continue
            value = saved.get(object_key(*address), self._fixed.get(address, entry.default))
            self._values[address] = _packed(entry, value)
        self._locked = self.map.unlock is not None
        self.command = None
        self.program.restart()
        self._refresh()

    def replace(self, address: Address, value: Value) -> None:
        """Another value, now and at every start: the unit is not the one it was."""
        self.changes += 1
        self._fixed[address] = value
        self._values[address] = _packed(self.dictionary[address], value)

    def value(self, index: int, sub: int) -> Value | None:
        """Present value of an object; None when there is none."""
        entry = self.dictionary.entries.get((index, sub))
        return None if entry is None else entry.unpack(self._values[index, sub])

    def number(self, index: int, sub: int, otherwise: int) -> int:
        """Present value of an integer object; `otherwise` when the product has no such object."""
        value = self.value(index, sub)
        return int(value) if isinstance(value, (int, float)) else otherwise

    def correction(self) -> tuple[Floats, Floats] | None:
        """(offset (3), matrix (3, 3)) that the output is compensated with; None for raw output."""
        return self._correction if self._compensates() else None

    def stored(self) -> tuple[Floats, Floats] | None:
        """(offset (3), matrix (3, 3)) of the calibration held, whether it is used or not; None: none can be used."""
        return self._correction

    def saved(self) -> SavedObjects:
        """What the next start will read back: the last save, or the factory values."""
        factory = {
            object_key(*address): self._fixed.get(address, entry.default)
            for address, entry in self.dictionary.entries.items()
            if self._is_saved(entry)
        }
        return self.memory.objects() or {k: v.hex() if isinstance(v, bytes) else v for k, v in factory.items()}

    def snapshot(self) -> SavedObjects:
        """What a save keeps: every object that can be read and written."""
        saved: SavedObjects = {}
        for address, entry in self.dictionary.entries.items():
            if self._is_saved(entry):
                value = entry.unpack(self._values[address])
                saved[object_key(*address)] = value.hex() if isinstance(value, bytes) else value
        return saved

    def restore_at_reset(self) -> None:
        """Factory values come back at the next start (CiA 301, object 0x1011)."""
        self._restoring = True

    def read(self, index: int, sub: int) -> bytes:
        """Bytes of an object. Errors: SdoAbort."""
        entry = self._entry(index, sub)
        if not entry.readable:
            raise SdoAbort(sdo.ABORT_READ_WRITEONLY)
        spoiled = self._spoil(index, sub)
        if spoiled is not None:
            return _packed(entry, spoiled)
        if self.map.checksum is not None and (index, sub) == self.map.checksum.address:
            return writeback.expected_checksum(self.map, self._values) or b""
        if (own := self._of_program(index, sub)) is not None:
            return _packed(entry, own)
        if (index, sub) in self._computed:
            return _packed(entry, self._computed[index, sub]())
        return self._values[index, sub]

    def check(self, index: int, sub: int, size: int | None) -> None:
        """Whether an object may be written with that many bytes. Errors: SdoAbort."""
        entry = self._entry(index, sub)
        if not entry.writable:
            raise SdoAbort(sdo.ABORT_WRITE_READONLY)
        if self._locked and (index, sub) in self._protected:
            raise SdoAbort(sdo.ABORT_APPLICATION_DEVICE_STATE)
        if (index, sub) in _PROGRAM:
            self.program.check(index, size)
            return
        if size is None:
            return
        most = entry.size or self._longest(entry)
        if size > most:
            raise SdoAbort(sdo.ABORT_LENGTH_TOO_HIGH)
        if entry.size is not None and size < most:
            raise SdoAbort(sdo.ABORT_LENGTH_TOO_LOW)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Takes a value. Errors: SdoAbort."""
        entry = self._entry(index, sub)
        if entry.size is not None:
            data = data[: entry.size]
        if (command := self._command_at(index, sub)) is not None:
            self._take_signature(command, data)
            return
        if self.map.unlock is not None and (index, sub) == self.map.unlock.address:
            self._take_key(data)
            return
        if (index, sub) in _PROGRAM:
            self.program.write(index, data)
            return
        self._check_range(entry, data)
        self.changes += 1
        if (axis := self._presets.get((index, sub))) is not None:
            self._preset(axis, data)
        else:
            self._values[index, sub] = data
        self._refresh()

    def _preset(self, axis: PresetAxis, data: bytes) -> None:
        """Works the offset out, as CiA 410 says. Errors: SdoAbort where it cannot hold it."""
        where = axis.offset.address
        try:
            self._values[where] = axis.offset_after(self.read(*axis.reading.address), self._values[where], data)
        except InvalidValue:
            raise SdoAbort(sdo.ABORT_INVALID_VALUE) from None

    def _of_program(self, index: int, sub: int) -> Value | None:
        """What the bootloader says of itself; None for any other object."""
        known: dict[Address, Value] = {
            (_SOFTWARE_VERSION, 0): self.program.version,
            (SOFTWARE_ID, 1): self.program.software_id,
            (PROGRAM_STATUS, 1): self.program.status,
        }
        return known.get((index, sub))

    def _is_saved(self, entry: ObjectEntry) -> bool:
        if (entry.index, entry.sub) in self._kept_offsets:
            return True
        return entry.access.startswith("rw") and entry.index not in (0x1010, 0x1011, PROGRAM_CONTROL)

    def _entry(self, index: int, sub: int) -> ObjectEntry:
        if (index, sub) in self.dictionary:
            return self.dictionary[index, sub]
        raise SdoAbort(sdo.ABORT_NO_SUBINDEX if self.dictionary.has_index(index) else sdo.ABORT_NOT_IN_OD)

    def _longest(self, entry: ObjectEntry) -> int:
        record = self.map.record
        return record.length if record and record.address == (entry.index, entry.sub) else _LONGEST[entry.type_name]

    def _command_at(self, index: int, sub: int) -> str | None:
        if self.map.save is not None and (index, sub) == self.map.save.address:
            return "save"
        restore = (0x1011, 1) if self.map.restore is None else self.map.restore.address
        return "restore" if (index, sub) == restore else None

    def _take_signature(self, command: str, data: bytes) -> None:
        if data != (writeback.SAVE if command == "save" else writeback.LOAD):
            raise SdoAbort(sdo.ABORT_STORE_APPLICATION)
        self.command = command

    def _take_key(self, data: bytes) -> None:
        unlock = self.map.unlock
        self._locked = unlock is not None and int.from_bytes(data, "little") != unlock.key

    def _check_range(self, entry: ObjectEntry, data: bytes) -> None:
        value = entry.unpack(data)
        if isinstance(value, (str, bytes)):
            return
        if not math.isfinite(value):
            raise SdoAbort(sdo.ABORT_INVALID_VALUE)
        if entry.high is not None and value > entry.high:
            raise SdoAbort(sdo.ABORT_VALUE_TOO_HIGH)
        if entry.low is not None and value < entry.low:
            raise SdoAbort(sdo.ABORT_VALUE_TOO_LOW)
        if 0x1800 <= entry.index < 0x1A00:
            _check_pdo(entry, int(value))

    def _compensates(self) -> bool:
        if (switch := self.map.switch) is None:
            return self.map.writes and self.map.sends != "raw"
        on = self.value(*switch.address) == switch.compensated
        flag = self.map.valid
        return on and (flag is None or self.value(*flag.address) == flag.valid)

    def _refresh(self) -> None:
        try:
            self._correction = writeback.decode(self.map, self._values)
        except UnitFault:
            self._correction = None  # values by which nothing can be corrected: the output stays raw


def _protected(device_map: DeviceMap) -> frozenset[Address]:
    objects = [getattr(device_map, part) for part in _LOCKED]
    addresses = {o.address for o in objects if o is not None} | {n.address for _, n in device_map.coefficients()}
    if device_map.configuration is not None:
        addresses |= {(device_map.configuration.index, sub) for sub in (1, 2)}
    return frozenset(addresses)


def _packed(entry: ObjectEntry, value: Value) -> bytes:
    """A value as bytes; bytes come as hex text from the memory's file, a float for an integer object is rounded.

    Errors: UsageError.
    """
    try:
        if entry.type_name in ("DOMAIN", "OCTETS") and isinstance(value, str):
            return bytes.fromhex(value)
        if isinstance(value, float) and entry.type_name not in ("REAL32", "REAL64"):
            value = round(value)
        return entry.pack(value)
    except (struct.error, ValueError, OverflowError) as exc:
        place = f"0x{entry.index:04X}:{entry.sub:02X}"
        raise UsageError("simulated-value-beyond", value=str(value)[:40], object=place, type=entry.type_name) from exc


def _check_pdo(entry: ObjectEntry, value: int) -> None:
    """A COB-ID keeps its identifier (only its flags may change); transmission types 241 to 253 are reserved."""
    moved = entry.sub == 1 and (value ^ int(entry.default)) & ~_COB_ID_FLAGS
    if moved or (entry.sub == 2 and 240 < value < 254):
        raise SdoAbort(sdo.ABORT_INVALID_VALUE)
