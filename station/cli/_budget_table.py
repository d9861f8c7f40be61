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
    """One row a coefficient, one column a cause that contributes, the sum and what covers 95 %."""
    from rich.table import Table

    causes = [cause for cause in budget.parts if (budget.std(cause) > NEGLIGIBLE * budget.std()).any()]
    shown = Table(title=title, title_justify="left")
    shown.add_column("coefficient")
    for heading in (*causes, "together", "U (95 %)", "unit"):
        shown.add_column(heading, justify="right")
    std, expanded = budget.std(), budget.expanded()
    for i in np.flatnonzero(std > 0):
        parts = (f"{budget.std(cause)[i]:.2g}" for cause in causes)
        name, of = coefficients.NAMES[i], coefficients.unit_of(int(i), unit)
        shown.add_row(name, *parts, f"{std[i]:.2g}", f"{expanded[i]:.2g}", of)
    return shown
