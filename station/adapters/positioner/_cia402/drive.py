"""One axis as the station commands it: its objects over SDO, and what its process data last said."""

import math

from station.adapters.canopen.canopen_device import CanopenDevice
from station.domain.product.emergency_codes import emergency
from station.domain.rig import drive_profile as profile
from station.domain.rig.drive_profile import DriveState, drive_state, object_of
from station.domain.rig.rig_map import Axis
from station.errors import DeviceRefused, DeviceSilent, PositionerFault
from station.messages import Message


class Drive:
    """axis: its part of the map; device: its node. Errors of every call: PositionerFault, BusFault."""

    def __init__(self, axis: Axis, device: CanopenDevice) -> None:
        self.axis, self.device = axis, device
        self.heard_s = -math.inf
        self._word, self._counts = 0, 0

    @property
    def name(self) -> str:
        """What the map calls it."""
        return self.axis.name

    @property
    def word(self) -> int:
        """The statusword of the last process data."""
        return self._word

    @property
    def state(self) -> DriveState:
        """The state that it shows."""
        return drive_state(self._word)

    @property
    def angle_deg(self) -> float:
        """Where the last process data saw the axis."""
        return self.axis.angle_deg(self._counts)

    def take_process_data(self, data: bytes, now_s: float) -> None:
        """Statusword, position and mode display came."""
        if len(data) >= 6:
            self._word = int.from_bytes(data[:2], "little")
            self._counts = int.from_bytes(data[2:6], "little", signed=True)
            self.heard_s = now_s

    def read(self, index: int, sub: int = 0) -> int:
        """Value of a profile object."""
        size = profile.SIZES[index]
        data = self.upload(object_of(index, self.axis.axis), sub)
        if len(data) != abs(size):
            raise PositionerFault("drive-object-size", axis=self.name, index=index, size=len(data), wanted=abs(size))
        return int.from_bytes(data, "little", signed=size < 0)

    def write(self, index: int, value: int, sub: int = 0) -> None:
        """Writes a profile object."""
        size = profile.SIZES[index]
        self.download(object_of(index, self.axis.axis), sub, value.to_bytes(abs(size), "little", signed=size < 0))

    def settle(self, index: int, value: int, sub: int = 0) -> None:
        """Writes a profile object and reads it back."""
        self.write(index, value, sub)
        if (read_back := self.read(index, sub)) != value:
            raise PositionerFault(
                "drive-keeps-other", axis=self.name, index=index, sub=sub, value=value, kept=read_back
            )

    def upload(self, index: int, sub: int) -> bytes:
        """Raw value of any object of its node."""
        try:
            return self.device.upload(index, sub)
        except (DeviceRefused, DeviceSilent) as fault:
            raise PositionerFault("drive-sdo-failed", axis=self.name, reason=fault.message) from None

    def download(self, index: int, sub: int, data: bytes) -> None:
        """Writes any object of its node."""
        try:
            self.device.download(index, sub, data)
        except (DeviceRefused, DeviceSilent) as fault:
            raise PositionerFault("drive-sdo-failed", axis=self.name, reason=fault.message) from None

    def counts(self) -> int:
        """Where the encoder stands now."""
        return self.read(profile.POSITION)

    def fresh_word(self) -> int:
        """The statusword now."""
        self._word = self.read(profile.STATUSWORD)
        return self._word

    def reason(self) -> Message:
        """Why it does not do what it should, as far as it says: safe torque off, its error code, its state."""
        if self.torque_is_off():
            return Message("drive-torque-cut")
        if code := self.read(profile.ERROR_CODE):
            return self.error(code, 0)
        word = self.fresh_word()
        if not word & profile.VOLTAGE:
            return Message("drive-without-supply", axis=self.name)
        return Message("drive-state", axis=self.name, state=str(drive_state(word)), word=word)

    def error(self, code: int, register: int) -> Message:
        """An error that it has reported."""
        meaning = profile.error_meaning(code) or emergency(code, register)
        return Message("drive-error", axis=self.name, code=code, meaning=meaning)

    def torque_is_off(self) -> bool:
        """Whether its maker's object says that the power stage is cut by the safety circuit; False where none does."""
        sto = self.axis.safe_torque_off
        if sto is None:
            return False
        return int.from_bytes(self.upload(sto.index, sto.sub), "little") & sto.mask != sto.clear


#: Error code of a heartbeat that did not come (CiA 301, table 26).
LIFE_GUARD = 0x8130
