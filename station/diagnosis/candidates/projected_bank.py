"""The bank in a space: what each candidate can show there, and how well it explains the readings.

A fleet is gone through some units at a time. Of a unit's white columns Z only the small products are kept that the
evidence needs: the eigenvalues of the normal matrix ZᵀZ = E diag(m) Eᵀ, and along E the products ZᵀC and Zᵀr with the
known columns and the readings.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import AMPLITUDE_LIMIT_FACTOR, UNITS_AT_ONCE, Bank
from station.diagnosis.candidates.visit_scan import NormalProducts, VisitColumns, VisitSpace, visit_columns
from station.diagnosis.linear.evidence import (
    GROUP_AXES,
    DataSets,
    EigenSpectrum,
    Pattern,
    log_mean_exp,
    spectrum,
    visible_directions,
)
from station.diagnosis.linear.grid import RowLayout
from station.diagnosis.linear.parted_space import PartedSpace
from station.diagnosis.linear.projection import ResidualSpace, SpaceSize
from station.domain.core.types import Array, Floats

#: Eigenvalues looked at together: with a number for each amplitude, some 10 MB.
EIGENVALUES_AT_ONCE = 1 << 15


class EigenProducts(NamedTuple):
    """Products of columns along the eigenvectors E of their normal matrix: its eigenvalues m (b, …, K), EᵀZᵀC
    (b, …, K, c), EᵀZᵀr (b, …, K); and E (b, …, K, K), None where no axes are asked for."""

    m: Floats
    cross: Floats
    readings: Floats
    vectors: Floats | None

    def of(self, some: slice) -> "EigenProducts":
        """Those of some of the candidates (b)."""
        E = None if self.vectors is None else self.vectors[some]
        return EigenProducts(self.m[some], self.cross[some], self.readings[some], E)


class CandidateFit(NamedTuple):
    """What a space shows of one candidate: L (ρ) of the readings, or u (1, …) of a scan, which has many groups; the log
    evidence; and ZE (U, M, K) in single precision, or a scan's visits, where asked for."""

    spectrum: EigenSpectrum
    components: Floats | None
    known_likelihood: Floats | None
    evidence: float
    axes: Array | VisitColumns | None


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedBank:
    """A bank as a space sees it, found of each candidate, and the readings as a data set; the space itself, which is as
    long as all readings, with the axes alone."""

    bank: Bank
    found: tuple[CandidateFit, ...]
    readings: DataSets
    space: ResidualSpace | None

    @property
    def spectra(self) -> tuple[EigenSpectrum, ...]:
        """What each candidate can show."""
        return tuple(f.spectrum for f in self.found)

    @property
    def evidence(self) -> Floats:
        """Log evidence (candidates) of the readings."""
        return np.array([f.evidence for f in self.found])

    def only(self, kept: Sequence[bool]) -> "ProjectedBank":
        """The same with some of the candidates."""
        chosen = [i for i, k in enumerate(kept) if k]
        return replace(self, bank=self.bank.only(chosen), found=tuple(self.found[i] for i in chosen))

    def likelihood(self, found: CandidateFit) -> Floats:
        """L of one of the candidates: (ρ), of a scan (U, G, ρ), those of many groups, which are not kept."""
        if found.known_likelihood is not None:
            return found.known_likelihood
        assert found.components is not None
        return np.asarray(found.spectrum.likelihoods(found.components, self.readings)[0])


def project_bank(
    bank: Bank, layout: RowLayout, spaces: Sequence[ResidualSpace | PartedSpace], *, axes: bool = False
) -> tuple[ProjectedBank, ...]:
    """The bank in each of some spaces; with the axes, which the drawing of null data needs, or without."""
    blocks, scans = _column_blocks(bank), [i for i, c in enumerate(bank.candidates) if c.scans_visits]
    kinds = [kind for block in blocks for kind in block.kinds]
    kinds += [ShapeGroup((i,), "scan", bank.groups[i], np.zeros(1, np.intp)) for i in scans]
    parts: list[list[list[NormalProducts | EigenProducts]]] = [[] for _ in spaces]
    kept: list[list[Array]] = [[] for _ in spaces]
    for units in layout.grid.parts(UNITS_AT_ONCE):
        if not bank.candidates:
            # A space of many units sums its readings while they are gone through.
            for each in spaces:
                each.part(units)
            continue
        rows = bank.rows(layout, units) if bank.made else None
        single = [visit_columns(bank, i, layout, units) for i in scans]
        for i, space in enumerate(each.part(units) for each in spaces):
            found, white = list[NormalProducts](), list[Array]()
            for block in blocks if bank.made else ():
                assert rows is not None
                columns = space.project(rows.only(block.at))
                found += _products(block, columns, space)
                white += [columns.astype(np.float32)] if axes else []
            if white:
                kept[i].append(np.concatenate(white, axis=2))
            if single:
                visits = VisitSpace.of(space, layout.grid.k)
                found += [visits.products(one) for one in single]
            pairs = zip(kinds, found, strict=True)
            parts[i].append([x if kind.pattern == "shared" else _diagonal(kind, x, axes=axes) for kind, x in pairs])
    drawn = [AxesSource(np.concatenate(k) if k else None, layout) if axes else None for k in kept]
    return tuple(_merge_parts(bank, kinds, *each) for each in zip(spaces, parts, drawn, strict=True))


