"""The least that any rule can cover where nothing scatters, and how close to 95 % it can stay at every scatter."""

import numpy as np
from metrology_rows.designs import Floats
from metrology_rows.report import Report
from scipy import sparse
from scipy.optimize import linprog
from scipy.stats import chi2, norm

#: σ of the residuals in units of the noise.
SIGMA = np.r_[1.0, np.hypot(1, np.r_[0.25:3:0.25, 3:8:0.5])]


def bound(units: int, report: Report) -> None:
    """Of rules U(χ²) that never state less than the noise: the least coverage without scatter of one that covers 95 %
    at any scatter, and the least deviation from 95 % at any scatter, none included. Linear programs over randomised
    rules, χ² and U in cells (docs/uncertainty.md)."""
    del units
    for dof, found in ((6, 0.964), (9, 0.961), (42, 0.954)):
        each, one_rule_a_cell = _covered(dof, 140, 160)
        least = _solve(each[0], -each[1:], np.full(len(each) - 1, -0.95), one_rule_a_cell)
        what = f"least coverage without scatter, {dof} degrees of freedom"
        report.show(what, 0, least, (found - 0.0005, found + 0.0005), 0.0)
    for dof, found in ((6, 0.0101), (9, 0.0082)):
        each, one_rule_a_cell = _covered(dof, 100, 110)
        # The last unknown is the deviation: coverage without scatter is no larger than .95 + it, any no smaller than
        # .95 − it.
        limits = np.vstack([np.r_[each[0], -1.0], np.column_stack([-each[1:], -np.ones(len(each) - 1)])])
        cells = sparse.hstack([one_rule_a_cell, sparse.csr_matrix((one_rule_a_cell.shape[0], 1))])
        sides = np.r_[0.95, np.full(len(each) - 1, -0.95)]
        least = _solve(np.r_[np.zeros(each.shape[1]), 1.0], limits, sides, cells)
        what = f"least deviation from .95 at any scatter, {dof} degrees of freedom"
        report.show(what, 0, least, (found - 0.0005, found + 0.0005), 0.0)


def _covered(dof: int, cells: int, widths: int) -> tuple[Floats, sparse.spmatrix]:
    """Coverage (σ, cell of χ² by U) by the probability of each, and the sums (cell, cell by U) that are to be 1."""
    edges = np.r_[0, np.geomspace(0.1, 360 * dof, cells), np.inf]
    wide = np.r_[np.geomspace(1, 40, widths) * norm.ppf(0.975), 1e9]
    cell = np.diff(chi2.cdf(edges / SIGMA[:, None] ** 2, dof), axis=1)
    covered = 2 * norm.cdf(wide / SIGMA[:, None]) - 1
    each = np.einsum("sc,su->scu", cell, covered).reshape(len(SIGMA), -1)
    return each, sparse.kron(sparse.eye(cell.shape[1]), np.ones((1, len(wide))))


def _solve(cost: Floats, limits: Floats, sides: Floats, one_rule_a_cell: sparse.spmatrix) -> float:
    found = linprog(cost, limits, sides, one_rule_a_cell, np.ones(one_rule_a_cell.shape[0]), (0, None), "highs")
    return float(found.fun)
