"""The object dictionary of a simulated drive: which objects there are, how long, and what may be written to them."""

from collections.abc import Callable, Mapping, Sequence

from canopen.sdo import constants as sdo

from station.adapters.simulated_device.drive.axis import DriveAxis
from station.adapters.simulated_device.sdo_serving import SdoAbort
from station.domain.rig import drive_profile as profile
from station.domain.rig.drive_profile import DriveState

#: Objects of an axis: index, sub → bytes (negative: signed), and whether they can be written.
AXIS_OBJECTS: Mapping[tuple[int, int], tuple[int, bool]] = {
    (0x6007, 0): (-2, True), (0x603F, 0): (2, False), (0x6040, 0): (2, True), (0x6041, 0): (2, False),
    (0x605A, 0): (-2, True), (0x605D, 0): (-2, True), (0x605E, 0): (-2, True), (0x6060, 0): (-1, True),
    (0x6061, 0): (-1, False), (0x6064, 0): (-4, False), (0x6065, 0): (4, True), (0x6066, 0): (2, True),
    (0x6067, 0): (4, True), (0x6068, 0): (2, True), (0x606C, 0): (-4, False), (0x607A, 0): (-4, True),
    (0x607C, 0): (-4, True), (0x607D, 1): (-4, True), (0x607D, 2): (-4, True), (0x6081, 0): (4, True),
    (0x6083, 0): (4, True), (0x6084, 0): (4, True), (0x6085, 0): (4, True), (0x6098, 0): (-1, True),
    (0x6099, 1): (4, True), (0x6099, 2): (4, True), (0x609A, 0): (4, True),
}  # fmt: skip
#: Objects of the node; those of its process data are made for each axis.
NODE_OBJECTS: Mapping[tuple[int, int], tuple[int, bool]] = {
    (0x1000, 0): (4, False), (0x1001, 0): (1, False), (0x1016, 0): (1, False), (0x1016, 1): (4, True),
    (0x1017, 0): (2, True), (0x1018, 0): (1, False), (0x1018, 1): (4, False), (0x1018, 2): (4, False),
    (0x1018, 3): (4, False), (0x1018, 4): (4, False), (0x251A, 0): (4, False),
}  # fmt: skip
#: Sub-indices of process data: communication (COB-ID, type, inhibit time, event timer) and mapping (count, entries).
_PDO = {0: (1, False), 1: (4, True), 2: (1, True), 3: (2, True), 5: (2, True)}
_MAPPING = {0: (1, True), 1: (4, True), 2: (4, True), 3: (4, True)}
PDO_OFF = 0x8000_0000
#: Faults → what they refuse to be written, in the numbering of the first axis.
_REFUSED = {
    "mode-refused": {(profile.MODE, 0)},
    "sdo-refuses-target": {(profile.TARGET, 0)},
    "limits-refused": {(profile.SOFTWARE_LIMITS, 1), (profile.SOFTWARE_LIMITS, 2)},
}


