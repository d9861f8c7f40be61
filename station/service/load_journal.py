"""The journal of loads in the station's log: events of the station, sealed like every record."""

from collections.abc import Mapping, Sequence

from station.domain.cell.handover import Entry
from station.ports.store import Store

LOAD_EVENT = "cell-load"
#: A load has four lines at most; so many reach back to the last one that is over.
NEWEST = 12
#: For the counts of all times, so many lines reach back.
MOST_LINES = 100_000


class StoreLoadJournal:
    """Implements `ports.cell.HandoverJournal`. Errors: StoreFault."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def entries(self) -> Sequence[Entry]:
        """The newest lines, oldest first."""
        return [Entry.of(number, detail) for number, _, detail in self._store.station_events(LOAD_EVENT, NEWEST)]

    def handed_back(self) -> Sequence[Mapping[int, int]]:
        """Bins, by place, of the loads that went back, oldest first."""
        lines = self._store.station_events(LOAD_EVENT, MOST_LINES)
        entries = [Entry.of(number, detail) for number, _, detail in lines if detail["step"] == "handed"]
        return [entry.bins for entry in entries]

    def add(self, entry: Entry) -> None:
        """One line, durable when this returns."""
        self._store.event("", LOAD_EVENT, entry.document())

    def outcomes(self, serial: str, nest: str, beyond: int) -> Sequence[str]:
        """Outcomes of the unit's finished attempts in that nest after that record."""
        return self._store.outcomes(serial, nest, beyond)
