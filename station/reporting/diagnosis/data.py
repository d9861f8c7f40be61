"""What a report is made of: the diagnosis' document, and the numbers of every visit that the pictures show."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Labels


@dataclass(frozen=True, slots=True, eq=False)
class CauseSignature:
    """What one cause does to the readings, in the recipe's unit: values (v, k) what no calibration could take up of it,
    whole (v, k) all of it."""

    effect: str
    values: Floats
    whole: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DwellCourse:
    """The course within a dwell, every visit turned so that the cause starts upwards: middles of its parts (b), s
    from where it began, what is left (b) with its standard error and what the cause says (b), and the noise of one
    visit (b), in the recipe's unit."""

    time_s: Floats
    residual: Floats
    signature: Floats
    std: Floats | None = None
    noise: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ToneSpectrum:
    """Amplitude spectrum of the samples within the dwells, on the axis that holds most: frequency (f) in Hz, amplitude
    (f) in the recipe's unit with the motors on, and off where that was measured."""

    axis: str
    frequency_hz: Floats
    on: Floats
    off: Floats | None


@dataclass(frozen=True, slots=True, eq=False)
class ClockCourse:
    """How far one unit's clock is ahead of the host's (n), s, so long after its dwell began (n), s; rate_error: the
    slope that was found; tolerance: the data sheet's; unit: whose."""

    unit: str
    host_s: Floats
    ahead_s: Floats
    rate_error: float
    tolerance: float


@dataclass(frozen=True, slots=True, eq=False)
class DwellSamples:
    """The first samples (n) of one dwell on one axis, recipe's unit, and whose they are."""

    unit: str
    axis: str
    reading: Floats


@dataclass(frozen=True, slots=True, eq=False)
class FormulaCurve:
    """One term of a proposed formula on the axis it moves most, by visit (v) of the group it moves most: the covariate
    with its label, the level of what the axis feels and what that is, measured with the term left in, and the term;
    recipe's unit. course (2, n): covariate and term at level 1, None where the covariate alone does not give it; group:
    whose visits these are, "" of all."""

    axis: str
    label: str
    what: str
    at: Floats
    level: Floats
    measured: Floats
    formula: Floats
    course: Floats | None = None
    group: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ReportData:
    """Everything a report shows.

    document: a station.diagnosis/1 (docs/formats.md); recipe: its name; axes: names of the k numbers of a visit;
    unit, position (Labels), run, visit, previous (v; index of the visit before, −1 for none) and values (v) by
    covariate, those that were recorded; measured (v, k), before and after (v, k): measured − simulated without and
    with the causes, each unit calibrated; read, expected (v, 3): plain means of the samples as they came, and what an
    ideal unit would read, where gross faults were found; smallest: rms coefficient of each cause that would have been
    seen with 80 % chance; recorded: columns that were in the data; felt (v, 3): resting stimulus in the device's frame
    where the pose is known, told (v, 3): as the readings themselves tell it where it is not; curves: of a proposed
    formula's terms; groups: station, nest, lot and operator of the
    visits. Readings in the recipe's unit.
    """

    document: Mapping[str, Any]
    recipe: str
    axes: tuple[str, ...]
    unit: Labels
    position: Labels
    run: NDArray[np.int32]
    visit: NDArray[np.int32]
    previous: NDArray[np.intp]
    values: Mapping[str, Floats]
    measured: Floats
    before: Floats
    after: Floats
    signatures: tuple[CauseSignature, ...] = ()
    dwell: DwellCourse | None = None
    read: Floats | None = None
    expected: Floats | None = None
    smallest: Mapping[str, float] = field(default_factory=dict)
    recorded: frozenset[str] = frozenset()
    felt: Floats | None = None
    told: Floats | None = None
    groups: Mapping[str, Labels] = field(default_factory=dict)
    spectrum: ToneSpectrum | None = None
    samples: Mapping[str, DwellSamples] = field(default_factory=dict)
    clock: ClockCourse | None = None
    curves: tuple[FormulaCurve, ...] = ()

    @property
    def line(self) -> Mapping[str, Any] | None:
        """What the causes mean for the line, as the document has it; None where it says nothing."""
        impact: Mapping[str, Any] | None = self.document.get("line")
        return impact

    @property
    def judged(self) -> Mapping[str, Any] | None:
        """The same where the recipe has limits to judge by."""
        return self.line if self.line is not None and self.line["passed_before"] is not None else None

    @property
    def causes(self) -> list[Mapping[str, Any]]:
        """The causes found, as the document has them."""
        return list(self.document["causes"])

    @property
    def noise_rms(self) -> float:
        """What noise alone makes of a visit's mean, recipe's unit. Where something unknown is in the data it is in the
        fitted floor too; then it is what the samples within the visits tell."""
        within = (self.document.get("floor") or {}).get("within_stops")
        if self.document["verdict"] == "unknown" and within:
            return float(within)
        return float(self.document["baseline"]["floor_rms"])

    @property
    def unit_of_readings(self) -> str:
        """The recipe's unit."""
        return str(self.document["baseline"]["unit"])

    def signature(self, effect: str) -> CauseSignature | None:
        """What a cause does, all of it where it was found several times; None where it cannot be drawn."""
        found = [s for s in self.signatures if s.effect == effect]
        if len(found) < 2:
            return found[0] if found else None
        values = np.sum([s.values for s in found], axis=0)
        whole = [s.whole for s in found if s.whole is not None]
        return CauseSignature(effect, values, np.sum(whole, axis=0) if len(whole) == len(found) else None)
