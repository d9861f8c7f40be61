"""Units of a cell's loads, handed back exactly once and with the right verdict: what to do next.

Nothing is remembered between two steps but the journal, the log's verdicts and the cell itself. A station that has just
started decides as one that never stopped does, so there is nothing to recover.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Literal

from station.domain.core.types import Outcome
from station.messages import Message

#: So many attempts of a unit may be interrupted in one load; then it goes back as it is, to the bin "again".
MOST_INTERRUPTED = 2


class Bin(IntEnum):
    """Where a unit goes: two bits a nest; 0 is an empty nest."""

    GOOD = 1
    REJECT = 2
    AGAIN = 3


#: A unit without a verdict of its own goes to neither the good nor the bad ones.
BIN_OF: Mapping[str, Bin] = {Outcome.PASS: Bin.GOOD, Outcome.FAIL: Bin.REJECT}


@dataclass(frozen=True, slots=True)
class Place:
    """A nest of a load and what was read of the unit in it; serial '' where no label could be read."""

    place: int
    nest: str
    serial: str


@dataclass(frozen=True, slots=True)
class CellView:
    """What a cell says: load: number of the load in the nests, 0 for none; present: places with a part; ready: the load
    waits to be taken; taken, bins_taken: the last load that went back, and into what bins."""

    load: int
    ready: bool
    present: frozenset[int]
    taken: int
    bins_taken: Mapping[int, int]


StepName = Literal["taken", "offered", "handed", "lost", "cleared"]


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of the journal. number: of its record in the log; bins: place → bin."""

    number: int
    step: StepName
    load: int
    places: tuple[Place, ...] = ()
    bins: Mapping[int, int] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """As the log keeps it."""
        return {
            "step": self.step,
            "load": self.load,
            "places": [{"place": p.place, "nest": p.nest, "serial": p.serial} for p in self.places],
            "bins": {str(place): int(bin_) for place, bin_ in self.bins.items()},
        }

    @staticmethod
    def of(number: int, document: Mapping[str, Any]) -> "Entry":
        """The entry that `document()` described."""
        places = tuple(Place(int(p["place"]), str(p["nest"]), str(p["serial"])) for p in document["places"])
        bins = {int(place): int(bin_) for place, bin_ in document["bins"].items()}
        return Entry(number, document["step"], int(document["load"]), places, bins)


@dataclass(frozen=True, slots=True)
class OpenLoad:
    """A load that the station took and has not handed back. number: record that says so; offered: bins, None yet."""

    number: int
    load: int
    places: tuple[Place, ...]
    offered: Mapping[int, int] | None


@dataclass(frozen=True, slots=True)
class LoadJournal:
    """open: the present load, None between two; last: number of the last load that is over, None where none is."""

    open: OpenLoad | None = None
    last: int | None = None

    @staticmethod
    def of(entries: Sequence[Entry]) -> "LoadJournal":
        """The journal after these entries, oldest first; they reach back to the last load that is over, or further."""
        now = LoadJournal()
        for entry in entries:
            now = now.after(entry)
        return now

    def after(self, entry: Entry) -> "LoadJournal":
        """The journal with one entry more."""
        if entry.step == "taken":
            return LoadJournal(OpenLoad(entry.number, entry.load, entry.places, None), self.last)
        if entry.step == "offered" and self.open is not None:
            return LoadJournal(OpenLoad(self.open.number, entry.load, self.open.places, entry.bins), self.last)
        if entry.step == "cleared":
            return LoadJournal(None, None)
        return LoadJournal(None, entry.load)


@dataclass(frozen=True, slots=True)
class Wait:
    """Nothing to do; starved: no load is there."""

    starved: bool = True


@dataclass(frozen=True, slots=True)
class Take:
    """A new load: read its labels and write it into the journal before anything is touched."""

    load: int
    present: frozenset[int]


@dataclass(frozen=True, slots=True)
class Measure:
    """These units have no verdict yet."""

    load: int
    places: tuple[Place, ...]


@dataclass(frozen=True, slots=True)
class Offer:
    """Every unit has its verdict: give the bins, after the journal says so where `record`."""

    load: int
    bins: Mapping[int, int]
    record: bool


@dataclass(frozen=True, slots=True)
class Close:
    """The cell took the load back into the bins that it was given: write it down."""

    load: int
    bins: Mapping[int, int]


@dataclass(frozen=True, slots=True)
class Hold:
    """Units and record no longer agree: a person must look, and say so, before anything goes on."""

    load: int
    why: Message


Step = Wait | Take | Measure | Offer | Close | Hold


def decide(journal: LoadJournal, cell: CellView, outcomes: Mapping[int, Sequence[str]]) -> Step:
    """What to do next. outcomes: place → outcomes of the attempts of its unit since the load was taken, oldest first;
    one that runs counts as none."""
    if journal.open is None:
        return _between(journal, cell)
    if cell.taken == journal.open.load:
        return _taken_back(journal.open, cell)
    return _changed(journal.open, cell) or _in_work(journal.open, outcomes)


def _changed(load: OpenLoad, cell: CellView) -> Hold | None:
    """The units in the nests are no longer those of the journal."""
    if cell.load != load.load:
        return Hold(load.load, Message("cell-load-gone", load=load.load, present=cell.load))
    if cell.present != {p.place for p in load.places}:
        gone = sorted(p.nest for p in load.places if p.place not in cell.present)
        return Hold(load.load, Message("cell-parts-changed", load=load.load, nests=gone))
    return None


def _in_work(load: OpenLoad, outcomes: Mapping[int, Sequence[str]]) -> Step:
    waiting = tuple(p for p in load.places if p.serial and verdict(outcomes.get(p.place, ())) is None)
    if waiting:
        return Measure(load.load, waiting)
    bins = {p.place: int(_bin(p, outcomes.get(p.place, ()))) for p in load.places}
    if load.offered is not None and load.offered != bins:
        return Hold(load.load, Message("cell-verdict-changed", load=load.load))
    return Offer(load.load, bins, record=load.offered is None)


def verdict(outcomes: Sequence[str]) -> str | None:
    """The outcome that counts: the first that is not INTERRUPTED, or INTERRUPTED where it was so too often."""
    decided = next((o for o in outcomes if o != Outcome.INTERRUPTED), None)
    if decided is None and len(outcomes) >= MOST_INTERRUPTED:
        return Outcome.INTERRUPTED
    return decided


def _bin(place: Place, outcomes: Sequence[str]) -> Bin:
    found = verdict(outcomes) if place.serial else None
    return BIN_OF.get(found, Bin.AGAIN) if found else Bin.AGAIN


def _between(journal: LoadJournal, cell: CellView) -> Step:
    if not cell.ready or not cell.load:
        return Wait()
    if cell.load == journal.last:
        return Hold(cell.load, Message("cell-load-repeated", load=cell.load))
    return Take(cell.load, cell.present)


def _taken_back(load: OpenLoad, cell: CellView) -> Step:
    if load.offered is None:
        return Hold(load.load, Message("cell-taken-unasked", load=load.load))
    if dict(cell.bins_taken) != dict(load.offered):
        return Hold(load.load, Message("cell-bins-differ", load=load.load))
    return Close(load.load, load.offered)


def pack_bins(bins: Mapping[int, int]) -> int:
    """Bins as they travel: two bits a place."""
    return sum(bin_ << 2 * place for place, bin_ in bins.items())


def unpack_bins(word: int, places: int = 16) -> dict[int, int]:
    """Bins out of their word; places without one are left out."""
    return {i: word >> 2 * i & 3 for i in range(places) if word >> 2 * i & 3}
