"""Frozen values that the floors hand to each other. Arrays are read-only by convention; units in names."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.messages import Message, render

Floats = NDArray[np.float64]
Array = NDArray[Any]

#: Flags in `Frames.can_id`, as the Linux kernel packs them.
EXTENDED, REMOTE, ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """CAN frames as received, one row each, in the order of arrival.

    time_ns (n) int64, since the epoch (kernel clock) or the log's own zero; can_id (n) uint32 with the
    kernel's flag bits; length (n) uint8, bytes of payload; data (n, 8) uint8, zero-filled (64 wide for FD).
    """

    time_ns: NDArray[np.int64]
    can_id: NDArray[np.uint32]
    length: NDArray[np.uint8]
    data: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.time_ns)

    def __getitem__(self, rows: Any) -> "Frames":
        if isinstance(rows, np.ndarray) and rows.dtype == bool:
            rows = np.flatnonzero(rows)  # counted once for the four columns
        return Frames(self.time_ns[rows], self.can_id[rows], self.length[rows], _payloads(self.data, rows))

    @staticmethod
    def empty() -> "Frames":
        """No frames."""
        return Frames(np.zeros(0, np.int64), np.zeros(0, np.uint32), np.zeros(0, np.uint8), np.zeros((0, 8), np.uint8))

    @staticmethod
    def join(parts: "list[Frames]") -> "Frames":
        """All parts, one after the other; widths are made equal."""
        if not parts:
            return Frames.empty()
        width = max(p.data.shape[1] for p in parts)
        data = [p.data if p.data.shape[1] == width else _widened(p.data, width) for p in parts]
        return Frames(
            np.concatenate([p.time_ns for p in parts]),
            np.concatenate([p.can_id for p in parts]),
            np.concatenate([p.length for p in parts]),
            np.concatenate(data),
        )


def _payloads(data: NDArray[np.uint8], rows: Any) -> NDArray[np.uint8]:
    """Rows of payloads (n, w); those of eight bytes as one word each, which is ten times as fast as byte by byte."""
    if not isinstance(rows, np.ndarray) or data.shape[1] != 8 or not data.flags.c_contiguous:
        payloads: NDArray[np.uint8] = data[rows]
    else:
        payloads = data.view(np.uint64)[rows].view(np.uint8)
    return payloads


def widened(frames: Frames, length: int) -> Frames:
    """The same frames with payloads of at least `length` bytes, as FD frames have them."""
    if frames.data.shape[1] >= length:
        return frames
    return Frames(frames.time_ns, frames.can_id, frames.length, _widened(frames.data, 64))


def _widened(data: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    return np.pad(data, ((0, 0), (0, width - data.shape[1])))


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """A text column as codes: row i reads names[code[i]]. code (n) int32."""

    names: tuple[str, ...]
    code: NDArray[np.int32]

    def __getitem__(self, rows: Any) -> "Labels":
        return Labels(self.names, self.code[rows])

    def text(self) -> Array:
        """The column as an array of strings."""
        return np.asarray(self.names, dtype=object)[self.code] if self.names else np.zeros(0, object)

    def used(self) -> "Labels":
        """The same column without names that no row has."""
        present = np.bincount(self.code, minlength=len(self.names)) > 0
        if present.all():
            return self
        place = (np.cumsum(present) - 1).astype(np.int32)
        return Labels(tuple(self.names[i] for i in np.flatnonzero(present)), place[self.code])

    @staticmethod
    def of(text: Any) -> "Labels":
        """Codes of a sequence of strings, names in alphabetical order."""
        names, code = np.unique(np.asarray(text, dtype=str), return_inverse=True)
        return Labels(tuple(str(n) for n in names), code.astype(np.int32))


@dataclass(frozen=True, slots=True, eq=False)
class SampleTable:
    """Decoded, uncalibrated samples of any number of units: schema station.samples/1, one row a sample.

    unit, position (Labels); run, visit (n) int32; time_s (n) since the start of the run; reading (n, 3) in
    the recipe's unit; labels: any of station, nest, lot, operator, seating, simulated; values: any of temperature_degC,
    since_power_s, since_clamp_s, motor, started_s, counter (n); gold (n, 3) or None.
    Rows of one unit and run are in the order of time.
    """

    unit: Labels
    run: NDArray[np.int32]
    visit: NDArray[np.int32]
    position: Labels
    time_s: Floats
    reading: Floats
    labels: Mapping[str, Labels] = field(default_factory=dict)
    values: Mapping[str, Floats] = field(default_factory=dict)
    gold: Floats | None = None

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, rows: Any) -> "SampleTable":
        return SampleTable(
            self.unit[rows],
            self.run[rows],
            self.visit[rows],
            self.position[rows],
            self.time_s[rows],
            self.reading.T[:, rows].T,
            {k: v[rows] for k, v in self.labels.items()},
            {k: v[rows] for k, v in self.values.items()},
            None if self.gold is None else self.gold.T[:, rows].T,
        )

    def labelled(self, texts: Mapping[str, str]) -> "SampleTable":
        """The same samples with columns more, whose rows all say the same."""
        rows = np.zeros(len(self), np.int32)
        return replace(self, labels={**self.labels, **{name: Labels((text,), rows) for name, text in texts.items()}})

    def used(self) -> "SampleTable":
        """The same samples, without the names of units, positions and the like that no row has any more."""
        labels = {k: v.used() for k, v in self.labels.items()}
        return replace(self, unit=self.unit.used(), position=self.position.used(), labels=labels)


@dataclass(frozen=True, slots=True)
class NestAssignment:
    """One unit in one nest: printed serial, nest name, node id of the device."""

    serial: str
    nest: str
    node: int


class Outcome(StrEnum):
    """How an attempt ended; docs/formats.md."""

    PASS = "PASS"
    FAIL = "FAIL"
    ERROR = "ERROR"
    ABORTED = "ABORTED"
    INTERRUPTED = "INTERRUPTED"


@dataclass(frozen=True, slots=True, eq=False)
class ReducedVisits:
    """What one unit's visits come to, one row a visit; the input of every calibration method.

    position, seating: names; run, visit (v); mean (v, 3) robust mean reading; cov (v, 3, 3) covariance of that mean
    (autocorrelation, flicker and quantisation in it; ± 1.96 standard deviations cover 95 %); quantisation (v, 3)
    the part of its diagonal that no averaging takes away; dof (v, 3) degrees of freedom of the rest; true (v, 3)
    stimulus in the device frame, in the recipe's unit (rows of NaN where the pose is unknown); std (v, 3) of one
    sample; count (v) samples; effective (v) effective sample size; time_s (v) middle of the dwell;
    temperature_degC (v) or NaN; rounding (v, 3): variance of rounding that the budget counts, where it is another than
    weights go by (None: the same).
    """

    position: tuple[str, ...]
    seating: tuple[str, ...]
    run: NDArray[np.int32]
    visit: NDArray[np.int32]
    mean: Floats
    cov: Floats
    quantisation: Floats
    dof: Floats
    true: Floats
    std: Floats
    count: NDArray[np.int64]
    effective: Floats
    time_s: Floats
    temperature_degC: Floats
    rounding: Floats | None = None

    def __len__(self) -> int:
        return len(self.run)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """measured = matrix · true + offset. offset (3) in `unit`, matrix (3, 3), covariance (12, 12).

    The 12 are offset x y z, then the matrix row by row; variance 0 means that the method keeps the nominal
    value. residual (v, 3) measured − modelled for each visit, in `unit`; tilt_deg, tilt_std_deg (v) estimated
    angle between nominal and found direction; disturbed (v) bool: left out as an outlier, and reported.
    """

    method: str
    unit: str
    offset: Floats
    matrix: Floats
    covariance: Floats
    positions: tuple[str, ...]
    residual: Floats
    tilt_deg: Floats
    tilt_std_deg: Floats
    disturbed: NDArray[np.bool_]
    residual_rms: float
    notes: tuple[Message, ...] = ()

    def correct(self, reading: Array) -> Floats:
        """corrected = matrix⁻¹ · (measured − offset), for readings (…, 3)."""
        return np.asarray(np.linalg.solve(self.matrix, (np.asarray(reading) - self.offset)[..., None])[..., 0])


@dataclass(frozen=True, slots=True)
class Reason:
    """One ground of a verdict: the message, and the measured value with its limit, both in `unit`.

    check: what the log counts it under; left out, the message's id. Several messages may tell of one check.
    """

    message: Message
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    check: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "check", self.check or self.message.id)

    @property
    def sentence(self) -> str:
        """The message in English."""
        return render(self.message)

    def document(self) -> dict[str, Any]:
        """As the log keeps it."""
        numbers = {"value": self.value, "limit": self.limit, "unit": self.unit}
        return {"check": self.check, "sentence": self.sentence, **numbers, "message": self.message.document()}


@dataclass(frozen=True, slots=True)
class Verdict:
    """PASS or FAIL with every reason, the decision rule and its risks (JCGM 106)."""

    outcome: Outcome
    reasons: tuple[Reason, ...]
    rule: Message
    false_accept: float
    false_reject: float
