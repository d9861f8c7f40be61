"""Covariates that these data do not separate: a temperature that only rises in a run is as good as time."""

import numpy as np

from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Array, Floats

#: Degree of the curve of one covariate that another may be, the share of its squares that the curve may leave, and the
#: visits a unit that it takes to see one.
DEGREE, MOST_LEFT, LEAST_VISITS = 3, 0.02, 8


def with_confounded(words: tuple[str, ...], view: ResidualView) -> tuple[str, ...]:
    """Covariates of `unknown.depends_on`, followed by those that are merely a curve of one of them in each unit."""
    T, time = view.scene.temperature_degC, view.scene.time_s
    if T is None:
        return words
    covariates, unit = {"time": time, "temperature": T}, view.scene.visits.unit.code
    more = [
        other
        for one, other in (("time", "temperature"), ("temperature", "time"))
        if one in words and _is_curve_of(covariates[one], covariates[other], unit)
    ]
    return tuple(dict.fromkeys((*words, *more)))


def _is_curve_of(x: Floats, y: Floats, unit: Array) -> bool:
    """Whether y (v) is one curve of x (v) in each unit."""
    return all(_follows(x[unit == u], y[unit == u]) for u in np.unique(unit))


def _follows(x: Floats, y: Floats) -> bool:
    if len(x) < LEAST_VISITS or not np.ptp(x) or not np.ptp(y):
        return False
    columns = np.vander((x - x.mean()) / np.ptp(x), DEGREE + 1)
    left = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return bool(np.sum(left**2) <= MOST_LEFT * np.sum((y - y.mean()) ** 2))
