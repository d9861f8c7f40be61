"""What a report is made of: the diagnosis' document, and the numbers of every stop that the pictures show."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Labels


@dataclass(frozen=True, slots=True, eq=False)
class CauseSignature:
    """What one cause does to the readings (v, k) that no calibration could take up, in the recipe's unit."""

    effect: str
    values: Floats


@dataclass(frozen=True, slots=True, eq=False)
class DwellCourse:
    """The course within a dwell, every stop turned so that the cause starts upwards: parts of the dwell by name, what
    is left (b) and what the cause says (b), in the recipe's unit."""

    parts: tuple[str, ...]
    residual: Floats
    signature: Floats


@dataclass(frozen=True, slots=True, eq=False)
class ReportData:
    """Everything a report shows.

    document: a station.diagnosis/1 (contracts, section 5); recipe: its name; axes: names of the k numbers of a stop;
    unit, position (Labels), run, visit, previous (v; index of the stop before, −1 for none) and values (v) by
    covariate, those that were recorded; measured (v, k), before and after (v, k): measured − simulated without and
    with the causes, each unit calibrated; read, expected (v, 3): plain means of the samples as they came, and what an
    ideal unit would read, where gross faults were found; smallest: rms coefficient of each cause that would have been
    seen with 80 % chance; recorded: columns that were in the data. Readings in the recipe's unit.
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

    @property
    def line(self) -> Mapping[str, Any] | None:
        """What the causes mean for the line, as the document has it; None where it says nothing."""
        told: Mapping[str, Any] | None = self.document.get("line")
        return told

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
        """What noise alone makes of a stop's mean, recipe's unit. Where something unknown is in the data it is in the
        fitted floor too; then it is what the samples within the stops tell."""
        within = (self.document.get("floor") or {}).get("within_stops")
        if self.document["verdict"] == "unknown" and within:
            return float(within)
        return float(self.document["baseline"]["floor_rms"])

    @property
    def unit_of_readings(self) -> str:
        """The recipe's unit."""
        return str(self.document["baseline"]["unit"])

    def signature(self, effect: str) -> Floats | None:
        """What a cause does (v, k), None where it cannot be drawn."""
        return next((s.values for s in self.signatures if s.effect == effect), None)
