"""The log as it is read while another process writes it: what the page, the auditor and the reports need."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, NamedTuple, Protocol, Self, runtime_checkable

from station.domain.core.types import Frames
from station.domain.records.chain import IntegrityFinding
from station.domain.records.head import SealedHead
from station.messages import Message
from station.ports.store import LogHead, StoredCalibration, UnfinishedAttempt

#: The finest grouping of yields, and what parts the names of one of its groups.
YIELD_CELL, YIELD_SEPARATOR = ("station", "nest", "recipe", "day"), "\x1f"


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt's row; outcome and ended_ns are None while it runs. number: its record in the chain."""

    number: int
    attempt: str
    serial: str
    station: str
    nest: str
    node: int
    lot: str
    recipe_name: str
    recipe_version: int
    recipe_hash: str
    config_hash: str
    software: str
    operator: str
    started_ns: int
    outcome: str | None
    ended_ns: int | None


class SelectedAttempt(NamedTuple):
    """The least of an attempt that has ended: of a million, each must be small."""

    number: int
    attempt: str
    outcome: str


@dataclass(frozen=True, slots=True)
class Query:
    """Which attempts; what is None does not matter. Times are of the start, since_ns included, until_ns not.

    serial_from: serials that begin with it; serial_like: serials of a pattern with * and ?. check: verdicts that name
    this limit or check; fixture: what config.yaml calls it. before: only records numbered below, to page backwards.
    """

    serial: str | None = None
    serial_from: str | None = None
    station: str | None = None
    nest: str | None = None
    lot: str | None = None
    operator: str | None = None
    software: str | None = None
    recipe_name: str | None = None
    recipe_hash: str | None = None
    firmware: str | None = None
    outcome: str | None = None
    since_ns: int | None = None
    until_ns: int | None = None
    before: int | None = None
    serial_like: str | None = None
    recipe_version: int | None = None
    fixture: str | None = None
    check: str | None = None
    reference: str | None = None


def serial_filter(serial: str | None) -> dict[str, str | None]:
    """One serial, those that begin so, or those of a pattern with * and ?."""
    if serial is None or not set(serial) & set("*?"):
        return {"serial": serial}
    if serial.endswith("*") and not set(serial[:-1]) & set("*?["):
        return {"serial_from": serial[:-1]}
    return {"serial_like": serial.replace("[", "[[]")}


@dataclass(frozen=True, slots=True)
class LogRecord:
    """A record with its seal. fields: what is sealed, by name, in the order in which it is sealed."""

    number: int
    kind: str
    previous: bytes
    hash: bytes
    signature: bytes | None
    fields: Mapping[str, int | float | str | bytes | None]


@dataclass(frozen=True, slots=True)
class EventRecord:
    """One event as the log holds it; number is the cursor for the next call. attempt: "" for the station's own."""

    number: int
    attempt: str
    at_ns: int
    kind: str
    detail: str


@dataclass(frozen=True, slots=True)
class LogChange:
    """One new record. number: the cursor for the next call; what: attempt | event | visit | write | result | finish;
    attempt: its id, "" for an event of the station; detail: serial, kind, position, name or outcome."""

    number: int
    what: str
    attempt: str
    at_ns: int
    detail: str


@dataclass(frozen=True, slots=True)
class Yield:
    """Counts of one group. attempts: finished ones; units: serial numbers whose first attempt lies in the group.

    first_pass: of those, how many passed at their first attempt, whatever stopped the others. final_pass, final:
    serials whose last attempt lies in the group, and how many of those passed it.
    """

    group: str
    attempts: int
    passed: int
    failed: int
    errors: int
    aborted: int
    interrupted: int
    units: int
    first_pass: int
    final: int
    final_pass: int
    mean_duration_s: float

    @property
    def first_pass_yield(self) -> float:
        """Share of units that passed at once; NaN where there is none."""
        return self.first_pass / self.units if self.units else float("nan")

    @property
    def final_yield(self) -> float:
        """Share of units whose last attempt passed; NaN where there is none."""
        return self.final_pass / self.final if self.final else float("nan")


@dataclass(frozen=True, slots=True)
class ReducedAttempt:
    """One attempt. number: its record; product: the record of its product; stops: JSON;
    before: JSON of outcome, offset, matrix, checks; station, nest, lot, started_ns: where and when; simulated: rig and
    devices were; history: JSON of what the log had taught it, or ""."""

    number: int
    attempt: str
    serial: str
    product: int | None
    stops: str
    before: str
    station: str
    nest: str
    lot: str
    started_ns: int
    simulated: bool
    history: str


@dataclass(frozen=True, slots=True)
class RecentFigures:
    """The line of late, for a monitor. outcomes: finished attempts by outcome; cycle_s: mean time of the newest units
    that passed, None before the first; last_pass_s: when one passed last, since 1970. The counts are of the newest
    `visits` visits: frames that the kernel dropped, that are missing by their counters, with a wrong CRC; visits with
    error frames of the bus; visits measured again or given up."""

    outcomes: Mapping[str, int]
    cycle_s: float | None
    last_pass_s: float | None
    visits: int
    kernel_drops: int
    lost: int
    crc_errors: int
    bus_error_visits: int
    rejected: int


