"""An uncertainty budget as a table for people."""

from typing import TYPE_CHECKING

import numpy as np

from station.domain.methods import coefficients
from station.domain.methods.uncertainty import Budget

if TYPE_CHECKING:
    from rich.table import Table

#: A cause below this share of every coefficient's uncertainty gets no column.
NEGLIGIBLE = 1e-3


def table(budget: Budget, unit: str, title: str) -> "Table":
    """One row a coefficient: share of u² by cause, in percent, for causes that contribute, then u, k and U."""
    from rich.table import Table

    causes = [cause for cause in budget.parts if (budget.std(cause) > NEGLIGIBLE * budget.std()).any()]
    shown = Table(title=title, title_justify="left")
    shown.add_column("coefficient")
    for heading in (*(f"{cause} %" for cause in causes), "u", "k", "U (95 %)", "unit"):
        shown.add_column(heading, justify="right")
    std, factor, expanded = budget.std(), budget.factor(), budget.expanded()
    for i in np.flatnonzero(std > 0):
        parts = (f"{100 * (budget.std(cause)[i] / std[i]) ** 2:.0f}" for cause in causes)
        name, of = coefficients.NAMES[i], coefficients.unit_of(int(i), unit)
        shown.add_row(name, *parts, f"{std[i]:.2g}", f"{factor[i]:.2f}", f"{expanded[i]:.2g}", of)
    return shown
