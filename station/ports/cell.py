"""What stands around the station: a cell that brings loads and takes them back, labels, lamps and a label printer."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from station.domain.cell.handover import CellView, Entry
from station.domain.cell.packml import State


class Cell(Protocol):
    """Loads come and go here. Clamps stay closed until the cell has been given the bins. Errors: PlcFault, Aborted."""

    def view(self) -> CellView:
        """What the cell says now; also tells it that the station lives."""

    def accept(self, load: int) -> None:
        """The station has written this load into its journal."""

    def give(self, load: int, bins: Mapping[int, int]) -> None:
        """Hands the load back: the bin of each place. The same again is harmless."""

    def show(self, state: State, lamps: frozenset[str]) -> None:
        """The station's outer state, and the lamps that go with it."""

    def close(self) -> None:
        """Lets go of it; twice is harmless."""


class Scanner(Protocol):
    """Reads labels. Errors: StationFault where the scanner is gone."""

    def read(self, nest: str, timeout_s: float) -> str | None:
        """What the label in this nest says; None where none could be read in time. Old readings are thrown away."""

    def close(self) -> None:
        """Lets go of it; twice is harmless."""


@dataclass(frozen=True, slots=True)
class UnitLabel:
    """What is printed for one unit."""

    serial: str
    outcome: str
    record: str
    nest: str


class LabelPrinter(Protocol):
    """Prints labels. Errors: StationFault with what the printer wants."""

    def print(self, label: UnitLabel) -> None:
        """Prints one."""


class HandoverJournal(Protocol):
    """The hand-over's lines in the log, and the verdicts that stand there. Errors: StoreFault, LogError."""

    def entries(self) -> Sequence[Entry]:
        """The newest lines, oldest first: at least from the last load that is over on."""

    def add(self, entry: Entry) -> None:
        """One line, durable when this returns; its number is the log's."""

    def outcomes(self, serial: str, nest: str, beyond: int) -> Sequence[str]:
        """Outcomes of finished attempts of the unit in that nest after that record, oldest first."""