class AxesSource(NamedTuple):
    """What axes are made from: white columns (U, M, C) in single precision, if the bank has any, and the layout."""

    columns: Array | None
    layout: RowLayout

    def axes(self, bank: Bank, i: int, E: Floats) -> "Array | VisitColumns":
        """Those of a candidate along its eigenvectors."""
        if bank.candidates[i].scans_visits:
            return visit_columns(bank, i, self.layout, slice(None)).turned(E)
        assert self.columns is not None
        return _turned(self.columns[..., bank.place[i]], E)


class ShapeGroup(NamedTuple):
    """Candidates that are alike in shape: which, their pattern, groups within a unit, and the sets of columns (b) of
    the block that they see; several may see one."""

    which: tuple[int, ...]
    pattern: Pattern
    groups: int
    sets: NDArray[np.intp]


class ColumnBlock(NamedTuple):
    """Sets of columns of one width, side by side, and the candidates that see them: few enough columns for a
    processor's cache."""

    at: slice
    width: int
    kinds: tuple[ShapeGroup, ...]


def _column_blocks(bank: Bank) -> list[ColumnBlock]:
    """The columns of a bank by width; those of one width stand side by side."""
    ends: dict[int, slice] = {}
    for made in bank.made:
        width = made.at.stop - made.at.start
        ends[width] = slice(ends.get(width, made.at).start, made.at.stop)
    by_shape: dict[int, dict[tuple[Pattern, int], list[int]]] = {width: {} for width in ends}
    for i, (c, groups, at) in enumerate(zip(bank.candidates, bank.groups, bank.place, strict=True)):
        if not c.scans_visits:
            shape = c.pattern, groups if c.pattern == "scan" else 1
            by_shape[at.stop - at.start].setdefault(shape, []).append(i)
    return [
        ColumnBlock(
            at,
            width,
            tuple(
                ShapeGroup(
                    tuple(which), pattern, groups, np.array([bank.place[i].start - at.start for i in which]) // width
                )
                for (pattern, groups), which in by_shape[width].items()
            ),
        )
        for width, at in ends.items()
    ]


def _products(block: ColumnBlock, columns: Floats, space: ResidualSpace) -> Iterator[NormalProducts]:
    """The products of the units' white columns (U, M, C) of a block, of each of its kinds: (b, U, K, …),
    (b, U, G, K, …) of a scan, (b, K, …) summed over the units of a shared one."""
    Z = np.ascontiguousarray(columns.swapaxes(1, 2))
    U, _, M = Z.shape
    sets = Z.reshape(U, -1, block.width, M)
    cross = (Z @ space.shared_basis).reshape(*sets.shape[:3], -1)
    readings = (Z @ space.data[..., None]).reshape(sets.shape[:3])
    # Candidates that share a coefficient and those that do not see the same columns: one product serves both.
    whole = sets @ sets.swapaxes(2, 3) if any(kind.pattern != "scan" for kind in block.kinds) else None
    for kind in block.kinds:
        if kind.pattern == "scan":
            rows = sets[:, kind.sets].reshape(U, len(kind.sets), kind.groups, -1, M)
            normal = rows @ rows.swapaxes(-1, -2)
        else:
            assert whole is not None
            normal = whole[:, kind.sets]
        found = NormalProducts(
            normal,
            cross[:, kind.sets].reshape(*normal.shape[:-1], -1),
            readings[:, kind.sets].reshape(normal.shape[:-1]),
        )
        yield NormalProducts(*(x.sum(0) if kind.pattern == "shared" else x.swapaxes(0, 1) for x in found))


def _merge_parts(
    bank: Bank,
    kinds: Sequence[ShapeGroup],
    space: ResidualSpace | PartedSpace,
    parts: Sequence[list[NormalProducts | EigenProducts]],
    drawn: AxesSource | None,
) -> ProjectedBank:
    """What all parts together show."""
    sets = space.data_sets() if isinstance(space, PartedSpace) else DataSets.of(space, space.data[None])
    found: dict[int, CandidateFit] = {}
    for k, kind in enumerate(kinds):
        found.update(
            zip(kind.which, _candidate_fits(kind, bank, [part[k] for part in parts], drawn, sets), strict=True)
        )
    fits = tuple(found[i] for i in range(len(bank.candidates)))
    kept = space if drawn is not None and isinstance(space, ResidualSpace) else None
    return ProjectedBank(bank, fits, sets, kept)


