"""Registers of a PLC, as Modbus has them: sixteen bits each, read and written in blocks."""

from typing import Literal, Protocol

Table = Literal["holding", "input"]


class Registers(Protocol):
    """One connection. Every call is one request with a time-out and is never repeated. Errors: PlcFault."""

    def read(self, table: Table, address: int, count: int) -> list[int]:
        """`count` registers from `address` on, of one instant."""

    def write(self, address: int, words: list[int]) -> None:
        """Writes holding registers. After an error they may hold the old or the new words."""

    def close(self) -> None:
        """Ends the connection; the next call opens another. Twice is harmless."""
