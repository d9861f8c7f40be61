"""A TPDO by its communication parameters (CiA 301, 7.5.2.35 to 7.5.2.38)."""

from dataclasses import dataclass

from station.domain.core.types import EXTENDED

COMMUNICATION, MAPPING = 0x1800, 0x1A00
COB_ID, TRANSMISSION, EVENT_TIMER = 1, 2, 5
OFF, LONG_ID = 1 << 31, 1 << 29
#: Transmission types up to here follow SYNC, from EVENT on the device's own events.
LAST_SYNC, EVENT = 240, 254


@dataclass(frozen=True, slots=True)
class SendingPdo:
    """A TPDO as it was found. number: from 0; cob_id: with its flags; event_timer: bytes, None where there is none;
    mapping: of its entries, none where it cannot be read."""

    number: int
    cob_id: int
    transmission: int
    event_timer: bytes | None
    mapping: tuple[int, ...]

    @property
    def can_id(self) -> int:
        """Identifier with the kernel's flag."""
        long = bool(self.cob_id & LONG_ID)
        return self.cob_id & 0x1FFF_FFFF | EXTENDED if long else self.cob_id & 0x7FF

    @property
    def is_off(self) -> bool:
        """Whether the device does not send it at all."""
        return bool(self.cob_id & OFF)

    @property
    def event_timer_ms(self) -> int | None:
        """0 where the timer is off."""
        return None if self.event_timer is None else int.from_bytes(self.event_timer, "little")
