"""What a plant keeps of its stations' logs, and the questions that a receiver has to it."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from station.domain.records.arrival import ArrivedRecord, RecordRefusal, Tip
from station.domain.records.wire import WireRecord


@dataclass(frozen=True, slots=True)
class Claim:
    """What a station says of its log: number and seal (hex) of its newest record."""

    newest: int
    seal: str


@dataclass(frozen=True, slots=True)
class QuarantineEntry:
    """One record, or one log's end, that was not taken. first_ns, last_ns: when it came first and last; times: how
    often; resolved_ns: None while nobody has decided."""

    id: int
    station: str
    log_id: str
    number: int
    refusal: RecordRefusal
    first_ns: int
    last_ns: int
    times: int
    resolved_ns: int | None


@dataclass(frozen=True, slots=True)
class StationStanding:
    """One station's log at the plant. newest: what the station says its newest number is; last_ns: when records came
    last, since 1970."""

    station: str
    log_id: str
    number: int
    newest: int
    last_ns: int
    open_quarantine: int


class ArrivingLog(Protocol):
    """One station's log inside one transaction: nobody else appends to it meanwhile."""

    @property
    def tip(self) -> Tip | None:
        """How far the log has come; None where the station has none yet."""

    @property
    def other(self) -> tuple[RecordRefusal, int] | None:
        """Where this log is not the one that the station may ship: why, and the number that the plant has."""

    def seals(self, first: int, last: int) -> list[bytes]:
        """The seals of records first … last as they are kept."""

    def append(self, tip: Tip, records: Sequence[ArrivedRecord], claim: Claim, at_ns: int) -> RecordRefusal | None:
        """Keeps the records, which end at `tip`; why not, where one refers to what the log has not, or cannot be
        kept."""

    def quarantine(self, refusal: RecordRefusal, records: Sequence[WireRecord], at_ns: int) -> None:
        """Keeps what was refused as it came, apart from all that counts."""


class PlantStore(Protocol):
    """The plant's database. Errors: StoreFault while it cannot be reached."""

    def arriving(self, station: str, log_id: str, key: bytes) -> AbstractContextManager[ArrivingLog]:
        """The log, opened to append to; what was kept is on the disk when the block has ended."""

    def standings(self) -> list[StationStanding]:
        """Every station's current log, by name."""

    def quarantined(self, *, resolved: bool = False) -> list[QuarantineEntry]:
        """What waits for a person, oldest first; resolved: what was decided, too."""
