"""What anyone but this station says to the units' devices."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class ForeignCommand:
    """A command that changes a device and that the station did not send: an SDO write or an NMT command."""

    time_ns: int
    can_id: int
    data: bytes

    @property
    def is_write(self) -> bool:
        """Whether it is an SDO write; otherwise it is an NMT command."""
        return self.can_id != 0x000

    @property
    def address(self) -> tuple[int, int]:
        """Index and sub-index of an SDO write."""
        return int.from_bytes(self.data[1:3], "little"), self.data[3]


class ForeignTraffic(Protocol):
    """Hears every command on the bus and knows which of them the station sent itself."""

    def commands(self, node: int) -> tuple[ForeignCommand, ...]:
        """Foreign commands to this node since `restart`, oldest first."""

    def restart(self) -> None:
        """Forgets what was heard: another load begins."""
