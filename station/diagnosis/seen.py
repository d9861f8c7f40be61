"""The bank in a space: what each candidate can show there, and how well it explains the readings.

A fleet is gone through some units at a time. Of a unit's white columns Z only the small products are kept that the
evidence needs: the normal matrix ZᵀZ, and ZᵀC and Zᵀr with the known columns and the readings.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from station.diagnosis.bank import THINKABLE, Bank, Candidate
from station.diagnosis.evidence import Sets, Spectrum, log_mean, seen_of, spectrum
from station.diagnosis.grid import Layout
from station.diagnosis.space import Space
from station.domain.types import Array, Floats

#: Units whose columns are in memory at once.
PART = 8


class Found(NamedTuple):
    """What a space shows of one candidate: u (1, …) of the readings, L (ρ) of the readings, of a scan that of each
    group (…, ρ), the log evidence; and ZE (U, M, K) in single precision, where asked for."""

    spectrum: Spectrum
    components: Floats
    likelihood: Floats
    evidence: float
    axes: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A bank as a space sees it, found of each candidate, and the readings as a data set."""

    bank: Bank
    space: Space
    found: tuple[Found, ...]
    readings: Sets

    @property
    def spectra(self) -> tuple[Spectrum, ...]:
        """What each candidate can show."""
        return tuple(f.spectrum for f in self.found)

    @property
    def evidence(self) -> Floats:
        """Log evidence (candidates) of the readings."""
        return np.array([f.evidence for f in self.found])

    def only(self, kept: Sequence[bool]) -> "Seen":
        """The same with some of the candidates."""
        chosen = [i for i, k in enumerate(kept) if k]
        return Seen(self.bank.only(chosen), self.space, tuple(self.found[i] for i in chosen), self.readings)


class Products(NamedTuple):
    """Of some units' columns Z: normal ZᵀZ (…, K, K), cross ZᵀC (…, K, c), readings Zᵀr (…, K)."""

    normal: Floats
    cross: Floats
    readings: Floats


def columns_of(bank: Bank, layout: Layout, space: Space, count: int = PART) -> Iterator[tuple[slice, Floats]]:
    """So many units after others, and the white columns (U, M, C) of the whole bank for them."""
    if bank.candidates:
        for units in layout.grid.parts(count):
            yield units, space.see(bank.rows(layout, units), units)


def see(bank: Bank, layout: Layout, space: Space, *, axes: bool = False) -> Seen:
    """The bank in a space; with the axes, which the drawing of null data needs, or without."""
    parts: list[list[Products]] = [[] for _ in bank.candidates]
    kept: list[list[Array]] = [[] for _ in bank.candidates]
    for units, columns in columns_of(bank, layout, space):
        Z = columns.transpose(0, 2, 1)
        cross, readings = Z @ space.border[units], (Z @ space.data[units, :, None])[..., 0]
        for i, (c, groups, at) in enumerate(zip(bank.candidates, bank.groups, bank.place, strict=True)):
            normal = _normal(columns[..., at], groups, c)
            shape = (*normal.shape[:-1], -1)
            parts[i].append(
                Products(normal, cross[:, at].reshape(shape), readings[:, at].reshape(normal.shape[:-1]))
                if c.pattern != "shared"
                else Products(normal.sum(0), cross[:, at].sum(0), readings[:, at].sum(0))
            )
            if axes:
                kept[i].append(columns[..., at].astype(np.float32))
    sets = Sets.of(space, space.data[None])
    found = (_found(c, parts[i], kept[i], space, sets) for i, c in enumerate(bank.candidates))
    return Seen(bank, space, tuple(found), sets)


def _normal(columns: Floats, groups: int, candidate: Candidate) -> Floats:
    """ZᵀZ of columns (U, M, K): (U, K, K), or of each group (U, G, a, a) of a scan."""
    if candidate.pattern != "scan":
        return np.asarray(columns.transpose(0, 2, 1) @ columns)
    U, M, _ = columns.shape
    split = columns.reshape(U, M, groups, -1).transpose(0, 2, 3, 1)
    return np.asarray(split @ split.swapaxes(-1, -2))


def _found(c: Candidate, parts: list[Products], kept: list[Array], space: Space, sets: Sets) -> Found:
    """What all parts together show."""
    if c.pattern == "shared":
        normal, cross, readings = (space.copies * np.sum(x, axis=0) for x in zip(*parts, strict=True))
        readings = readings / space.copies
    else:
        normal, cross, readings = (np.concatenate(x) for x in zip(*parts, strict=True))
    if c.pattern != "own" and cross.shape[-1]:
        normal = normal - cross @ cross.swapaxes(-1, -2)
    m, E = np.linalg.eigh(normal)
    seen = seen_of(m)
    E = E * seen[..., None, :]
    turn = E.swapaxes(-1, -2)
    can = spectrum(space, np.where(seen, m, 0.0), turn @ cross, c.pattern, c.most)
    u = can.components((turn @ readings[..., None])[..., 0][None], sets)
    likelihood = can.likelihoods(u, sets) if c.pattern == "scan" else can.likelihood(can.terms(u, sets), sets)
    evidence = can.spread(likelihood) if c.pattern == "scan" else likelihood
    axes = _turned(np.concatenate(kept), E) if kept else None
    return Found(can if kept else can.bare(), u, likelihood[0], float(log_mean(evidence)[0]), axes)


def _turned(columns: Array, E: Floats) -> Array:
    """Columns (U, M, K) along the eigenvectors (K, K), (U, K, K), or (U, G, a, a) of groups of them."""
    if E.ndim < 4:
        return columns @ E.astype(np.float32)
    U, M, K = columns.shape
    split = columns.reshape(U, M, E.shape[1], -1).transpose(0, 2, 1, 3) @ E.astype(np.float32)
    return split.transpose(0, 2, 1, 3).reshape(U, M, K)


def visible(seen: Seen, swollen: float) -> tuple[bool, ...]:
    """Of each candidate, whether the largest amplitude met in practice would leave more than noise (d > 1).

    swollen: how many times the noise is larger than the samples' own, perhaps by what is yet to be found.
    """
    pairs = zip(seen.bank.candidates, seen.spectra, strict=True)
    return tuple(swollen * c.most / THINKABLE * float(np.sqrt(s.m.sum())) > 1.0 for c, s in pairs)