def _diagonal(kind: ShapeGroup, products: NormalProducts, *, axes: bool) -> EigenProducts:
    """The products of a kind along their eigenvectors."""
    normal, cross, readings = products
    if kind.pattern != "own" and cross.shape[-1]:
        normal = normal - cross @ cross.swapaxes(-1, -2)
    m, E = np.linalg.eigh(normal)
    turn = E.swapaxes(-1, -2)
    return EigenProducts(m, turn @ cross, (turn @ readings[..., None])[..., 0], E if axes else None)


def _all_parts(
    kind: ShapeGroup, parts: Sequence[NormalProducts | EigenProducts], copies: int, *, axes: bool
) -> EigenProducts:
    """The products of all units: one after the other, or of a shared cause their sum."""
    if kind.pattern == "shared":
        normal, cross, readings = (np.sum(x, axis=0) for x in zip(*parts, strict=True))
        return _diagonal(kind, NormalProducts(copies * normal, copies * cross, readings), axes=axes)
    m, cross, readings, *E = (np.concatenate(x, axis=1) for x in zip(*parts, strict=True) if x[0] is not None)
    return EigenProducts(m, cross, readings, E[0] if E else None)


def _candidate_fits(
    kind: ShapeGroup,
    bank: Bank,
    parts: Sequence[NormalProducts | EigenProducts],
    drawn: AxesSource | None,
    sets: DataSets,
) -> Iterator[CandidateFit]:
    """What all parts together show of each candidate of a kind; some candidates at a time, since each has a number for
    every amplitude that is tried."""
    every = _all_parts(kind, parts, sets.size.copies, axes=drawn is not None)
    at_once = max(1, EIGENVALUES_AT_ONCE // max(every.m[0].size, 1))
    for first in range(0, len(kind.which), at_once):
        some = slice(first, first + at_once)
        yield from _fits_of(kind._replace(which=kind.which[some]), bank, every.of(some), drawn, sets)


def _fits_of(
    kind: ShapeGroup, bank: Bank, products: EigenProducts, drawn: AxesSource | None, sets: DataSets
) -> Iterator[CandidateFit]:
    """The same of the candidates that a kind has left."""
    size, scan = sets.size, kind.pattern == "scan"
    m, cross, readings, E = products
    visible = _leaves_something(visible_directions(m, GROUP_AXES[kind.pattern]), kind.pattern, size)
    most = np.array([bank.candidates[i].most for i in kind.which])
    can = spectrum(size, np.where(visible, m, 0.0), cross * visible[..., None], kind.pattern, most)
    u = can.components((readings * visible)[:, None], sets)
    likelihood = can.likelihoods(u, sets) if scan else can.likelihood(can.terms(u, sets), sets)
    odds = log_mean_exp(likelihood)
    evidence = (log_mean_exp(can.spread(odds)) if scan else odds)[:, 0]
    retained = can if drawn is not None else can.of_readings()
    for i, which in enumerate(kind.which):
        axes = None if drawn is None or E is None else drawn.axes(bank, which, E[i] * visible[i][..., None, :])
        of_groups, known = (u[i], None) if scan else (None, likelihood[i, 0])
        yield CandidateFit(retained.of(i), of_groups, known, float(evidence[i]), axes)


def _leaves_something(visible: NDArray[np.bool_], pattern: Pattern, size: SpaceSize) -> NDArray[np.bool_]:
    """The directions (b, …, K) that can be seen, none of a candidate that has as many of them as there are numbers:
    it follows any readings, nothing is left to measure it by, and rounding would be its evidence."""
    if pattern == "scan":
        return visible
    axes = tuple(range(-1 - GROUP_AXES[pattern], 0))
    count = np.count_nonzero(visible, axis=axes, keepdims=True) * (size.copies if pattern == "own" else 1)
    return np.asarray(visible & (count < size.dof))


def _turned(columns: Array, E: Floats) -> Array:
    """Columns (U, M, K) along the eigenvectors (K, K), (U, K, K), or (U, G, a, a) of groups of them."""
    if E.ndim < 4:
        return columns @ E.astype(np.float32)
    U, M, K = columns.shape
    split = columns.reshape(U, M, E.shape[1], -1).transpose(0, 2, 1, 3) @ E.astype(np.float32)
    return split.transpose(0, 2, 1, 3).reshape(U, M, K)


def visible_candidates(projected: ProjectedBank, swollen: float) -> tuple[bool, ...]:
    """Of each candidate, whether the largest amplitude met in practice would leave more than noise (d > 1).

    swollen: how many times the noise is larger than the samples' own, perhaps by what is yet to be found.
    """
    pairs = zip(projected.bank.candidates, projected.spectra, strict=True)
    return tuple(swollen * c.most / AMPLITUDE_LIMIT_FACTOR * float(np.sqrt(s.m.sum())) > 1.0 for c, s in pairs)
