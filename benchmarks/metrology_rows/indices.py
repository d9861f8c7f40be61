"""Intervals of capability and of gauge studies."""

import numpy as np
from metrology_rows.bench import NARROW
from metrology_rows.report import Report

from station.domain.line_quality import capability, msa


def indices(units: int, report: Report) -> None:
    """Intervals of capability and of gauge R&R, against the truth that made the values; studies are four times as many
    as units, because one of them is one figure."""
    rng, units = report.generator(100), 4 * units
    for size in (1, 2, 5, 10):
        found = [capability.capability(rng.normal(size=(60 // size + 2, size)), -3, 6) for _ in range(units)]
        cp = float(np.mean([c.cp is not None and c.cp[1] <= 1.5 <= c.cp[2] for c in found]))
        cpk = float(np.mean([c.cpk[1] <= 1.0 <= c.cpk[2] for c in found]))
        spread = 2 * (0.0475 / units) ** 0.5
        report.show(f"Cp, subgroups of {size}", 100, cp, NARROW, spread)
        report.show(f"Cpk, subgroups of {size}", 100, cpk, NARROW, spread)
    for size, of_people, what in ((3, 0.15, "3 appraisers"), (2, 0.0, "2 appraisers alike")):
        inside = []
        for _ in range(units):
            people = of_people * rng.normal(size=(1, size, 1))
            study = msa.anova(rng.normal(size=(10, 1, 1)) + people + 0.2 * rng.normal(size=(10, size, 3)))
            low, high = study.intervals["grr"]
            inside.append(low <= np.hypot(0.2, of_people) <= high)
        spread = 2 * (0.0475 / units) ** 0.5
        report.show(f"GRR, 10 parts, {what}, 3 trials", 100, float(np.mean(inside)), NARROW, spread)
