"""The bank in a space: what each candidate can show there, and how well it explains the readings.

A fleet is processed some units at a time. Of a unit's white columns Z only the small products that the evidence needs
are kept: the eigenvalues of the normal matrix ZᵀZ = E diag(m) Eᵀ, and along E the products ZᵀC and Zᵀr with the known
columns and the readings.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import AMPLITUDE_LIMIT_FACTOR, UNITS_AT_ONCE, Bank
from station.diagnosis.candidates.column_blocks import ShapeGroup, column_blocks
from station.diagnosis.candidates.part_of_space import PartOfSpace
from station.diagnosis.candidates.visit_scan import NormalProducts, VisitColumns, VisitSpace, visit_columns
from station.diagnosis.linear.eigen import eigenvectors
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
from station.diagnosis.linear.several_hits import spread_of_hits
from station.domain.core.types import Array, Floats

#: Eigenvalues looked at together: with a number for each amplitude, two to three megabytes.
EIGENVALUES_AT_ONCE = 1 << 13


class EigenProducts(NamedTuple):
    """Products of columns along the eigenvectors E of their normal matrix: its eigenvalues m (b, …, K), EᵀZᵀC
    (b, …, K, c), EᵀZᵀr (b, …, K); and E (b, …, K, K), None where no axes are asked for."""

    m: Floats
    cross: Floats
    readings: Floats
    vectors: Floats | None

    def times(self, factor: float) -> "EigenProducts":
        """Those of columns and readings that are so many times as long; the known columns stay orthonormal."""
        return EigenProducts(factor**2 * self.m, factor * self.cross, factor**2 * self.readings, self.vectors)

    def of(self, some: slice) -> "EigenProducts":
        """Those of some of the candidates (b)."""
        E = None if self.vectors is None else self.vectors[some]
        return EigenProducts(self.m[some], self.cross[some], self.readings[some], E)


class CandidateFit(NamedTuple):
    """What a space shows of one candidate: L (ρ) of the readings, or u (1, …) of a scan, which has many groups; the log
    evidence; and ZE (U, M, K) in single precision, or a scan's visits, where asked for."""

    alike: EigenSpectrum
    place: int
    components: Floats | None
    known_likelihood: Floats | None
    evidence: float
    axes: Array | VisitColumns | None

    @property
    def spectrum(self) -> EigenSpectrum:
        """What it can show: one of those alike in shape."""
        return self.alike.of(self.place)


class KeptProducts(NamedTuple):
    """Of a whole bank the products of each kind, and which of its candidates (chosen) are looked at."""

    bank: Bank
    kinds: tuple[tuple[ShapeGroup, EigenProducts], ...]
    chosen: tuple[int, ...]

    def projected(self, sets: DataSets) -> "ProjectedBank":
        """The bank of the candidates that are looked at, as products and readings show it."""
        found: dict[int, CandidateFit] = {}
        for kind, products in self.kinds:
            found.update(zip(kind.which, _candidate_fits(kind, self.bank, products, None, sets), strict=True))
        fits = tuple(found[i] for i in self.chosen)
        return ProjectedBank(self.bank.only(self.chosen), fits, sets, None, self)


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedBank:
    """A bank as a space sees it, found of each candidate, and the readings as a data set; the space itself, which is as
    long as all readings, with the axes alone, and the products, where they are kept."""

    bank: Bank
    found: tuple[CandidateFit, ...]
    readings: DataSets
    space: ResidualSpace | None
    kept: KeptProducts | None = None

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
        products = self.kept and self.kept._replace(chosen=tuple(self.kept.chosen[i] for i in chosen))
        found = tuple(self.found[i] for i in chosen)
        return replace(self, bank=self.bank.only(chosen), found=found, kept=products)

    def in_noise(self, factor: float) -> "ProjectedBank | None":
        """The same where all noise is so many times as large, and nothing that is known has a prior; None where no
        products are kept."""
        return (
            None
            if self.kept is None
            else KeptProducts(
                self.kept.bank,
                tuple((kind, products.times(1 / factor)) for kind, products in self.kept.kinds),
                self.kept.chosen,
            ).projected(self.readings.times(1 / factor))
        )

    def likelihood(self, found: CandidateFit) -> Floats:
        """L of one of the candidates: (ρ), of a scan (U, G, ρ), those of many groups, which are not kept."""
        if found.known_likelihood is not None:
            return found.known_likelihood
        assert found.components is not None
        return np.asarray(found.spectrum.likelihoods(found.components, self.readings)[0])


