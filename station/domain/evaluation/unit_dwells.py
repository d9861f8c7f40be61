"""Samples of a table → one row a visit, with names → the visits of each unit."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats, Labels, ReducedVisits, SampleTable
from station.domain.noise import resolution
from station.domain.noise.dwell_statistics import DwellStatistics, measure
from station.domain.noise.noise_prior import NoisePrior
from station.domain.recipe import references
from station.domain.recipe.plan import seating_of_passes
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError

#: Units are worked through in portions of about this many samples.
PORTION = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class UnitDwells:
    """The visits (v) of one unit, in order. begin_s, end_s (v): first and last sample; temperature_degC (v) or NaN;
    dwells: what the readings come to; gold: the same of the gold reference, or None; step (3): the resolution seen;
    quantisation (v, 3): the variance of a mean that rounding leaves (station.domain.noise.resolution); rounding (v, 3):
    the same as the budget has it, where few dwells show little of it.
    """

    serial: str
    run: NDArray[np.int32]
    visit: NDArray[np.int32]
    position: tuple[str, ...]
    seating: tuple[str, ...]
    begin_s: Floats
    end_s: Floats
    temperature_degC: Floats
    dwells: DwellStatistics
    gold: DwellStatistics | None
    step: Floats
    quantisation: Floats
    rounding: Floats | None

    def __len__(self) -> int:
        return len(self.run)


def reduce_table(table: SampleTable, recipe: Recipe, prior: NoisePrior | None = None) -> Iterator[UnitDwells]:
    """The visits of each unit of a table, units in the order of their codes; prior: of their noise.

    Errors: SamplesError.
    """
    if len(table) == 0:
        raise SamplesError("samples-table-empty")
    table = sort_table(table)
    begin, end = visit_boundaries(table)
    _check(table, recipe, begin, end)
    unit = table.unit.code[begin]
    for rows in _portions(unit, end - begin):
        yield from _of_portion(table, recipe, (begin[rows], end[rows]), prior)


def sort_table(table: SampleTable) -> SampleTable:
    """The table sorted by unit, run and visit; samples of a visit keep their order."""
    columns = (table.unit.code, table.run, table.visit)
    falls, same = np.zeros(max(len(table) - 1, 0), bool), np.ones(max(len(table) - 1, 0), bool)
    for column in columns:
        before, after = column[:-1], column[1:]
        falls |= same & (after < before)
        same &= after == before
    return table[np.lexsort(columns[::-1])] if falls.any() else table


def visit_boundaries(table: SampleTable) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First row, and one past the last, of each visit of a table in order."""
    new = np.ones(len(table), bool)
    new[1:] = False
    for column in (table.unit.code, table.run, table.visit):
        new[1:] |= column[1:] != column[:-1]
    begin = np.flatnonzero(new)
    return begin, np.r_[begin[1:], len(table)]


def _check(table: SampleTable, recipe: Recipe, begin: Array, end: Array) -> None:
    """A visit is at one position, and everything it is called is in the recipe."""
    first = np.repeat(table.position.code[begin], end - begin)
    wrong = np.flatnonzero(table.position.code != first)
    if len(wrong):
        row = int(wrong[0])
        names = table.position.names
        raise SamplesError(
            "samples-visit-at-two-positions",
            visit=int(table.visit[row]),
            run=int(table.run[row]),
            serial=str(table.unit.text()[row]),
            first=names[first[row]],
            second=names[table.position.code[row]],
        )
    if recipe.pose_known:
        known = [p.name for p in (*recipe.positions, *recipe.verify.positions)]
        _check_known("position", _used(table.position), known)
    if "seating" in table.labels:
        _check_known("seating", _used(table.labels["seating"]), ["home", *recipe.seatings])


def _used(labels: Labels) -> list[str]:
    return [labels.names[i] for i in np.unique(labels.code)]


def _check_known(what: str, found: Sequence[str], known: Sequence[str]) -> None:
    for name in found:
        if name not in known:
            near = get_close_matches(name, known, 1, 0)[0]
            raise SamplesError("name-not-in-recipe", column=what, name=name, nearest=near)


def _portions(unit: Array, count: Array) -> Iterator[slice]:
    """Slices of visits: whole units, about PORTION samples each."""
    last = np.flatnonzero(np.r_[unit[1:] != unit[:-1], True])
    done = np.cumsum(count)[last]
    number = (done - 1) // PORTION
    stop = last[np.flatnonzero(np.r_[number[1:] != number[:-1], True])] + 1
    for a, b in zip([0, *stop[:-1]], stop, strict=True):
        yield slice(int(a), int(b))


