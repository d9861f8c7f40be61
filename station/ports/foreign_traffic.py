"""What anyone but this station says to the units' devices."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class ForeignCommand:
    """A command that changes a device and that the station did not send: a write or an NMT command.

    written: index and sub-index of what is written.
    """

    time_ns: int
    can_id: int
    data: bytes
    written: tuple[int, int] = (0, 0)

    @property
    def is_write(self) -> bool:
        """Whether it is a write; otherwise it is an NMT command."""
        return self.can_id != 0x000


class ForeignTraffic(Protocol):
    """Hears every command on the bus and knows which of them the station sent itself."""

    def commands(self, node: int) -> tuple[ForeignCommand, ...]:
        """Foreign commands to this node since `restart`, oldest first."""

    def restart(self) -> None:
        """Forgets what was heard: another load begins."""