def project_bank(
    bank: Bank,
    layout: RowLayout,
    spaces: Sequence[ResidualSpace | PartedSpace],
    *,
    axes: bool = False,
    keep: bool = False,
) -> tuple[ProjectedBank, ...]:
    """The bank in each of some spaces; with the axes, which the drawing of null data needs, or without; keep: with the
    products, so that it is known in larger noise too."""
    blocks = column_blocks(bank, layout, whole=axes)
    scans = [i for i, c in enumerate(bank.candidates) if c.scans_visits]
    kinds = [kind for block in blocks for kind in block.kinds]
    kinds += [ShapeGroup((i,), "scan", bank.groups[i], np.zeros(1, np.intp)) for i in scans]
    parts: list[list[list[NormalProducts | EigenProducts]]] = [[] for _ in spaces]
    kept: list[list[Array]] = [[] for _ in spaces]
    # Spaces that are not held are gone through for what the readings are in them, candidates or none.
    needed = bank.candidates or any(isinstance(space, PartedSpace) for space in spaces)
    for units in layout.grid.parts(UNITS_AT_ONCE) if needed else ():
        gain = layout.axis_gain(units) if any(block.one_axis for block in blocks) else None
        seen = [PartOfSpace.of(space.part(units), gain) for space in spaces]
        found: list[list[NormalProducts]] = [[] for _ in spaces]
        white: list[list[Array]] = [[] for _ in spaces]
        for block in blocks:
            rows = list(block.rows(bank, layout, units))
            for i, part in enumerate(seen):
                found[i] += part.products(block, rows)
                white[i] += part.free(rows) if axes else []
        if scans:
            single = [visit_columns(bank, i, layout, units) for i in scans]
            for i, part in enumerate(seen):
                visits = VisitSpace.of(part.space, layout.grid.k)
                found[i] += [visits.products(one) for one in single]
        for i in range(len(spaces)):
            pairs = zip(kinds, found[i], strict=True)
            parts[i].append([x if kind.pattern == "shared" else _diagonal(kind, x, axes=axes) for kind, x in pairs])
            if white[i]:
                kept[i].append(np.concatenate(white[i], axis=2))
    drawn = [AxesSource(np.concatenate(k) if k else None, layout) if axes else None for k in kept]
    return tuple(_merge_parts(bank, kinds, *each, keep=keep) for each in zip(spaces, parts, drawn, strict=True))


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


def _merge_parts(
    bank: Bank,
    kinds: Sequence[ShapeGroup],
    space: ResidualSpace | PartedSpace,
    parts: Sequence[list[NormalProducts | EigenProducts]],
    drawn: AxesSource | None,
    *,
    keep: bool,
) -> ProjectedBank:
    """What all parts together show."""
    sets = space.data_sets() if isinstance(space, PartedSpace) else DataSets.of(space, space.data[None])
    every = (
        (kind, _all_parts(kind, [part[k] for part in parts], sets.size.copies, axes=drawn is not None))
        for k, kind in enumerate(kinds)
    )
    if keep:
        return KeptProducts(bank, tuple(every), tuple(range(len(bank.candidates)))).projected(sets)
    found: dict[int, CandidateFit] = {}
    for kind, products in every:
        found.update(zip(kind.which, _candidate_fits(kind, bank, products, drawn, sets), strict=True))
    fits = tuple(found[i] for i in range(len(bank.candidates)))
    return ProjectedBank(bank, fits, sets, space if drawn is not None and isinstance(space, ResidualSpace) else None)


def _diagonal(kind: ShapeGroup, products: NormalProducts, *, axes: bool) -> EigenProducts:
    """The products of a kind along their eigenvectors."""
    normal, cross, readings = products
    if kind.pattern != "own" and cross.shape[-1]:
        normal = normal - cross @ cross.swapaxes(-1, -2)
    m, E = eigenvectors(normal)
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
    kind: ShapeGroup, bank: Bank, every: EigenProducts, drawn: AxesSource | None, sets: DataSets
) -> Iterator[CandidateFit]:
    """What all parts together show of each candidate of a kind; some candidates at a time, since each has a number for
    every amplitude that is tried."""
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
    likelihood = None if scan else can.likelihood_of(u, sets)
    odds = _odds_of_groups(can, u, sets) if likelihood is None else log_mean_exp(likelihood)
    evidence = (log_mean_exp(spread_of_hits(can, u, sets, odds)) if scan else odds)[:, 0]
    retained = can if drawn is not None else can.of_readings()
    for i, which in enumerate(kind.which):
        axes = None if drawn is None or E is None else drawn.axes(bank, which, E[i] * visible[i][..., None, :])
        of_groups, known = (u[i], None) if likelihood is None else (None, likelihood[i, 0])
        yield CandidateFit(retained, i, of_groups, known, float(evidence[i]), axes)


def _odds_of_groups(can: EigenSpectrum, u: Floats, sets: DataSets) -> Floats:
    """Log odds (b, 1, U, G) of a hit of each group of scans, from u (b, 1, U, G, K); some units at a time."""
    units, each = can.m.shape[1], can.m[:, :1].size
    step = max(1, EIGENVALUES_AT_ONCE // max(each, 1))
    parts = (slice(first, first + step) for first in range(0, units, step))
    return np.concatenate([log_mean_exp(can.of_units(part).likelihoods(u[:, :, part], sets)) for part in parts], axis=2)


def _leaves_something(visible: NDArray[np.bool_], pattern: Pattern, size: SpaceSize) -> NDArray[np.bool_]:
    """The directions (b, …, K) that can be seen. None for a candidate with as many of them as there are numbers: it
    follows any readings, nothing is left to measure it by, and its evidence would be rounding."""
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
    """For each candidate, whether the largest amplitude met in practice would exceed noise (d > 1). swollen: how many
    times the noise exceeds that of the samples, perhaps because of what is yet to be found."""
    pairs = zip(projected.bank.candidates, projected.spectra, strict=True)
    return tuple(swollen * c.most / AMPLITUDE_LIMIT_FACTOR * float(np.sqrt(s.m.sum())) > 1.0 for c, s in pairs)
