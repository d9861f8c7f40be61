"""Every stored unit of a fleet calibrated again: one job, one row a unit, and what they come to together."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from station.domain.core.types import Outcome
from station.domain.methods import coefficients
from station.ports.fleet import Columns, ColumnType, PortionResults
from station.service.fleet import FleetPlan, FleetWork
from station.service.reduced_units import solve_again

_STDS = tuple(f"std {name}" for name in coefficients.NAMES)
#: Columns of a portion's result, one row an attempt.
COLUMNS: Mapping[str, ColumnType] = {
    **dict.fromkeys(("attempt", "serial", "outcome"), "text"),
    "reasons": "texts",
    "simulated": "integer",
    **dict.fromkeys((*coefficients.NAMES, *_STDS, "residual_rms"), "number"),
}


def calibrate_portion(work: FleetWork) -> Columns:
    """One portion, in whatever process."""
    rows, results = solve_again(work)
    columns: dict[str, list[Any]] = {name: [] for name in COLUMNS}
    for row, result in zip(rows, results, strict=True):
        found = result.calibration
        theta, std, rms = np.full(12, np.nan), np.full(12, np.nan), float("nan")
        if found is not None:
            theta = np.concatenate([found.offset, found.matrix.ravel()])
            std, rms = np.sqrt(np.diagonal(found.covariance)), found.residual_rms
        reasons = tuple(reason.sentence for reason in result.verdict.reasons)
        values = (
            row.attempt,
            row.serial,
            str(result.verdict.outcome),
            reasons,
            int(row.simulated),
            *theta.tolist(),
            *std.tolist(),
            rms,
        )
        for name, value in zip(COLUMNS, values, strict=True):
            columns[name].append(value)
    return columns


class CalibrationTotals:
    """Outcomes and coefficients of all portions, in flat memory."""

    def __init__(self) -> None:
        self.outcomes: Counter[str] = Counter()
        self.simulated = 0
        self._known, self._sums, self._squares, self._std = 0, np.zeros(12), np.zeros(12), np.zeros(12)

    def add(self, part: Columns) -> None:
        """One portion more. Sums are of deviations from nominal, so that squares lose no digits."""
        self.outcomes.update(map(str, part["outcome"]))
        self.simulated += sum(int(flag) for flag in part["simulated"])
        theta, std = (np.array([part[name] for name in names], float).T for names in (coefficients.NAMES, _STDS))
        known = np.isfinite(theta).all(axis=1)
        away = theta[known] - coefficients.NOMINAL
        self._known += int(known.sum())
        self._sums += away.sum(axis=0)
        self._squares += (away**2).sum(axis=0)
        self._std += std[known].sum(axis=0)

    def summary(self, unit: str) -> list[dict[str, Any]]:
        """Mean, spread over the units and mean standard uncertainty of each coefficient. unit: of the readings."""
        count = max(self._known, 1)
        mean = self._sums / count
        spread = np.sqrt(np.maximum(self._squares / count - mean**2, 0.0) * count / max(count - 1, 1))
        values = zip(coefficients.NAMES, mean + coefficients.NOMINAL, spread, self._std / count, strict=True)
        return [
            {"name": name, "unit": coefficients.unit_of(i, unit), "mean": float(m), "spread": float(s), "std": float(u)}
            for i, (name, m, s, u) in enumerate(values)
        ]

    def exit_outcome(self) -> str:
        """ERROR before FAIL before PASS, whichever any unit came to."""
        return next((o for o in (Outcome.ERROR, Outcome.FAIL) if self.outcomes[o]), Outcome.PASS)


def sum_calibrations(planned: FleetPlan, results: PortionResults) -> CalibrationTotals:
    """What all portions come to. Errors: StoreFault."""
    found = CalibrationTotals()
    for portion in planned.portions:
        found.add(results.read(portion.key))
    return found
