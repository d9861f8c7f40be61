"""The log: written as the run goes, append-only, hash-chained. docs/formats.md, Log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from station.domain.core.types import Frames
from station.domain.records.framepack.plain import PlainFrames


@dataclass(frozen=True, slots=True)
class AttemptStart:
    """What is known before the device is touched.

    recipe_json, product_json: the recipe and the product (frames and device map) as used, so that the attempt
    can be refitted without any file; config_json: the settings whose hash is config_hash; hashes as the rest of the
    station prints them.
    """

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
    product_json: str = ""
    config_json: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class VisitRecord:
    """One finished visit of one attempt: raw frames and what they came to.

    statistics: from_ns and to_ns, the dwell that a refit cuts out of the frames (`capture.assemble`), and for
    people mean, std, count, gaps, repeats, crc_errors, kernel_drops, temperature_degC, reasons of a rejection.
    encoded: the frames as the log keeps them, where they were laid out and hashed as they came in.
    """

    run: int
    visit: int
    position: str
    seating: str
    kind: str  # "tumble" | "verify" | "rejected"
    arrived_ns: int
    left_ns: int
    frames: Frames
    statistics: Mapping[str, Any]
    encoded: PlainFrames | None = None


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


@dataclass(frozen=True, slots=True)
class UnfinishedAttempt:
    """An attempt that has begun and not ended, as a start-up finds it; last_event: kind of its newest event."""

    attempt: str
    serial: str
    station: str
    nest: str
    node: int
    started_ns: int
    last_event: str
    visits: int
    writes: tuple[WriteRecord, ...]
    product_json: str = ""
    config_json: str = ""


@dataclass(frozen=True, slots=True)
class SuspectAttempt:
    """The last attempt that was going to change a unit, of which nobody knows that it left all old or all new.

    state: the last word about the device's objects: '' (none), mixed, other or unknown. old, planned: objects as
    `2101:01` → bytes in hexadecimal, as they were read before and as they were to be.
    """

    attempt: str
    serial: str
    started_ns: int
    state: str
    old: Mapping[str, str]
    planned: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class LogHead:
    """The newest record of the log: its number (0: an empty log) and the hash that seals all before it."""

    number: int
    hash: str


@dataclass(frozen=True, slots=True)
class StoredCalibration:
    """A finished attempt's calibration. fit: JSON of its offset, matrix, budget, residuals and rules, each null where
    there is none."""

    serial: str
    station: str
    nest: str
    software: str
    started_ns: int
    outcome: str
    fit: str


class Store(Protocol):
    """Where attempts go. Every method is one durable transaction. Errors: StoreFault when it cannot be kept."""

    def begin(self, begin: AttemptStart) -> str:
        """Creates the attempt before the device is touched; returns its id (UUID)."""

    def event(self, attempt: str, kind: str, detail: Mapping[str, Any]) -> None:
        """Appends an event to the attempt, also after its end; attempt "": to the station itself."""

    def visit(self, attempts: Sequence[str], visits: Sequence[VisitRecord]) -> None:
        """Keeps one visit of every nest, in one transaction."""

    def write(self, attempt: str, *stages: WriteRecord) -> None:
        """Keeps stages of object writes: the intent before, the fact after, and with it the intent of the next."""

    def result(self, attempt: str, name: str, document: Mapping[str, Any]) -> None:
        """Keeps a named result: identity, old-calibration, stops, history, calibration, dwell, write-plan,
        device-state, verification, verdict."""

    def finish(self, attempt: str, outcome: str, ended_ns: int) -> None:
        """Closes the attempt with its outcome; what follows can only be another attempt."""

    def tidy(self) -> None:
        """Makes evidence smaller, in a moment when nobody waits; nothing is lost where it is left out."""

    def unfinished(self) -> Sequence[UnfinishedAttempt]:
        """Attempts without an end, oldest first, with every stage of their object writes in order."""

    def suspect(self, serial: str) -> SuspectAttempt | None:
        """The unit's last attempt with a `write-plan`, unless its last `device-state` says old or new.

        Both are results; a `device-state` event that came after the attempt's end counts too.
        """

    def dwells(self, recipe_hash: str, newest: int) -> Sequence[Mapping[str, Any]]:
        """Results `dwell` of the newest so many attempts with this recipe, oldest first; attempts without one count,
        and are left out."""

    def calibrations(self, recipe_hash: str, newest: int) -> Sequence[StoredCalibration]:
        """Of the newest so many attempts with this recipe those that came to a calibration, oldest first."""

    def station_events(self, kind: str, newest: int) -> Sequence[tuple[int, int, Mapping[str, Any]]]:
        """The newest events of the station itself of one kind, oldest first: number, ns since 1970, detail."""

    def outcomes(self, serial: str, nest: str, beyond: int) -> Sequence[str]:
        """Outcomes of the unit's finished attempts in that nest that began after record `beyond`, oldest first."""

    def head(self) -> LogHead:
        """The newest record, for certificates and exports."""

    def close(self) -> None:
        """Lets go of the log; closing twice is harmless."""