class DriveObjects:
    """Implements sdo_serving.Objects over the axes of one node. written: told of each write, with its value."""

    def __init__(self, axes: Sequence[DriveAxis], written: Callable[[int, int, int], None], now: Callable[[], float]):
        self.axes = axes
        self._written, self._now = written, now
        self.values: dict[tuple[int, int], int] = {}
        self.identity: tuple[int, int, int, int] = 0, 0, 0, 0

    def power_on(self, vendor: int, product: int, revision: int, node: int) -> None:
        """Values as after power-on."""
        self.values = dict.fromkeys(NODE_OBJECTS, 0)
        other = self.axes[0].has("other-type")
        self.values |= {(0x1000, 0): 0x0002_0192, (0x1018, 0): 4, (0x1018, 1): vendor, (0x1018, 2): product + other}
        self.values |= {(0x1018, 3): revision, (0x1018, 4): 1, (0x1016, 0): 1}
        for number in range(len(self.axes)):
            self.values |= {(0x1400 + number, s): 0 for s in _PDO} | {(0x1600 + number, s): 0 for s in _MAPPING}
            self.values |= {(0x1800 + number, s): 0 for s in _PDO} | {(0x1A00 + number, s): 0 for s in _MAPPING}
            self.values[0x1400 + number, 1] = PDO_OFF | 0x200 + 0x100 * number + node
            self.values[0x1800 + number, 1] = PDO_OFF | 0x180 + 0x100 * number + node

    def read(self, index: int, sub: int) -> bytes:
        """Bytes of an object. Errors: SdoAbort."""
        size, _ = self._entry(index, sub)
        return self.value(index, sub).to_bytes(abs(size), "little", signed=size < 0)

    def value(self, index: int, sub: int) -> int:
        """Present value of an object that there is."""
        if index < 0x6000:
            return self._torque_bits() if index == 0x251A else self.values[index, sub]
        axis, plain = self._axis(index)
        now_s = self._now()
        place = axis.encoder(now_s)
        measured = {
            profile.STATUSWORD: axis.statusword(),
            profile.POSITION: place,
            profile.MODE_DISPLAY: axis.shown_mode,
            profile.ERROR_CODE: axis.error,
            0x606C: round(axis.motor.at(now_s)[1]),
        }
        return measured[plain] if plain in measured else axis.values[plain, sub]

    def check(self, index: int, sub: int, size: int | None) -> None:
        """Whether an object may be written with so many bytes. Errors: SdoAbort."""
        length, writable = self._entry(index, sub)
        if not writable:
            raise SdoAbort(sdo.ABORT_WRITE_READONLY)
        if size is not None and size != abs(length):
            raise SdoAbort(sdo.ABORT_LENGTH_TOO_HIGH if size > abs(length) else sdo.ABORT_LENGTH_TOO_LOW)
        self._refuse(index, sub)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Takes a value. Errors: SdoAbort."""
        size, _ = self._entry(index, sub)
        value = int.from_bytes(data[: abs(size)], "little", signed=size < 0)
        if index >= 0x6000:
            axis, plain = self._axis(index)
            axis.write(plain, sub, value, self._now())
        elif not (index == 0x1016 and self.axes[0].has("watch-missing")):
            self.values[index, sub] = value
        self._written(index, sub, value)

    def _entry(self, index: int, sub: int) -> tuple[int, bool]:
        if 0x6000 <= index < 0x6800 + 0x800 * (len(self.axes) - 1):
            found = AXIS_OBJECTS.get((0x6000 + (index - 0x6000) % profile.AXIS_OFFSET, sub))
        elif (index, sub) in NODE_OBJECTS:
            found = NODE_OBJECTS[index, sub]
        elif (index, sub) in self.values:
            found = (_MAPPING if index & 0x0200 else _PDO)[sub]
        else:
            found = None
        if found is None:
            raise SdoAbort(sdo.ABORT_NOT_IN_OD)
        return found

    def _axis(self, index: int) -> tuple[DriveAxis, int]:
        number, rest = divmod(index - 0x6000, profile.AXIS_OFFSET)
        return self.axes[number], 0x6000 + rest

    def _refuse(self, index: int, sub: int) -> None:
        if index == 0x1016 and self.axes[0].has("watch-refused"):
            raise SdoAbort(sdo.ABORT_NOT_IN_OD)
        if index < 0x6000:
            return
        axis, plain = self._axis(index)
        if any(axis.has(kind) and (plain, sub) in objects for kind, objects in _REFUSED.items()):
            raise SdoAbort(sdo.ABORT_INVALID_VALUE)
        # A mode is not changed while the axis is told to halt, and not in a move.
        if plain == profile.MODE and axis.state is DriveState.ENABLED and axis.values[0x6040, 0] & profile.HALT:
            raise SdoAbort(sdo.ABORT_APPLICATION_DEVICE_STATE)

    def _torque_bits(self) -> int:
        return 3 if any(axis.torque_off for axis in self.axes) else 0
