"""A request to a device and what may come back: made by a protocol, driven by the client."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Protocol

from station.messages import Message


@dataclass(frozen=True, slots=True)
class ObjectRefusal:
    """The device refuses: the protocol's code, and what it means."""

    code: int
    meaning: Message


class Pending:
    """The device asks for patience: the answer is still to come."""


#: What a payload is to a request: the value it asks for, a refusal, a plea for patience, or None: it belongs elsewhere.
Answer = bytes | ObjectRefusal | Pending | None


@dataclass(frozen=True, slots=True)
class ObjectRequest:
    """payload: what is sent; judge: what a payload that comes is to it."""

    payload: bytes
    judge: Callable[[bytes], Answer]


class ObjectProtocol(Protocol):
    """The requests of one protocol. None where it has none for that object: the device is not asked."""

    pending_s: float

    def read(self, index: int, sub: int) -> ObjectRequest | None:
        """Asks for the value of an object."""

    def write(self, index: int, sub: int, data: bytes) -> ObjectRequest | None:
        """Writes an object, or starts what an object stands for, such as a save."""

    def reset(self) -> ObjectRequest:
        """Makes the device start again."""

    def alive(self) -> ObjectRequest:
        """Any device that is there answers it; a refusal is an answer too."""

    def unlocking(self) -> Generator[ObjectRequest, bytes, None]:
        """What must be asked before a write: requests one by one, each given the answer to the one before."""


class Transport(Protocol):
    """Payloads to and from one device. Errors: BusFault."""

    def send(self, payload: bytes) -> None:
        """Sends a payload whole."""

    def receive(self, deadline_s: float) -> bytes | None:
        """The next payload that comes, at most until the clock shows `deadline_s`; None when none does."""
