"""Causes that groups of a fleet share: portions make moments of their units, the search goes over their sums."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.fleet.candidate import SharedCandidate
from station.diagnosis.fleet.interval import GroupUnits
from station.diagnosis.fleet.moments import FleetCell, Moments
from station.diagnosis.fleet.noise import ResponseNoise, response_noise, winsorised
from station.diagnosis.fleet.response import (
    SharedCause,
    VisitOrder,
    covariate_columns,
    response,
    shared_causes,
    visit_order,
)
from station.diagnosis.fleet.search import SharedFinding, search_shared
from station.diagnosis.fleet.slices import TimeSlices, slice_edges, time_slices
from station.domain.core.types import Floats, ReducedVisits
from station.domain.evaluation.reduced_visits_texts import from_texts
from station.domain.recipe.recipe import Recipe
from station.errors import LogError
from station.ports.fleet import Columns, ColumnType, PortionResults
from station.ports.log_reader import Query
from station.service.fleet import FleetPlan, FleetWork, OpenSource

#: Units that the noise is learnt from, spread over all of them; fewer than this say nothing of it.
_SAMPLE, _FEWEST = 2048, 64
#: In a stretch of few units one that is no good must count no more than a good one: so many times what is usual.
_MOST_IN_STRETCH = 1.2
#: Columns of a portion's result, one row a cell: its moments, then what its units say one by one.
COLUMNS: Mapping[str, ColumnType] = {
    **dict.fromkeys(("station", "nest", "lot"), "text"),
    "units": "number",
    **dict.fromkeys(("z", "cross", "kz", "kk", "unit_z"), "numbers"),
    "began_ns": "integers",
}


@dataclass(frozen=True, slots=True, eq=False)
class FleetBank:
    """What every portion needs to know: the order of visits that is compared, the noise, the causes."""

    order: VisitOrder
    noise: ResponseNoise
    causes: tuple[SharedCause, ...]

    @property
    def digest(self) -> str:
        """Changes with anything that a portion's result depends on."""
        parts = json.dumps(self.order).encode(), self.noise.middle.tobytes(), self.noise.whiten.tobytes()
        return hashlib.sha256(b"".join(parts)).hexdigest()[:32]

    @property
    def covariates(self) -> int:
        """Columns of the causes that go with a covariate."""
        return sum(cause.axes for cause in self.causes if cause.columns is None)


def learn_bank(recipe: Recipe, query: Query, sources: Sequence[OpenSource]) -> FleetBank:
    """From a sample spread over all units. Errors: LogError where there are too few, or of several recipes."""
    visits, groups = _sample(recipe, query, sources)
    orders = [visit_order(one) for one in visits]
    order = max(dict.fromkeys(orders), key=orders.count) if orders else ((), ())
    rows = [i for i, own in enumerate(orders) if own == order]
    needed = max(_FEWEST, 6 * len(order[0]))
    if len(rows) < needed:
        raise LogError("fleet-too-few-units", units=len(rows), needed=needed)
    noise = response_noise(
        np.array([response(visits[i]) for i in rows]), _noise_groups([groups[i] for i in rows], needed)
    )
    return FleetBank(order, noise, tuple(shared_causes(recipe, visits[rows[0]])))


def _noise_groups(groups: Sequence[tuple[str, str, str]], needed: int) -> list[tuple[str, ...]]:
    """The finest of station, nest and lot, of station and nest, of station, of all, in which units differ from others
    of their group in so many independent ways: a group of one says nothing of the noise."""
    for parts in (3, 2, 1):
        cut = [group[:parts] for group in groups]
        if len(cut) - len(set(cut)) >= needed:
            return list(cut)
    return [()] * len(groups)


def moments_portion(bank: FleetBank, work: FleetWork) -> Columns:
    """One portion, in whatever process: units of the bank's order of visits."""
    recipe, truths = Recipe.model_validate_json(work.recipe), dict[Any, Any]()
    with work.open_source() as source:
        rows = source.reduced(work.numbers)
    pairs = list(zip(rows, from_texts([row.stops for row in rows], recipe, truths), strict=True))
    pairs = [(row, visits) for row, visits in pairs if visit_order(visits) == bank.order]
    columns: dict[str, list[Any]] = {name: [] for name in COLUMNS}
    if not pairs:
        return columns
    cells = [FleetCell(row.station, row.nest, row.lot) for row, _ in pairs]
    z = bank.noise.whitened(np.array([response(visits) for _, visits in pairs]))
    raw = covariate_columns(recipe, bank.causes, [visits for _, visits in pairs])
    found = Moments.of(cells, winsorised(z), np.einsum("rd,udk->urk", bank.noise.whiten, raw))
    for i, cell in enumerate(found.cells):
        own = [u for u, name in enumerate(cells) if name == cell]
        sums = (v[i].ravel().tolist() for v in (found.z, found.cross, found.kz, found.kk))
        row = (cell.station, cell.nest, cell.lot, float(found.units[i]), *sums, z[own].ravel().tolist())
        for name, value in zip(COLUMNS, (*row, [pairs[u][0].started_ns for u in own]), strict=True):
            columns[name].append(value)
    return columns


