"""One load after the other, from the cell to the cell: observes, decides (`domain.cell.handover`) and acts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from station.domain.cell import handover
from station.domain.cell.handover import Close, Entry, LoadJournal, Measure, Offer, Place, Step, Take
from station.ports.cell import Cell, HandoverJournal


@dataclass(frozen=True, slots=True)
class Handover:
    """identify: reads the labels of the places that have a part; test: takes units through the recipe, and returns when
    their attempts stand finished in the log. Errors: those of cell and log."""

    cell: Cell
    journal: HandoverJournal
    identify: Callable[[frozenset[int]], Sequence[Place]]
    test: Callable[[Sequence[Place]], None]

    def next_step(self) -> Step:
        """What there is to do; nothing is done."""
        view = self.cell.view()
        journal = LoadJournal.of(self.journal.entries())
        return handover.decide(journal, view, self._outcomes(journal))

    def step(self) -> Step:
        """One step; what it was. A crash at any instant of it leaves nothing that the next step does not find."""
        step = self.next_step()
        self._act(step)
        return step

    def clear(self, *, load_removed: bool) -> None:
        """A person has looked after a hold. load_removed: the units of the open load were taken out by hand."""
        open_load = LoadJournal.of(self.journal.entries()).open
        if open_load is not None and load_removed:
            self.journal.add(Entry(0, "lost", open_load.load, open_load.places))
        elif open_load is None:
            self.journal.add(Entry(0, "cleared", 0))

    def _outcomes(self, journal: LoadJournal) -> dict[int, Sequence[str]]:
        if journal.open is None:
            return {}
        number = journal.open.number
        return {p.place: self.journal.outcomes(p.serial, p.nest, number) for p in journal.open.places if p.serial}

    def _act(self, step: Step) -> None:
        if isinstance(step, Take):
            self.journal.add(Entry(0, "taken", step.load, tuple(self.identify(step.present))))
            self.cell.accept(step.load)
        elif isinstance(step, Measure):
            self.cell.accept(step.load)
            self.test(step.places)
        elif isinstance(step, Offer):
            if step.record:
                self.journal.add(Entry(0, "offered", step.load, bins=step.bins))
            self.cell.give(step.load, step.bins)
        elif isinstance(step, Close):
            self.journal.add(Entry(0, "handed", step.load, bins=step.bins))
