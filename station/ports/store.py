"""The log: written as the run goes, append-only, hash-chained. Contracts, section 7."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from station.domain.types import Frames


@dataclass(frozen=True, slots=True)
class Begin:
    """What is known before the device is touched."""

    serial: str
    station: str
    nest: str
    node: int
    recipe_name: str
    recipe_version: int
    recipe_hash: str
    recipe_json: str
    config_hash: str
    software: str
    operator: str
    started_ns: int
    lot: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class VisitRecord:
    """One finished stop of one attempt: raw frames and what they came to."""

    run: int
    visit: int
    position: str
    seating: str
    kind: str  # "tumble" | "verify"
    arrived_ns: int
    left_ns: int
    frames: Frames
    statistics: Mapping[str, Any]  # mean, std, count, effective, gaps, repeats, crc_errors, kernel_drops, …


@dataclass(frozen=True, slots=True)
class WriteRecord:
    """One object of the device: what it held, what was sent, what it held after; None: not (yet) known."""

    index: int
    sub: int
    name: str
    old: bytes | None
    written: bytes
    read_back: bytes | None
    value: float | None = None
    stage: str = "intent"  # intent | written | verified | refused | unknown


class Store(Protocol):
    """Where attempts go. Every method is one durable transaction. Errors: StoreFault when it cannot be kept."""

    def begin(self, begin: Begin) -> str:
        """Creates the attempt before the device is touched; returns its id (UUID)."""

    def event(self, attempt: str, kind: str, detail: Mapping[str, Any]) -> None:
        """Appends an event to the attempt."""

    def visit(self, attempts: Sequence[str], visits: Sequence[VisitRecord]) -> None:
        """Keeps one stop of every nest, in one transaction."""

    def write(self, attempt: str, write: WriteRecord) -> None:
        """Keeps one stage of an object write: the intent before, the fact after."""

    def result(self, attempt: str, name: str, document: Mapping[str, Any]) -> None:
        """Keeps a named result: identity, calibration, verdict, verification, old-calibration."""

    def finish(self, attempt: str, outcome: str, ended_ns: int) -> None:
        """Closes the attempt with its outcome; what follows can only be another attempt."""
