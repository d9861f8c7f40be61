"""A table of very many samples, reduced some units at a time: memory follows the portion and not the table.

One pass. Each portion is checked as a whole table is checked, looked over for faults, and its visits are reduced by the
noise of its own samples; the noise of all, the spectrum in which a tone would show, and what the moves leave in the
dwells add up. Where anything is out of the ordinary the samples must be seen together, and nothing comes of it: the
table is then read whole.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data import family, input_checks, preflight
from station.diagnosis.data.faults import Inspection, undetectable_faults
from station.diagnosis.data.faults.healthy_units import HealthyUnits
from station.diagnosis.data.faults.tone_search import ToneExtent, ToneSearch
from station.diagnosis.data.preflight import Preflight
from station.diagnosis.data.reduce import ReducedPart, ReducedScene, join_parts, reduce_part
from station.diagnosis.data.ringing import RingingSearch
from station.diagnosis.data.sample_source import SampleSource
from station.diagnosis.data.seating_check import check_seatings
from station.diagnosis.data.stays import recut
from station.diagnosis.data.visit_noise import NoiseTally
from station.domain.core.joined_tables import join
from station.domain.core.types import SampleTable
from station.domain.evaluation.unit_dwells import UnitDwells, reduce_table
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError, StationError
from station.model.scene import visits_scene_of_table

Portions = Callable[[], Iterator[SampleTable]]
Kept = tuple[NDArray[np.bool_], ...]


@dataclass(frozen=True, slots=True, eq=False)
class PortionedTable:
    """What a table comes to: the recipe with what the preflight inferred, the samples that are used, read again when
    they are asked for, and the visits."""

    preflight: Preflight
    recipe: Recipe
    inspection: Inspection
    reduced: ReducedScene


def reduce_portions(recipe: Recipe, portions: Portions) -> PortionedTable | None:
    """The table reduced, of which `portions` makes a new pass in portions of whole units at each call; None where its
    samples must be seen together. The sensor is as the first portion tells."""
    seen = _Seen(recipe)
    if not all(seen.takes(table) for table in portions()) or seen.shows_tone_or_ringing:
        return None
    sigma, recipe, means = seen.noise.sigma(), seen.recipe, join([part.means for part in seen.parts])
    kept, rows = tuple(seen.kept), seen.rows
    dwells = tuple(seen.dwells) if seen.dwells is not None else None
    used = SampleSource(rows, means.unit.names, lambda: _used_portions(portions, kept), dwells)
    hidden = undetectable_faults(recipe, seen.columns, rows, len(means), driven=seen.is_driven)
    return PortionedTable(
        _preflight(recipe, seen.checked, means),
        recipe,
        Inspection((), used, hidden, as_measured=True),
        join_parts(recipe, means, seen.parts, sigma),
    )


class _Seen:
    """What the portions so far come to: the recipe with its sheet, what the preflight says of each, which visits of
    each are used, what is left of their samples, and what adds up."""

    def __init__(self, recipe: Recipe) -> None:
        self.recipe, self.columns, self.rows = recipe, frozenset[str](), 0
        self.checked, self.kept, self.parts = list[Preflight](), list[NDArray[np.bool_]](), list[ReducedPart]()
        self.dwells: list[UnitDwells] | None = []
        self.noise = NoiseTally()
        self._healthy: HealthyUnits | None = None
        self._ringing: RingingSearch | None = None
        self._tones: ToneSearch | None = None
        self._extent: ToneExtent | None = None
        self._units = set[str]()

    def takes(self, raw: SampleTable) -> bool:
        """Whether nothing is out of the ordinary in some more units, nor in all so far together."""
        table = preflight.in_order(raw.used())
        if len(table) < len(raw) or not self._units.isdisjoint(table.unit.names):
            # Copies of rows; or the rows of a unit do not stand together: a portion has a part of it.
            return False
        self._units.update(table.unit.names)
        try:
            found, used = preflight.inspect(self.recipe, table)
            check_seatings(self.recipe, used)
            if self._healthy is None:
                self.recipe = preflight.with_sheet(self.recipe, found)
                self._healthy, self.columns = HealthyUnits(self.recipe), frozenset(table.values)
            if not _is_ordinary(self.recipe, used, found):
                return False
            visit = visits_scene_of_table(self.recipe, used).visit
            if not self._healthy.add(used, visit):
                return False
        except SamplesError:
            return False
        self.checked.append(found)
        self.kept.append(_kept(table, used))
        return self._reduces(used, visit)

    def _reduces(self, table: SampleTable, visit: NDArray[np.intp]) -> bool:
        """The same of samples that are used, in visits (n), looked for tones; keeps what is left of them."""
        self.rows += len(table)
        noise = NoiseTally.of(table.reading, visit)
        self.noise.add(noise)
        self.parts.append(reduce_part(table, visit, noise.sigma()))
        self._ringing = self._ringing or RingingSearch.of(self.recipe, visit)
        if self._ringing is not None:
            self._ringing.add(table, visit)
        try:
            if self.dwells is not None:
                self.dwells += reduce_table(table, self.recipe)
        except StationError:
            # What can be diagnosed need not be such that it can be calibrated.
            self.dwells = None
        return self._looks_for_tones(table, visit)

    def _looks_for_tones(self, table: SampleTable, visit: NDArray[np.intp]) -> bool:
        """Whether the spectra of these samples could be added to those before."""
        own, before = ToneExtent.of(table, visit), self._extent
        if own is None:
            return True
        self._extent = own if before is None else ToneExtent.of_all([before, own])
        if not self._extent.shows_tones:
            return True
        if self._tones is None:
            self._tones = ToneSearch(self.recipe.device.rate_hz, own.longest, in_parts=True)
            if before is not None:
                # The drive was the same in all before, and their spectra were not taken.
                return False
        if not self._tones.covers(own):
            return False
        self._tones.add(table, visit, own)
        return True

    @property
    def is_driven(self) -> bool:
        """Whether the drive was ever another one."""
        return self._extent is not None and self._extent.is_driven

    @property
    def shows_tone_or_ringing(self) -> bool:
        """Whether all samples together may show any."""
        if self._tones is not None and self._tones.lines():
            return True
        return self._ringing is not None and len(self._ringing.promising(self.noise.sigma())) > 0


def _is_ordinary(recipe: Recipe, table: SampleTable, found: Preflight) -> bool:
    """Whether nothing of a portion but visits left out is to be remarked, and its visits stand as they came. Errors:
    SamplesError where no cause can be told from it."""
    if found.remarks or found.faults or found.sheet.full_scale is not None or table.gold is not None:
        return False
    if not all(np.all(np.isfinite(values)) for values in table.values.values()):
        return False
    preflight.check_orientations(recipe, found)
    input_checks.check(recipe, table)
    # Steps of the mean are remarked, and the samples are those that were looked at unless visits were left out.
    return recut(recipe, table, steps_looked_for=not found.left_out).as_it_came


def _kept(table: SampleTable, used: SampleTable) -> NDArray[np.bool_]:
    """Which visits (v) of a table are among those used; both sorted."""
    every, some = (_visit_keys(t) for t in (table, used))
    return np.isin(every, some) if len(some) < len(every) else np.ones(len(every), bool)


def _visit_keys(table: SampleTable) -> NDArray[np.int64]:
    """A number for each visit of a table, in its order."""
    unit, run = (x.astype(np.int64) for x in (table.unit.code, table.run))
    key = np.asarray((unit << 44) + (run << 24) + table.visit, np.int64)
    return key[np.flatnonzero(np.diff(key, prepend=-1))]


def _used_portions(portions: Portions, kept: Kept) -> Iterator[SampleTable]:
    """The samples of the visits that are used."""
    for raw, visits in zip(portions(), kept, strict=True):
        table = preflight.in_order(raw.used())
        yield table if visits.all() else table[_rows_of(table, visits)].used()


def _rows_of(table: SampleTable, visits: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The rows (n) of some visits (v)."""
    columns = (table.unit.code, table.run, table.visit)
    begins = np.any([np.diff(column, prepend=-1) != 0 for column in columns], axis=0)
    return np.asarray(visits[np.cumsum(begins) - 1])


def _preflight(recipe: Recipe, checked: Sequence[Preflight], means: SampleTable) -> Preflight:
    """What was found of all portions, units far from the others included."""
    lengths = np.linalg.norm(means.reading, axis=1)
    size = float(lengths.min()), float(np.median(lengths)), float(lengths.max())
    return replace(preflight.merge(list(checked)), magnitude=size, remarks=family.of_table(recipe, means))
