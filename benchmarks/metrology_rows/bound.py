"""The least that any rule can cover where nothing scatters."""

import numpy as np
from metrology_rows.report import Report
from scipy import sparse
from scipy.optimize import linprog
from scipy.stats import chi2, norm


def bound(units: int, report: Report) -> None:
    """The least coverage without scatter of any rule U(χ²) that never states less than the noise and covers 95 % at any
    scatter: a linear program over randomised rules, χ² and U in cells (docs/uncertainty.md)."""
    del units
    for dof, found in ((6, 0.964), (9, 0.961), (42, 0.954)):
        report.show(
            f"least coverage without scatter, {dof} degrees of freedom",
            0,
            least_coverage(dof),
            (found - 0.0005, found + 0.0005),
            0.0,
        )


def least_coverage(dof: int) -> float:
    """σ of the residuals in units of the noise from 1 to 8; probabilities x[cell of χ², U] are what is sought."""
    sigma = np.r_[1.0, np.hypot(1, np.r_[0.25:3:0.25, 3:8:0.5])]
    edges = np.r_[0, np.geomspace(0.1, 360 * dof, 140), np.inf]
    wide = np.r_[np.geomspace(1, 40, 160) * norm.ppf(0.975), 1e9]
    cell = np.diff(chi2.cdf(edges / sigma[:, None] ** 2, dof), axis=1)
    covered = 2 * norm.cdf(wide / sigma[:, None]) - 1
    each = np.einsum("sc,su->scu", cell, covered).reshape(len(sigma), -1)
    one_rule_a_cell = sparse.kron(sparse.eye(cell.shape[1]), np.ones((1, len(wide))))
    found = linprog(
        each[0], -each[1:], np.full(len(sigma) - 1, -0.95), one_rule_a_cell, np.ones(cell.shape[1]), (0, None), "highs"
    )
    return float(found.fun)
