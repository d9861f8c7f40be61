"""A table of very many samples, reduced some units at a time: memory follows the portion and not the table.

Two passes. The first one checks each portion as a whole table is checked, looks for faults and adds up the noise of a
sample; the second one reduces the visits and adds up the spectrum in which a tone would show, and what the moves leave
in the dwells. Where anything is out of the ordinary the samples must be seen together, and nothing comes of it: the
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
from station.diagnosis.data.stays import recut
from station.diagnosis.data.visit_noise import NoiseTally
from station.domain.core.joined_tables import join
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError
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


@dataclass(frozen=True, slots=True, eq=False)
class _Survey:
    """What the first pass found: the recipe with its sheet, what the preflight says of each portion, which visits of
    each are used, noise of a sample (3), and the extent of the record for a tone, None where none can be looked for."""

    recipe: Recipe
    checked: tuple[Preflight, ...]
    kept: Kept
    sigma: Floats
    extent: ToneExtent | None
    samples: int
    columns: frozenset[str]


def reduce_portions(recipe: Recipe, portions: Portions) -> PortionedTable | None:
    """The table reduced, of which `portions` makes a new pass in portions of whole units at each call; None where its
    samples must be seen together. The sensor is as the first portion tells."""
    found = _survey(recipe, portions)
    if found is None:
        return None
    recipe, parts = found.recipe, list[ReducedPart]()
    tones = ToneSearch(recipe.device.rate_hz, found.extent) if found.extent and found.extent.shows_tones else None
    ringing: RingingSearch | None = None
    for table in _used_portions(portions, found.kept):
        visit = visits_scene_of_table(recipe, table).visit
        if tones is not None:
            tones.add(table, visit)
        ringing = ringing or RingingSearch.of(recipe, visit)
        if ringing is not None:
            ringing.add(table, visit)
        parts.append(reduce_part(table, visit, found.sigma))
    if tones is not None and tones.strongest() is not None:
        return None
    if ringing is not None and len(ringing.promising(found.sigma)):
        return None
    means = join([part.means for part in parts])
    used = SampleSource(found.samples, means.unit.names, lambda: _used_portions(portions, found.kept))
    driven = found.extent is not None and found.extent.is_driven
    hidden = undetectable_faults(recipe, found.columns, found.samples, len(means), driven=driven)
    return PortionedTable(
        _preflight(recipe, found.checked, means),
        recipe,
        Inspection((), used, hidden, as_measured=True),
        join_parts(recipe, means, parts, found.sigma),
    )


def _survey(recipe: Recipe, portions: Portions) -> _Survey | None:
    """The first pass; None where anything is out of the ordinary."""
    checked, kept, extents = list[Preflight](), list[NDArray[np.bool_]](), list[ToneExtent | None]()
    noise, healthy, columns, rows, units = NoiseTally(), None, frozenset[str](), 0, set[str]()
    for raw in portions():
        table = preflight.in_order(raw.used())
        if not units.isdisjoint(table.unit.names):
            # The rows of a unit do not stand together: a portion has a part of it.
            return None
        units.update(table.unit.names)
        try:
            found, used = preflight.inspect(recipe, table)
            if not checked:
                recipe = preflight.with_sheet(recipe, found)
                healthy, columns = HealthyUnits(recipe), frozenset(table.values)
            if healthy is None or not _is_ordinary(recipe, used, found):
                return None
            visit = visits_scene_of_table(recipe, used).visit
            if not healthy.add(used, visit):
                return None
        except SamplesError:
            return None
        noise.add(used.reading, visit)
        extents.append(ToneExtent.of(used, visit))
        checked.append(found)
        kept.append(_kept(table, used))
        rows += len(used)
    known = [e for e in extents if e is not None]
    extent = ToneExtent.of_all(known) if known and len(known) == len(extents) else None
    return _Survey(recipe, tuple(checked), tuple(kept), noise.sigma(), extent, rows, columns)


def _is_ordinary(recipe: Recipe, table: SampleTable, found: Preflight) -> bool:
    """Whether nothing of a portion but visits left out is to be remarked, and its visits stand as they came. Errors:
    SamplesError where no cause can be told from it."""
    if found.remarks or found.sheet.full_scale is not None or table.gold is not None:
        return False
    if not all(np.all(np.isfinite(values)) for values in table.values.values()):
        return False
    preflight.check_orientations(recipe, found)
    input_checks.check(recipe, table)
    return recut(recipe, table).as_it_came


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
