"""What serves a simulated device's objects: SDO, UDS or a vendor's templates, one request after the other."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class SdoRequest:
    """What a request is about: the object of the transfer that it starts or continues, and the direction.

    access: read or write; starts: it starts a transfer; segment: it is one of a block's segments.
    """

    index: int
    sub: int
    access: str
    starts: bool
    segment: bool


class ObjectServer(Protocol):
    """Payloads in, payloads out."""

    def about(self, data: bytes) -> SdoRequest:
        """What a request is about, before it is handled."""

    def handle(self, data: bytes) -> tuple[bytes, ...]:
        """The answers to one request."""

    def refuse(self, data: bytes, code: int) -> bytes:
        """The refusal of a request, not served, for the reason that the SDO abort code says."""

    def abort(self, code: int) -> bytes:
        """The refusal of the request that was handled last."""

    def reset(self) -> None:
        """Forgets what is under way, as a device that starts."""

    def wants_restart(self) -> bool:
        """Whether the last request was to start again, once it is answered."""

    def of_next_object(self, answer: bytes) -> bytes:
        """The same answer as it would be to a request for the object after."""

    def of_other_object(self, answer: bytes, index: int) -> bytes:
        """The same answer as if it were to a request for another object; the answer itself where it names none."""