@dataclass(frozen=True, slots=True, eq=False)
class FleetFindings:
    """findings: largest evidence first; units: that were compared; dispersion: by how much chance is larger than the
    noise of single units says."""

    findings: tuple[SharedFinding, ...]
    units: int
    dispersion: float


def search_fleet(bank: FleetBank, planned: FleetPlan, results: PortionResults) -> FleetFindings:
    """Goes over the sums of all portions. Errors: StoreFault."""
    moments = Moments.join(_moments(bank, results.read(portion.key)) for portion in planned.portions)
    place = {cell: i for i, cell in enumerate(moments.cells)}
    slices = _slices(place, planned, results)

    def timeline(candidate: SharedCandidate, known: Floats) -> GroupUnits:
        parts = [_projected(results.read(p.key), candidate, known, place, slices) for p in planned.portions]
        began, z, row = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(began, kind="stable")
        return GroupUnits(began[order], z[order, 0], z[order, 1], row[order])

    def leftover(known: Floats) -> Floats:
        sums = np.zeros_like(known)
        for p in planned.portions:
            for cell, times, z in _units(results.read(p.key)):
                row = slices.row_of(place[cell], times)
                np.add.at(sums, row, winsorised(z - known[row], _MOST_IN_STRETCH))
        return sums

    found, dispersion = search_shared(moments, slices, bank.causes, bank.noise, timeline, leftover)
    return FleetFindings(tuple(found), int(moments.units.sum()), dispersion)


def _slices(place: Mapping[FleetCell, int], planned: FleetPlan, results: PortionResults) -> TimeSlices:
    parts = [(place[cell], times) for p in planned.portions for cell, times, _ in _units(results.read(p.key))]
    return time_slices(slice_edges(np.concatenate([times for _, times in parts])), parts)


def _units(columns: Columns) -> Iterator[tuple[FleetCell, NDArray[np.int64], Floats]]:
    """Of each cell of a portion its units: beginnings (n), whitened responses (n, r)."""
    rows = zip(columns["station"], columns["nest"], columns["lot"], columns["unit_z"], columns["began_ns"], strict=True)
    for station, nest, lot, z, times in rows:
        yield FleetCell(station, nest, lot), np.array(times, np.int64), np.array(z, float).reshape(len(times), -1)


def _moments(bank: FleetBank, columns: Columns) -> Moments:
    r, k = len(bank.noise.whiten), bank.covariates
    cells = tuple(FleetCell(*names) for names in zip(columns["station"], columns["nest"], columns["lot"], strict=True))
    c = len(cells)
    shapes = {"z": (c, r), "cross": (c, r, k), "kz": (c, k), "kk": (c, k, k)}
    parts = {name: np.array(columns[name], float).reshape(shape) for name, shape in shapes.items()}
    return Moments(cells, np.array(columns["units"], float), **parts)


def _projected(
    columns: Columns, candidate: SharedCandidate, known: Floats, place: Mapping[FleetCell, int], slices: TimeSlices
) -> tuple[Any, Floats, Any]:
    """Of a portion's units of one group: beginning, projections (n, 2, a) of the winsorised and of the plain response,
    row of the slices."""
    assert candidate.columns is not None
    a = candidate.columns
    began, projected, rows = [np.zeros(0, np.int64)], [np.zeros((0, 2, a.shape[1]))], [np.zeros(0, np.intp)]
    for cell, times, own in _units(columns):
        if candidate.members[place[cell]]:
            row = slices.row_of(place[cell], times)
            began.append(times)
            projected.append((np.stack([winsorised(own), own], axis=1) - known[row][:, None]) @ a)
            rows.append(row)
    return np.concatenate(began), np.concatenate(projected), np.concatenate(rows)


def _sample(
    recipe: Recipe, query: Query, sources: Sequence[OpenSource]
) -> tuple[list[ReducedVisits], list[tuple[str, str, str]]]:
    visits, groups = list[ReducedVisits](), list[tuple[str, str, str]]()
    truths = dict[Any, Any]()
    for open_source in sources:
        with open_source() as source:
            numbers = np.fromiter((attempt.number for attempt in source.selection(query)), np.int64)
            step = max(1, len(numbers) * len(sources) // _SAMPLE)
            rows = source.reduced(numbers[::step].tolist())
            visits += from_texts([row.stops for row in rows], recipe, truths)
            groups += [(row.station, row.nest, row.lot) for row in rows]
    return visits, groups
