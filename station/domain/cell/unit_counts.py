"""Units that a line handed back, by bin, and how fast."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from station.domain.cell.handover import Bin


@dataclass(frozen=True, slots=True)
class UnitCounts:
    """since_start: by bin, since the line's start; before: by bin, in the log until then; per_hour: units of the newest
    load, over the time since the one before it; last_s: when that load went back, on the line's clock."""

    since_start: Mapping[Bin, int] = field(default_factory=dict)
    before: Mapping[Bin, int] = field(default_factory=dict)
    per_hour: float = 0.0
    last_s: float | None = None

    @staticmethod
    def after(loads: Iterable[Mapping[int, int]]) -> "UnitCounts":
        """Counts of a line that starts after these loads, each by place and bin."""
        return UnitCounts(before=_added({}, (bin_ for bins in loads for bin_ in bins.values())))

    def handed_back(self, bins: Mapping[int, int], now_s: float) -> "UnitCounts":
        """With one load more, by place and bin."""
        since = 0.0 if self.last_s is None else now_s - self.last_s
        per_hour = 3600.0 * len(bins) / since if since > 0 else 0.0
        return UnitCounts(_added(self.since_start, bins.values()), self.before, per_hour, now_s)

    def total(self, bin_: Bin) -> int:
        """Units of that bin in the whole log."""
        return self.before.get(bin_, 0) + self.since_start.get(bin_, 0)


def _added(counts: Mapping[Bin, int], bins: Iterable[int]) -> dict[Bin, int]:
    found = dict(counts)
    for number in bins:
        found[Bin(number)] = found.get(Bin(number), 0) + 1
    return found
