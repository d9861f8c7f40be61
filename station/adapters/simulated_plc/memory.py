"""A simulated PLC in this process: its registers without a wire, its wire's faults as the station would meet them."""

from collections.abc import Sequence
from typing import Protocol

from station.errors import PlcFault
from station.messages import Message
from station.ports.clock import Clock
from station.ports.registers import Table

#: As long as the station waits for an answer, s.
TIMEOUT_S = 0.3


class RegisterDevice(Protocol):
    """A simulated device with registers: a PLC, a remote I/O."""

    def read(self, address: int, count: int, now_s: float) -> list[int]:
        """Registers as they are at an instant."""

    def write(self, address: int, words: Sequence[int], now_s: float) -> None:
        """Sets registers."""

    def scan(self, now_s: float) -> None:
        """Brings everything up to an instant."""

    def wire_fault(self, now_s: float) -> str:
        """What is wrong with its wire; '' for nothing."""


class MemoryRegisters:
    """Implements `ports.registers.Registers` on virtual or real time."""

    def __init__(self, device: RegisterDevice, clock: Clock) -> None:
        self._device, self._clock = device, clock
        self._dropped = False

    def read(self, table: Table, address: int, count: int) -> list[int]:  # noqa: ARG002 - one table
        """Registers, as the wire lets them through."""
        self._arrive()
        found = self._device.read(address, count, self._clock.monotonic_s())
        self._answer()
        return found

    def write(self, address: int, words: list[int]) -> None:
        """Registers, as the wire lets them through: a late answer comes after the PLC has acted."""
        self._arrive()
        self._device.write(address, words, self._clock.monotonic_s())
        self._answer()

    def close(self) -> None:
        """There is no connection."""

    def _arrive(self) -> None:
        now_s = self._clock.monotonic_s()
        self._device.scan(now_s)
        kind = self._device.wire_fault(now_s)
        if kind == "killed":
            raise PlcFault("plc-not-reached", host="simulated", port=0)
        if kind == "dropped" and not self._dropped:
            self._dropped = True
            raise PlcFault("plc-lost", host="simulated", port=0, reason=Message("system-pipe-closed"))
        if kind in ("silent", "garbage"):
            self._time_out()
        if kind == "exception":
            raise PlcFault("plc-exception", host="simulated", port=0, code=4, address=0)

    def _answer(self) -> None:
        kind = self._device.wire_fault(self._clock.monotonic_s())
        if kind == "slow":
            self._clock.sleep(0.05)
        if kind == "late":
            self._time_out()

    def _time_out(self) -> None:
        self._clock.sleep(TIMEOUT_S)
        reason = Message("plc-no-answer", timeout_s=TIMEOUT_S, why="time-out")
        raise PlcFault("plc-lost", host="simulated", port=0, reason=reason)
