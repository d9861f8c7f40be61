"""Causes that show in a group only for a stretch of time, searched among all causes, groups and stretches."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from station.diagnosis.fleet.candidate import SharedCandidate
from station.diagnosis.fleet.moments import FleetCell
from station.diagnosis.fleet.noise import ResponseNoise
from station.diagnosis.fleet.slices import TimeSlices, slice_of
from station.diagnosis.fleet.time_scan import CauseDirections, GroupScan, ScannedStretch, group_scan
from station.domain.core.types import Floats

#: Fewer units than this are no group, and no stretch of one.
FEWEST_UNITS = 8
#: Of the chance of a finding, what stretches that last and those that are over may take.
_SINCE, _DURING = 0.25, 0.25


@dataclass(frozen=True, slots=True, eq=False)
class PartFound:
    """candidate: its index; log_chance: of anything so strong anywhere, in all that was tried; tests: of all candidates
    in that stretch, with rank, zero of other groups; others (t, r): what all other units are off by in each slice."""

    candidate: int
    stretch: ScannedStretch
    log_chance: float
    tests: Sequence[tuple[float, int]]
    others: Floats
    dispersion: float

    def units_among(self, began_ns: NDArray[np.int64], edges_ns: NDArray[np.int64]) -> tuple[int, int]:
        """First and last + 1 of units in the order of time that lie in the stretch."""
        at = slice_of(edges_ns, began_ns)
        return int(np.searchsorted(at, self.stretch.first)), int(np.searchsorted(at, self.stretch.last))


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Candidates (indices) of the same units, and their directions."""

    members: Floats
    candidates: tuple[int, ...]
    causes: CauseDirections


class StretchSearch:
    """candidates: all of a search; those that go with a covariate are not told apart in time."""

    def __init__(self, candidates: Sequence[SharedCandidate], slices: TimeSlices, noise: ResponseNoise) -> None:
        self._noise, self._slices, self._count = noise, slices, len(candidates)
        by_group: dict[FleetCell, list[int]] = {}
        for i, candidate in enumerate(candidates):
            if candidate.columns is not None:
                by_group.setdefault(candidate.group, []).append(i)
        self._tried = sum(map(len, by_group.values()))
        self._groups = []
        for own in by_group.values():
            columns = [candidates[i].columns for i in own]
            causes = CauseDirections.of([one for one in columns if one is not None])
            self._groups.append(_Group(candidates[own[0]].members, tuple(own), causes))

    def best(self, left: Floats, known: Floats, wanted: Sequence[bool], dispersion: float) -> PartFound | None:
        """left (k, r): what the slices' rows are off by; known (k): 1 for those that count, else 0; wanted: which
        candidates; dispersion: of whole groups."""
        slices, left = replace(self._slices, units=self._slices.units * known), left * known[:, None]
        scans = [group_scan(slices, left, group.members, FEWEST_UNITS) for group in self._groups]
        own = self._dispersion(scans, dispersion)
        best: tuple[float, int, int, ScannedStretch] | None = None
        for g, (group, scan) in enumerate(zip(self._groups, scans, strict=True)):
            for share, found in zip((_SINCE, _DURING), scan.tests(group.causes), strict=True):
                for i, rank, stretch in zip(group.candidates, group.causes.rank, found, strict=True):
                    if stretch is None or not wanted[i]:
                        continue
                    chance = self._noise.log_chance(stretch.test / own, rank) + np.log(
                        self._tried * stretch.tried / share
                    )
                    if best is None or chance < best[0]:
                        best = chance, g, i, stretch
        return None if best is None else self._found(*best, scans, own)

    def _dispersion(self, scans: Sequence[GroupScan], whole: float) -> float:
        """By how much chance is larger than the noise says within groups, too: the median of all tests."""
        ratios = [
            median / chdtri(rank, 0.5)
            for group, scan in zip(self._groups, scans, strict=True)
            for median, rank in zip(scan.medians(group.causes), group.causes.rank, strict=False)
            if rank
        ]
        return max(whole, float(np.median(ratios)) if ratios else 1.0)

    def _found(
        self, chance: float, g: int, i: int, stretch: ScannedStretch, scans: Sequence[GroupScan], dispersion: float
    ) -> PartFound:
        group, tests = self._groups[g], [(0.0, 1)] * self._count
        for own, test, rank in zip(
            group.candidates, scans[g].at(group.causes, stretch), group.causes.rank, strict=True
        ):
            tests[own] = float(test), rank
        return PartFound(i, stretch, chance, tests, scans[g].others, dispersion)
