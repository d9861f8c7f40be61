"""The cell around a simulated PLC: loads that come, and bins into which their units go. Its counts are retentive."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Handed:
    """A load that left the nests: its number, serial of each nest ('' for none), bins as they were given."""

    load: int
    serials: tuple[str, ...]
    bins: int


@dataclass(slots=True)
class CellLoads:
    """coming: serials nest by nest of one load after the other. change_s: how long units are changed for.

    load, taken, bins_taken are in retentive memory: a restart of the PLC leaves them, and the parts lie where they lie.
    """

    coming: Iterator[Sequence[str]]
    change_s: float = 1.0
    nests: tuple[str, ...] = ()
    load: int = 0
    taken: int = 0
    bins_taken: int = 0
    handed: list[Handed] = field(default_factory=list)
    _due_s: float = 0.0

    @property
    def present(self) -> int:
        """A bit for each nest that has a part."""
        return sum(1 << i for i, serial in enumerate(self.nests) if serial)

    @property
    def ready(self) -> bool:
        """Whether a load waits for the station, or is with it."""
        return bool(self.present) and self.taken != self.load

    def scan(self, now_s: float, done: int, bins: int) -> None:
        """One cycle. done, bins: the load that the station hands back, and the bin of each nest (two bits)."""
        if not self.nests:
            if now_s >= self._due_s and (serials := next(self.coming, None)) is not None:
                self.nests, self.load = tuple(serials), self.load + 1
            return
        if self.taken != self.load and done == self.load and self._complete(bins):
            self.taken, self.bins_taken = self.load, bins  # one write of retentive memory: both or none
        if self.taken == self.load:  # clamps open only now
            self.handed.append(Handed(self.load, self.nests, self.bins_taken))
            self.nests, self._due_s = (), now_s + self.change_s

    def _complete(self, bins: int) -> bool:
        """Each part has a bin, and no empty nest has one."""
        return all(bool(bins >> 2 * i & 3) == bool(serial) for i, serial in enumerate(self.nests))
