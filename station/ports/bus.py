"""The CAN bus as the station sees it: a stream of frames, and a service channel for CANopen."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from station.domain.core.types import Frames
from station.messages import Message


@dataclass(frozen=True, slots=True)
class ErrorCounters:
    """Error counters of the controller (ISO 11898-1): above 127 it is passive, above 255 while sending bus-off."""

    sending: int
    receiving: int


class Repeated(Protocol):
    """A frame that is sent again and again until it is closed."""

    def close(self) -> None:
        """Sends it no more; closing twice is harmless."""


class Channel(Protocol):
    """One opened socket with its own filters. Every call returns within its time-out; nothing runs behind it.

    Errors: BusFault when the interface is down, bus-off or has no buffer left, with the remedy.
    """

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one classic frame; waits briefly and retries while the kernel's queue is full (ENOBUFS)."""

    def receive(self, timeout_s: float) -> Frames:
        """All frames waiting, in order; waits up to `timeout_s` for the first, and may return none.

        Error frames carry the ERROR flag in can_id (stream channels only)."""

    def drops(self) -> int:
        """Frames the kernel has dropped on this socket since it was opened."""

    def close(self) -> None:
        """Closes the socket; closing twice is harmless."""


@runtime_checkable
class Endpoint(Channel, Protocol):
    """A channel from the devices' side: a simulated device hands over a whole dwell at once."""

    def send_many(self, frames: Frames) -> None:
        """Sends all frames in order. On the simulated bus they keep their time_ns, which may lie in the past

        (what a device sent since it last acted) but not in the future; on a real bus they leave at once.
        """


class Bus(Protocol):
    """One CAN interface. Two sockets: the 1 kHz stream must not pass through CANopen, nor the other way round."""

    @property
    def name(self) -> str:
        """What a person calls it: can0, vcan0, a log's file name."""

    def stream(self, can_ids: tuple[int, ...]) -> Channel:
        """A channel that receives these ids and error frames, with a large buffer."""

    def service(self, can_ids: tuple[int, ...]) -> Channel:
        """A channel for SDO, NMT, EMCY and heartbeat; an empty tuple receives everything but error frames."""

    def repeat(self, can_id: int, data: bytes, period_s: float) -> Repeated:
        """Sends a frame every period_s from now on, whatever else this process does. Errors: BusFault."""

    def state(self) -> str:
        """Controller state: active, warning, passive, bus-off, down, or unknown where nobody can tell."""

    def counters(self) -> ErrorCounters | None:
        """Error counters of the controller; None where the adapter does not tell them."""

    def close(self) -> None:
        """Closes every channel opened here."""


@runtime_checkable
class TellsLimits(Protocol):
    """A bus that says what it cannot tell."""

    @property
    def limits(self) -> Message:
        """Whose clock its time stamps are, what of losses and error frames it does not report."""
