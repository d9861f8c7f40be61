"""Sufficient statistics of units that share station, nest and lot: all that a search for shared causes needs of them.

With whitened response z and the columns K of causes that go with a covariate, per unit: Σ z, Σ Kᵀz, Σ K, Σ KᵀK. Causes
without a covariate have the same columns in every unit, so that their Gram matrix is the number of units times one.
Sums over units are sums over portions: memory follows the cells, not the units.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from station.domain.core.types import Floats


@dataclass(frozen=True, slots=True)
class FleetCell:
    """What the units of a cell have in common."""

    station: str
    nest: str
    lot: str


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Of cells (c): units (c); z (c, r); cross (c, r, k): Σ K; kz (c, k); kk (c, k, k)."""

    cells: tuple[FleetCell, ...]
    units: Floats
    z: Floats
    cross: Floats
    kz: Floats
    kk: Floats

    @staticmethod
    def of(cells: Sequence[FleetCell], z: Floats, columns: Floats) -> "Moments":
        """Of units (U), each with its cell; z (U, r); columns (U, r, k)."""
        names = tuple(dict.fromkeys(cells))
        place = {name: i for i, name in enumerate(names)}
        of_cell = np.zeros((len(names), len(cells)))
        of_cell[[place[cell] for cell in cells], np.arange(len(cells))] = 1.0
        kz = np.einsum("urk,ur->uk", columns, z)
        kk = np.einsum("urk,url->ukl", columns, columns)
        sums = (np.tensordot(of_cell, part, axes=1) for part in (z, columns, kz, kk))
        return Moments(names, of_cell.sum(axis=1), *sums)

    @staticmethod
    def join(parts: Iterable["Moments"]) -> "Moments":
        """Of all portions, cell by cell, in the order in which they come."""
        sums: dict[FleetCell, list[Floats]] = {}
        for part in parts:
            for i, cell in enumerate(part.cells):
                own = [part.units[i : i + 1], part.z[i], part.cross[i], part.kz[i], part.kk[i]]
                known = sums.get(cell)
                sums[cell] = own if known is None else [a + b for a, b in zip(known, own, strict=True)]
        names = tuple(sorted(sums, key=lambda cell: (cell.station, cell.nest, cell.lot)))
        units, *rest = (np.stack([sums[name][n] for name in names]) for n in range(5))
        return Moments(names, units[:, 0], *rest)
