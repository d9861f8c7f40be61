"""An uncertainty budget as a table for people."""

from typing import TYPE_CHECKING

import numpy as np

from station.domain.methods import coefficients
from station.domain.methods.uncertainty import Budget

if TYPE_CHECKING:
    from rich.table import Table

#: A cause below this share of every coefficient's uncertainty gets no column.
NEGLIGIBLE = 1e-3
#: Cross-axis terms; offsets and gains are three each.
MOST_COLUMNS = 6


def table(budget: Budget, unit: str, title: str) -> "Table":
    """Offsets, gains and cross-axis one below the other: the share of u² of each cause that contributes, then u, k and
    U. Narrow enough for 80 columns."""
    from rich import box
    from rich.table import Table

    shown = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, show_header=False, padding=(0, 1))
    shown.add_column(no_wrap=True)
    for _ in range(MOST_COLUMNS):
        shown.add_column(justify="right", no_wrap=True)
    std = budget.std()
    for kind in ("offset", "gain", "cross-axis"):
        chosen = [i for i in np.flatnonzero(std > 0) if coefficients.NAMES[i].startswith(kind)]
        if chosen:
            _add_kind(shown, budget, [int(i) for i in chosen], unit)
    return shown


def _add_kind(shown: "Table", budget: Budget, chosen: list[int], unit: str) -> None:
    kind, of = coefficients.NAMES[chosen[0]].partition(" ")[0], coefficients.unit_of(chosen[0], unit)
    shown.add_row(f"{kind}, {of}", *(_short_name(coefficients.NAMES[i]) for i in chosen), style="bold")
    std, factor, expanded = budget.std(), budget.factor(), budget.expanded()
    for cause in budget.parts:
        part = budget.std(cause)
        if any(part[i] > NEGLIGIBLE * std[i] for i in chosen):
            shown.add_row(f"{cause}, % of u²", *(f"{100 * (part[i] / std[i]) ** 2:.0f}" for i in chosen))
    shown.add_row("u", *(f"{std[i]:.2g}" for i in chosen))
    shown.add_row("k", *(f"{factor[i]:.2f}" for i in chosen))
    shown.add_row("U (95 %)", *(f"{expanded[i]:.2g}" for i in chosen), end_section=True)


def _short_name(name: str) -> str:
    """`x` of `gain x`, `x←y` of `cross-axis x from y`."""
    return name.partition(" ")[2].replace(" from ", "←")
