"""What acts on one axis alone, or in one unit: causes, kernels and laws there.

A cause has a coefficient on each axis of each unit, and pays for those that are nothing. A form of which a unit's
calibration happens to take up all but one axis does not, and is ahead of the right cause for that alone. Where one
axis, or one unit, holds what was found, causes and kernels are therefore compared there.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.candidates.bank import Bank, Candidate, build_bank
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.kernels import KERNEL_NAMES
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.search.rank import RankedCause, rank_causes
from station.diagnosis.search.scoring import ScoringProblem, score_bank
from station.diagnosis.search.walk_marginal import score_over_walks
from station.domain.core.types import Floats

#: Units that are looked at one by one: of more, one hardly counts beside the others.
MOST_UNITS = 12
#: What leads where a small extent is looked for; and names with less than this share of the leader's evidence are no
#: rivals there either.
FIRST_NAMES, LEAST_SHARE = 6, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """Where something acts: weight (v, 3), 1 or 0; nats: what it costs to choose it out of all there are."""

    weight: Floats
    nats: float

    def of(self, candidate: Candidate) -> Candidate | None:
        """The candidate here alone; None of one that cannot be cut so: it turns axes into each other, or hits nobody
        knows which groups."""
        visit, dwell = candidate.visit, candidate.dwell
        cut = np.ptp(self.weight, axis=1).any()
        if candidate.pattern == "scan" or (cut and _joins_axes(visit, dwell)):
            return None
        inside = None if dwell is None else dwell * self.weight[:, None, :, None]
        there = CauseColumns.of(visit * self.weight[..., None], inside)
        return replace(candidate, columns=there, plain=None) if len(there.column) else None


def extents(view: ResidualView) -> list[Extent]:
    """Each axis of all units, and each unit."""
    unit, units = view.scene.visits.unit.code, view.grid.units
    weights = [np.broadcast_to(axis, (len(unit), 3)) for axis in np.eye(3)]
    if 1 < units <= MOST_UNITS:
        weights += [np.repeat((unit == u)[:, None], 3, axis=1).astype(float) for u in range(units)]
    return [Extent(weight, float(np.log(2 * len(weights)))) for weight in weights]


def best_extent(problem: ScoringProblem, items: Iterable[Candidate], floor: NoiseFloor) -> Extent | None:
    """Where one of the items explains most, and more than it does everywhere; None where that does not pay its price,
    or none of them can be cut."""
    if problem.view.grid.k != 3:
        return None
    every = extents(problem.view)
    named = [(e, i, cut) for i, c in enumerate(items) for e, cut in _cuts(c, every)]
    if not named:
        return None
    some = [replace(cut, name=f"{e}/{i}") for e, i, cut in named]
    banks = _banks(some, problem)
    now = score_bank(problem, banks, floor)
    evidence = dict(zip((c.name for c in now.candidates), now.readings().evidence[0].tolist(), strict=True))
    e, i = max(((e, i) for e, i, _ in named if e), key=lambda at: evidence[f"{at[0]}/{at[1]}"])
    extent = every[e - 1]
    return extent if evidence[f"{e}/{i}"] - extent.nats > evidence[f"0/{i}"] else None


def ranks_in_extent(
    problem: ScoringProblem, banks: Sequence[Bank], ranks: Mapping[str, RankedCause], floor: NoiseFloor
) -> dict[str, RankedCause]:
    """Causes and kernels by their evidence where what leads acts, if that is an axis or a unit alone. floor: the one
    without any of them."""
    top = max((r.evidence for r in ranks.values()), default=0.0)
    near = sorted((r for r in ranks.values() if r.evidence > LEAST_SHARE * top), key=lambda r: -r.evidence)
    leading = [(r.best, r.at.floor) for r in near if r.best is not None][:FIRST_NAMES]
    extent = best_extent(problem, [best for best, _ in leading], leading[0][1]) if leading else None
    if extent is None:
        return dict(ranks)
    names = {r.name for r in near}
    cut = [x for bank in banks for c in bank.candidates if c.name in names and (x := extent.of(c)) is not None]
    there = _banks(cut, problem)
    found = rank_causes(problem, there, score_over_walks(problem, there, floor), KERNEL_NAMES)
    narrow = {
        name: replace(ranks[name], evidence=r.evidence - extent.nats)
        for name, r in found.items()
        if r.evidence - extent.nats > ranks[name].evidence
    }
    return {**ranks, **narrow}


def ranks_beside_scan(
    problem: ScoringProblem, banks: Sequence[Bank], ranks: Mapping[str, RankedCause], floor: NoiseFloor
) -> dict[str, RankedCause]:
    """The same where a cause leads that hits few groups, as a jump does: it does not pay for units in which it is
    nothing, and beside it no rival does."""
    leader = max(ranks.values(), key=lambda r: r.evidence)
    few = 1 < problem.view.grid.units <= MOST_UNITS
    scans = few and leader.best is not None and leader.best.pattern == "scan"
    return ranks_in_extent(problem, banks, ranks, floor) if scans else dict(ranks)


def _cuts(candidate: Candidate, every: Sequence[Extent]) -> Iterator[tuple[int, Candidate]]:
    """A candidate everywhere, 0, and in each extent, 1 and on; nothing of one that cannot be cut."""
    cut = [extent.of(candidate) for extent in every]
    if any(x is not None for x in cut):
        yield 0, candidate
        yield from ((1 + e, x) for e, x in enumerate(cut) if x is not None)


def _banks(items: Sequence[Candidate], problem: ScoringProblem) -> tuple[Bank, ...]:
    kinds = sorted({c.moving for c in items})
    return tuple(build_bank(items, problem.view.layout, moving=moving) for moving in kinds)


def _joins_axes(visit: Floats, dwell: Floats | None) -> bool:
    """Whether any of some columns moves several axes."""
    moved = np.any(visit != 0.0, axis=0)
    if dwell is not None:
        moved = moved | np.any(dwell != 0.0, axis=(0, 1))
    return bool(np.any(moved.sum(axis=0) > 1))
