"""A cell without a PLC: part sensors, clamps, two buttons and lamps at a remote I/O. What its clamps do. Pure.

The order of hands keeps a bad unit from leaving as a good one. While units are tested every clamp is closed; then
those of good units open and no others; the rest open when the good ones are gone and somebody has pressed the button
that says that these go to the rejects. A sensor or a button that is stuck lets nothing go on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from station.domain.cell.handover import Bin
from station.messages import Message


class ClampPhase(StrEnum):
    """loading: units are changed; clamping: start was pressed; testing: units are the station's; good-out: good units
    are free; acknowledge: somebody must take note of the rest; rest-out: the rest is free."""

    LOADING = "loading"
    CLAMPING = "clamping"
    TESTING = "testing"
    GOOD_OUT = "good-out"
    ACKNOWLEDGE = "acknowledge"
    REST_OUT = "rest-out"


@dataclass(frozen=True, slots=True)
class Signals:
    """Inputs of one instant. parts, clamped: places with a part, and with a closed clamp; the buttons as they are."""

    parts: frozenset[int]
    clamped: frozenset[int]
    start: bool
    acknowledge: bool


@dataclass(frozen=True, slots=True)
class RemoteCell:
    """What must outlive the process. load: number of the present load or the last; taken, bins: the last one that was
    given its bins; parts: places of the present load; released: the button of this phase was seen up in it."""

    phase: ClampPhase = ClampPhase.LOADING
    load: int = 0
    taken: int = 0
    bins: Mapping[int, int] = field(default_factory=dict)
    parts: frozenset[int] = frozenset()
    released: bool = False

    def document(self) -> dict[str, Any]:
        """As a file keeps it."""
        bins = {str(place): int(bin_) for place, bin_ in self.bins.items()}
        head = {"phase": str(self.phase), "load": self.load, "taken": self.taken, "released": self.released}
        return {**head, "bins": bins, "parts": sorted(self.parts)}

    @staticmethod
    def of(document: Mapping[str, Any]) -> "RemoteCell":
        """The cell that `document()` described. Errors: KeyError, TypeError, ValueError."""
        bins = {int(place): int(bin_) for place, bin_ in document["bins"].items()}
        return RemoteCell(
            phase=ClampPhase(document["phase"]),
            load=int(document["load"]),
            taken=int(document["taken"]),
            bins=bins,
            parts=frozenset(int(p) for p in document["parts"]),
            released=bool(document["released"]),
        )

    @staticmethod
    def found(signals: Signals) -> "RemoteCell":
        """A cell of which nothing is remembered: nobody knows what its units are, so they leave as the rest does."""
        if not signals.parts:
            return RemoteCell()
        bins = dict.fromkeys(signals.parts, int(Bin.AGAIN))
        return RemoteCell(ClampPhase.ACKNOWLEDGE, bins=bins, parts=signals.parts)

    @property
    def good(self) -> frozenset[int]:
        """Places of the units that may leave as good ones."""
        return frozenset(place for place, bin_ in self.bins.items() if bin_ == Bin.GOOD)

    @property
    def rest(self) -> frozenset[int]:
        """Places of the units that may not."""
        return frozenset(self.bins) - self.good

    def open_clamps(self, nests: int) -> frozenset[int]:
        """Clamps that are to be open; all others are to be closed."""
        match self.phase:
            case ClampPhase.LOADING:
                return frozenset(range(nests))
            case ClampPhase.GOOD_OUT:
                return self.good
            case ClampPhase.REST_OUT:
                return self.rest
            case _:
                return frozenset()

    def lamps(self, lamps: frozenset[str]) -> frozenset[str]:
        """The lamps of the outer state, and those that ask for the acknowledgement."""
        return lamps | {"blue", "sound"} if self.phase is ClampPhase.ACKNOWLEDGE else lamps

    def after(self, signals: Signals) -> "RemoteCell":
        """One look at the inputs later. A button counts only where it was seen up since its phase began."""
        phase = self._next(signals)
        if phase is self.phase:
            button = signals.acknowledge if phase is ClampPhase.ACKNOWLEDGE else signals.start
            return replace(self, released=self.released or not button)
        if phase is ClampPhase.TESTING:
            return replace(self._enter(phase), load=self.load + 1, parts=signals.parts)
        return self._enter(phase)

    def _next(self, signals: Signals) -> ClampPhase:
        found = self.phase
        match self.phase:
            case ClampPhase.LOADING if self.released and signals.start and signals.parts:
                found = ClampPhase.CLAMPING
            case ClampPhase.CLAMPING if not signals.parts:
                found = ClampPhase.LOADING
            case ClampPhase.CLAMPING if signals.parts <= signals.clamped:
                found = ClampPhase.TESTING
            case ClampPhase.GOOD_OUT if not signals.parts & self.good:
                found = ClampPhase.ACKNOWLEDGE if self.rest else ClampPhase.LOADING
            case ClampPhase.ACKNOWLEDGE if self.released and signals.acknowledge:
                found = ClampPhase.REST_OUT
            case ClampPhase.REST_OUT if not signals.parts:
                found = ClampPhase.LOADING
        return found

    def given(self, load: int, bins: Mapping[int, int]) -> "RemoteCell":
        """With the bins of the present load; the same again, or those of another load, change nothing."""
        if self.phase is not ClampPhase.TESTING or load != self.load or frozenset(bins) != self.parts:
            return self
        phase = ClampPhase.GOOD_OUT if Bin.GOOD in bins.values() else ClampPhase.ACKNOWLEDGE
        return replace(self._enter(phase), taken=load, bins=dict(bins))

    def fault(self, signals: Signals) -> Message | None:
        """What is wrong with units that are still held: one left although its clamp is closed, or a clamp is open."""
        held = self.parts if self.phase is ClampPhase.TESTING else self.rest
        if self.phase not in (ClampPhase.TESTING, ClampPhase.GOOD_OUT, ClampPhase.ACKNOWLEDGE) or not self.load:
            return None  # a cell of which nothing is remembered is closing its clamps
        if self.phase is not ClampPhase.TESTING and (gone := held - signals.parts):
            return Message("cell-part-pulled", places=[place + 1 for place in sorted(gone)])
        if loose := (held & signals.parts) - signals.clamped:
            return Message("cell-clamp-loose", places=[place + 1 for place in sorted(loose)])
        return None

    def _enter(self, phase: ClampPhase) -> "RemoteCell":
        return replace(self, phase=phase, released=False)