def _of_portion(
    table: SampleTable, recipe: Recipe, edges: tuple[Array, Array], prior: NoisePrior | None
) -> Iterator[UnitDwells]:
    begin, end = edges
    rows = slice(int(begin[0]), int(end[-1]))
    part = table[rows]
    begin, end = begin - rows.start, end - rows.start
    unit, count = part.unit.code[begin].astype(np.int64), end - begin
    dwells = measure(part.reading, begin, count, unit, prior)
    gold = None if part.gold is None else measure(part.gold, begin, count, unit)
    temperature = _means(part.values.get("temperature_degC"), begin, count)
    first = np.flatnonzero(np.r_[True, unit[1:] != unit[:-1]])
    labels = part.labels
    seating = labels["seating"][begin] if "seating" in labels else seating_of_passes(recipe, part.run[begin])
    for a, b in zip(first, np.r_[first[1:], len(begin)], strict=True):
        own, at = slice(int(a), int(b)), begin[a:b]
        own_dwells = _rows(dwells, own)
        seen = resolution.step_of(own_dwells, recipe.device.lsb)
        step = resolution.stated_step(own_dwells, seen, recipe.device.lsb)
        yield UnitDwells(
            serial=part.unit.names[unit[a]],
            run=part.run[at],
            visit=part.visit[at],
            position=tuple(part.position[at].text()),
            seating=tuple(seating[own].text()),
            begin_s=part.time_s[at],
            end_s=part.time_s[end[own] - 1],
            temperature_degC=temperature[own],
            dwells=own_dwells,
            gold=None if gold is None else _rows(gold, own),
            step=step,
            quantisation=(left := _rounding(own_dwells, seen)),
            rounding=_for_budget(own_dwells, step, seen, left),
        )


def _means(value: Floats | None, begin: Array, count: Array) -> Floats:
    if value is None:
        return np.full(len(begin), np.nan)
    return np.asarray(np.add.reduceat(value, begin) / count)


def _rows(dwells: DwellStatistics, rows: slice) -> DwellStatistics:
    return DwellStatistics(*(getattr(dwells, f.name)[rows] for f in fields(DwellStatistics)))


def _rounding(dwells: DwellStatistics, step: Floats) -> Floats:
    noise = resolution.noise_under(step, dwells.std)
    return np.broadcast_to(resolution.rounding_variance(step, noise), dwells.mean.shape)


def _for_budget(dwells: DwellStatistics, step: Floats, seen: Floats, plain: Floats) -> Floats | None:
    """Variance (v, 3) of rounding to `step` where it is another than weights go by, which know the steps seen."""
    own = np.where(step == seen, plain, _rounding(dwells, step))
    of_few = resolution.rounding_of_few(step, dwells)
    return np.where(of_few > 0, of_few, own) if of_few.any() or (step != seen).any() else None


def reduce_visits(found: UnitDwells, recipe: Recipe, truths: references.Truths) -> ReducedVisits:
    """The visits of a unit that take part in the fit: those at positions only `verify` names are left out.

    truths: of this recipe, filled here; units that go through the same visits share them.
    """
    keep = _for_the_fit(found, recipe)
    d = found.dwells
    position = tuple(n for n, k in zip(found.position, keep, strict=True) if k)
    seating = tuple(n for n, k in zip(found.seating, keep, strict=True) if k)
    cov = _covariance(d, found.quantisation)[keep]
    key = position, seating
    if key not in truths:
        truths[key] = references.true_vectors(recipe, *key)
    true = truths[key]
    if recipe.reference.source == "gold":
        true, more = references.gold_vectors(recipe, _of_gold(found, keep), seating)
        cov = cov + more
    with np.errstate(divide="ignore", invalid="ignore"):
        effective = np.nanmin(np.where(d.variance > 0, d.std**2 / d.variance, d.count[:, None]), axis=1)
    return ReducedVisits(
        position=position,
        seating=seating,
        run=found.run[keep],
        visit=found.visit[keep],
        mean=d.mean[keep],
        cov=cov,
        quantisation=found.quantisation[keep],
        dof=d.dof[keep],
        true=true,
        std=d.std[keep],
        count=d.count[keep],
        effective=np.minimum(effective, d.count)[keep],
        time_s=((found.begin_s + found.end_s) / 2)[keep],
        temperature_degC=found.temperature_degC[keep],
        rounding=None if found.rounding is None else found.rounding[keep],
    )


def _for_the_fit(found: UnitDwells, recipe: Recipe) -> NDArray[np.bool_]:
    tumble = {p.name for p in recipe.positions}
    checked_only = {p.name for p in recipe.verify.positions} - tumble
    keep = np.array([name not in checked_only for name in found.position])
    if not keep.any():
        raise SamplesError("samples-of-verify-only", serial=found.serial)
    return keep


def _covariance(d: DwellStatistics, quantisation: Floats) -> Floats:
    """Covariance (v, 3, 3) of the means: noise with the axes' correlation, and rounding."""
    root = np.sqrt(d.variance)
    cov = root[:, :, None] * d.correlation * root[:, None, :]
    cov[:, range(3), range(3)] += quantisation
    return np.asarray(cov)


def _of_gold(found: UnitDwells, keep: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    if found.gold is None:
        raise SamplesError("samples-without-gold")
    gold = found.gold
    return gold.mean[keep], _covariance(gold, np.zeros_like(gold.mean))[keep]
