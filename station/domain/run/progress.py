"""What a fixture load goes through: its phases with their transition table, and the events the runner yields."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from station.domain.core.types import NestAssignment, Outcome, Reason
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.run.transitions import TransitionTable
from station.errors import StationError
from station.messages import Message


class Phase(StrEnum):
    """Where a fixture load stands."""

    BEGIN = "begin"
    IDENTIFY = "identify"
    MEASURE = "measure"
    JUDGE = "judge"
    WRITE = "write"
    SAVE = "save"
    RESTART = "restart"
    VERIFY = "verify"
    CLOSE = "close"
    PARK = "park"
    DONE = "done"


#: The only ways on. CLOSE may follow everything: a fault, a visit, or no unit left to go on with.
PHASES = TransitionTable(
    "the run",
    {
        Phase.BEGIN: frozenset({Phase.IDENTIFY, Phase.CLOSE}),
        Phase.IDENTIFY: frozenset({Phase.MEASURE, Phase.CLOSE}),
        Phase.MEASURE: frozenset({Phase.JUDGE, Phase.CLOSE}),
        Phase.JUDGE: frozenset({Phase.WRITE, Phase.CLOSE}),
        Phase.WRITE: frozenset({Phase.SAVE, Phase.CLOSE}),
        Phase.SAVE: frozenset({Phase.RESTART, Phase.CLOSE}),
        Phase.RESTART: frozenset({Phase.VERIFY, Phase.CLOSE}),
        Phase.VERIFY: frozenset({Phase.CLOSE}),
        Phase.CLOSE: frozenset({Phase.PARK}),
        Phase.PARK: frozenset({Phase.DONE}),
        Phase.DONE: frozenset(),
    },
)


@dataclass(frozen=True, slots=True, eq=False)
class UnitResult:
    """How one attempt ended. fit: calibration, budget and verdict, None where it did not come so far; noise: largest
    standard deviation of a sample of any axis and stop, recipe's unit; verification: the record's, where it came so
    far."""

    seat: NestAssignment
    attempt: str
    outcome: Outcome
    reasons: tuple[Reason, ...]
    fit: CalibrationResult | None
    written: bool
    verified: bool
    noise: float | None
    duration_s: float
    verification: Mapping[str, Any] | None = None


class Event:
    """Something that happened in a run; the face prints it, the page streams it."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class LoadStarted(Event):
    """A fixture load starts: who sits where, how many visits, and how long it should take, s."""

    seats: tuple[NestAssignment, ...]
    visits: int
    estimate_s: float


@dataclass(frozen=True, slots=True)
class PhaseEntered(Event):
    """The load entered a phase."""

    phase: Phase


@dataclass(frozen=True, slots=True)
class WarmUpStarted(Event):
    """Pass `number` (from 1) waits until its devices are warm."""

    number: int
    duration_s: float


@dataclass(frozen=True, slots=True)
class Identified(Event):
    """A device said who it is, as the product's sheet calls it."""

    seat: NestAssignment
    name: str
    software: str
    device_serial: int


@dataclass(frozen=True, slots=True)
class VisitStarted(Event):
    """The fixture goes to a position (number from 1); instruction: what a person who turns it by hand must do."""

    number: int
    total: int
    position: str
    instruction: Message | None = None


@dataclass(frozen=True, slots=True)
class Notice(Event):
    """A message for the operator; serial '' means the whole fixture."""

    message: Message
    serial: str = ""


@dataclass(frozen=True, slots=True)
class VisitRejected(Event):
    """A unit's visit was bad, with every reason; again: it is measured once more."""

    serial: str
    position: str
    reasons: tuple[Reason, ...]
    again: bool


@dataclass(frozen=True, slots=True)
class LiveReading(Event):
    """What the units read just now, in the middle of a dwell: serial → mean of the newest samples, and the standard
    deviation of one sample of the noisiest axis, both in the recipe's unit. Only for the eye; nothing is kept."""

    means: Mapping[str, tuple[float, ...]]
    noise: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class VisitDone(Event):
    """A visit is measured and kept. means: serial → mean reading in the recipe's unit."""

    number: int
    total: int
    position: str
    means: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class Judged(Event):
    """A unit's calibration and what was decided about it."""

    seat: NestAssignment
    fit: CalibrationResult


@dataclass(frozen=True, slots=True)
class ObjectWritten(Event):
    """One object of the calibration stands in the device, read back bit for bit."""

    serial: str
    name: str
    number: int
    total: int


@dataclass(frozen=True, slots=True, eq=False)
class UnitDone(Event):
    """An attempt is closed and committed; only now may PASS be shown."""

    result: UnitResult


@dataclass(frozen=True, slots=True, eq=False)
class LoadDone(Event):
    """The load is over and the fixture parked; fault: what ended it for everybody, or what parking met."""

    results: tuple[UnitResult, ...]
    fault: StationError | None = None
