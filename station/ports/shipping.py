"""The way of a log's records to a plant: where they come from, and who takes them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from station.domain.records.wire import WireRecord
from station.messages import Message
from station.ports.plant import Claim


class RecordSource(Protocol):
    """The station's log as it is shipped: read only, while a run writes it. Errors: LogError."""

    @property
    def log_id(self) -> str:
        """What sets the log apart."""

    def newest(self) -> Claim:
        """Number and seal of the newest record."""

    def seals(self, first: int, last: int) -> list[bytes]:
        """Seals of records first … last."""

    def read(self, after: int, most_bytes: int) -> list[WireRecord]:
        """The records after a number, at least one where there is any, of about so many bytes."""


@dataclass(frozen=True, slots=True)
class ReceiverAnswer:
    """How far a receiver has the log, with the seal there; and the record that it refused, and why."""

    number: int
    seal: bytes
    refused: int = 0
    reason: str = ""
    message: Message | None = None


class ReceiverAway(OSError):
    """Nothing came of a question, and why."""

    def __init__(self, message: Message) -> None:
        super().__init__(message.id)
        self.message = message


class RecordReceiver(Protocol):
    """A plant. Errors: OSError while it cannot be reached or cannot keep anything."""

    def standing(self, log_id: str) -> ReceiverAnswer:
        """How far it has the log."""

    def seals(self, log_id: str, first: int, last: int) -> list[bytes]:
        """Its seals of records first … last."""

    def send(self, log_id: str, records: Sequence[WireRecord], claim: Claim) -> ReceiverAnswer:
        """Hands over records; what is answered as kept is on its disk."""