@dataclass(frozen=True, slots=True)
class Trust:
    """What a check may rely on beside the log itself.

    known: seals by record number from a certificate or export, instead of the head file. public_key: the station's,
    32 bytes; None: the key that the log itself names, if any. anchors: heads kept elsewhere, by place; None: the place
    holds none that can be read.
    """

    known: Mapping[int, bytes] = field(default_factory=dict)
    public_key: bytes | None = None
    anchors: Mapping[str, SealedHead | None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class AnchorState:
    """What one place says of the log: the number of its head, `agrees` or what is wrong, and the sentence of that."""

    number: int
    what: str
    message: Message | None


NO_EXTRA_TRUST = Trust()


def ignore_progress(_number: int) -> None:
    """Progress that nobody follows."""


@runtime_checkable
class LogReader(Protocol):
    """A log opened for reading. Every call sees what was committed before it. Errors: LogError."""

    @property
    def location(self) -> str:
        """Where the log lies, as sentences name it."""

    def close(self) -> None:
        """Closes the log; twice is harmless."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, tb: TracebackType | None, /
    ) -> None: ...

    def head(self) -> LogHead:
        """The newest record, to be printed on what is exported."""

    def attempts(self, query: Query, limit: int | None = None) -> list[Attempt]:
        """Attempts that the query names, newest first."""

    def reasons(self, numbers: Sequence[int]) -> dict[int, list[dict[str, Any]]]:
        """The reasons of the verdicts of those attempts, by their record numbers."""

    def records(self, attempt: Attempt) -> list[LogRecord]:
        """Every sealed record of that attempt, and the documents that it names, in the order of their numbers."""

    def config(self, attempt: Attempt) -> str:
        """The JSON of the settings of that attempt; "" where none was kept."""

    def count(self, query: Query) -> int:
        """How many attempts the query names."""

    def life(self, query: Query, limit: int | None = None) -> list[dict[str, Any]]:
        """The attempts that the query names with everything kept of them, oldest first."""

    def attempt(self, attempt: Attempt) -> dict[str, Any]:
        """Everything kept of one attempt."""

    def lives(self, attempts: Sequence[Attempt]) -> list[dict[str, Any]]:
        """Everything kept of each attempt, in their order."""

    def running(self) -> Sequence[UnfinishedAttempt]:
        """Attempts that have begun and not ended, with what has been written to their devices."""

    def events(self, after: int = 0, limit: int = 1000) -> list[EventRecord]:
        """Events with numbers beyond `after`, oldest first: call again with the last one's number."""

    def station_events(self, kind: str, newest: int) -> list[EventRecord]:
        """The newest events of the station itself of one kind, oldest first."""

    def changes(self, after: int = 0, limit: int = 1000) -> list[LogChange]:
        """Records of attempts with numbers beyond `after`, oldest first: what a page needs to stay up to date."""

    def changed_days(self, after: int) -> frozenset[int]:
        """Days since 1970 (UTC) whose yields the records beyond `after` may have altered."""

    def yields(self, query: Query, by: str = "all") -> list[Yield]:
        """First-pass and final yield by station, nest, recipe, lot, operator, day, or `cell` (YIELD_CELL)."""

    def recent(self, units: int, visits: int) -> RecentFigures:
        """Figures of the newest so many units that passed and of the newest so many visits."""

    def frames(self, attempt: Attempt) -> list[Frames]:
        """Raw frames of each visit of an attempt, in the order of its visits."""

    def recipe_and_product(self, attempt: Attempt) -> tuple[str, str]:
        """The JSON of recipe and product as the attempt used them; "" where none was kept."""

    def reduced(self, numbers: Sequence[int]) -> list[ReducedAttempt]:
        """Those of the attempts that came to a calibration, in the order of their records."""

    def calibrations(self, recipe_hash: str, newest: int) -> Sequence[StoredCalibration]:
        """Of the newest so many attempts with this recipe those that came to a calibration, oldest first."""

    def document(self, number: int) -> str:
        """The text that a document record holds."""

    def selection(self, query: Query) -> Iterator[SelectedAttempt]:
        """Attempts that the query names and that have ended, one at a time, in the order of their records."""

    def recipes(self, query: Query) -> list[str]:
        """The JSON of every recipe that those attempts were made with; "" where none was kept."""

    def anchors(self, trust: Trust = NO_EXTRA_TRUST) -> dict[str, AnchorState]:
        """What each place that keeps a head of the log says of it, the file beside it first."""

    def acknowledgements(self) -> list[dict[str, Any]]:
        """Every time that somebody went on with the log against its heads: at_ns, by, reason, findings."""

    def findings(
        self, trust: Trust = NO_EXTRA_TRUST, progress: Callable[[int], None] = ignore_progress
    ) -> Iterator[IntegrityFinding]:
        """Everything wrong with the log's chain; progress is called with the record's number now and then."""
