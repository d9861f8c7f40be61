"""An uncertainty budget as tables for people."""

from collections.abc import Iterator

import numpy as np

from station.cli._layout import TextTable
from station.domain.methods import coefficients
from station.domain.methods.uncertainty import Budget

#: A cause below this share of every coefficient's uncertainty gets no row.
NEGLIGIBLE = 1e-3


def budget_tables(budget: Budget, unit: str) -> Iterator[TextTable]:
    """Offsets, gains and cross-axis terms: the share of u² of each cause that contributes, then u, k and U."""
    std = budget.std()
    for kind in ("offset", "gain", "cross-axis"):
        chosen = [int(i) for i in np.flatnonzero(std > 0) if coefficients.NAMES[i].startswith(kind)]
        if chosen:
            yield _table(budget, kind, chosen, unit)


def _table(budget: Budget, kind: str, chosen: list[int], unit: str) -> TextTable:
    heads = (f"{kind}, {coefficients.unit_of(chosen[0], unit)}", *(_short_name(coefficients.NAMES[i]) for i in chosen))
    std, factor, expanded = budget.std(), budget.factor(), budget.expanded()
    rows = []
    for cause in budget.parts:
        part = budget.std(cause)
        if any(part[i] > NEGLIGIBLE * std[i] for i in chosen):
            rows.append((f"{cause}, % of u²", *(f"{100 * (part[i] / std[i]) ** 2:.0f}" for i in chosen)))
    rows.append(("u", *(f"{std[i]:.2g}" for i in chosen)))
    rows.append(("k", *(f"{factor[i]:.2f}" for i in chosen)))
    rows.append(("U (95 %)", *(f"{expanded[i]:.2g}" for i in chosen)))
    return TextTable(heads, rows, right=frozenset(range(1, len(heads))), indent=2)


def _short_name(name: str) -> str:
    """`x` of `gain x`, `x←y` of `cross-axis x from y`."""
    return name.partition(" ")[2].replace(" from ", "←")
