"""Control charts and capability (AIAG SPC, 2nd edition): formulas that an auditor can check by hand."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.errors import UsageError

#: Mean and standard deviation of the range of n normal values, in σ (AIAG SPC, appendix E), n = 2 … 10.
D2 = {2: 1.128, 3: 1.693, 4: 2.059, 5: 2.326, 6: 2.534, 7: 2.704, 8: 2.847, 9: 2.970, 10: 3.078}
D3 = {2: 0.853, 3: 0.888, 4: 0.880, 5: 0.864, 6: 0.848, 7: 0.833, 8: 0.820, 9: 0.808, 10: 0.797}

ChartKind = Literal["xbar-r", "xbar-s", "i-mr"]


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """One control chart: its points, centre line and limits, and the points out of control with the rule."""

    name: str
    points: Floats
    centre: float
    lower: float
    upper: float
    alarms: tuple[tuple[int, str], ...]


@dataclass(frozen=True, slots=True)
class Capability:
    """Capability with 95 % confidence intervals; a one-sided limit gives no Cp and no Pp."""

    n: int
    mean: float
    sigma_within: float
    sigma_overall: float
    cp: tuple[float, float, float] | None
    cpk: tuple[float, float, float]
    pp: tuple[float, float, float] | None
    ppk: tuple[float, float, float]


def c4(n: int) -> float:
    """E[s]/σ of n normal values."""
    return math.sqrt(2 / (n - 1)) * math.exp(math.lgamma(n / 2) - math.lgamma((n - 1) / 2))


def chart_kind(size: int) -> ChartKind:
    """Which pair of charts suits a subgroup size: I-MR for single values, X̄-R for 2–9, X̄-s from 10 on."""
    return "i-mr" if size == 1 else "xbar-r" if size < 10 else "xbar-s"


def sigma_within(groups: Floats) -> float:
    """σ within subgroups (m, n): R̄/d2 for n of 2–9, s̄/c4 from 10 on, mean moving range/1.128 for n = 1."""
    _, n = _shape(groups)
    kind = chart_kind(n)
    if kind == "i-mr":
        return float(np.mean(np.abs(np.diff(groups[:, 0])))) / D2[2]
    if kind == "xbar-r":
        return float(np.mean(np.ptp(groups, axis=1))) / D2[n]
    return float(np.mean(np.std(groups, axis=1, ddof=1))) / c4(n)


def charts(groups: Floats) -> tuple[Chart, Chart]:
    """The location chart and the spread chart of subgroups (m, n), with 3σ limits and Western Electric rules."""
    _, n = _shape(groups)
    sigma, means = sigma_within(groups), groups.mean(axis=1)
    half = 3 * sigma / math.sqrt(n)
    kind = chart_kind(n)
    names = {"i-mr": ("individual", "moving range"), "xbar-r": ("mean", "range"), "xbar-s": ("mean", "deviation")}[kind]
    centre = float(means.mean())
    location = Chart(
        names[0], means, centre, centre - half, centre + half, western_electric(means, centre, sigma / math.sqrt(n))
    )
    return location, _spread(groups, kind, sigma, names[1])


def _spread(groups: Floats, kind: ChartKind, sigma: float, name: str) -> Chart:
    n = groups.shape[1]
    if kind == "i-mr":
        points, centre, deviation = np.abs(np.diff(groups[:, 0])), D2[2] * sigma, D3[2] * sigma
    elif kind == "xbar-r":
        points, centre, deviation = np.ptp(groups, axis=1), D2[n] * sigma, D3[n] * sigma
    else:
        points = np.std(groups, axis=1, ddof=1)
        centre, deviation = c4(n) * sigma, math.sqrt(1 - c4(n) ** 2) * sigma
    lower, upper = max(0.0, centre - 3 * deviation), centre + 3 * deviation
    out = tuple((int(i), "beyond 3σ") for i in np.flatnonzero((points > upper) | (points < lower)))
    return Chart(name, points, centre, lower, upper, out)


def western_electric(points: Floats, centre: float, sigma: float) -> tuple[tuple[int, str], ...]:
    """Western Electric rules 1–4 on points (m): the index of the point that completes a pattern, and the rule."""
    if sigma <= 0:
        return ()
    z = (np.asarray(points, float) - centre) / sigma
    found = [(int(i), "beyond 3σ") for i in np.flatnonzero(np.abs(z) > 3)]
    rules = (
        (3, 2, 2.0, "two of three beyond 2σ"),
        (5, 4, 1.0, "four of five beyond 1σ"),
        (8, 8, 0.0, "eight on a side"),
    )
    for window, wanted, level, name in rules:
        for side in (1, -1):
            found += [(int(i), name) for i in _runs(side * z > level, window, wanted)]
    return tuple(sorted(set(found)))


def _runs(beyond: NDArray[np.bool_], window: int, wanted: int) -> NDArray[np.int64]:
    """Indices that are beyond themselves and end a window with `wanted` such points."""
    if len(beyond) < window:
        return np.zeros(0, np.int64)
    count = np.convolve(beyond.astype(int), np.ones(window, int))[window - 1 : len(beyond)]
    ends = np.arange(window - 1, len(beyond))
    return ends[(count >= wanted) & beyond[ends]]


def capability(groups: Floats, lower: float | None, upper: float | None) -> Capability:
    """Cp, Cpk from σ within and Pp, Ppk from σ overall of subgroups (m, n), each with a 95 % interval.

    Intervals: χ² for Cp and Pp, Bissell's normal approximation for Cpk and Ppk (Montgomery, SQC 7th ed.,
    eq. 8.20 and 8.21). UsageError when neither limit is given or the data do not vary.
    """
    _shape(groups)
    values = groups.ravel()
    within, overall = sigma_within(groups), float(np.std(values, ddof=1))
    if lower is None and upper is None:
        raise UsageError("capability needs a lower or an upper limit")
    if within <= 0 or overall <= 0:
        raise UsageError("capability needs values that vary; these are all the same")
    mean, n = float(values.mean()), len(values)
    room = min(x for x in ((upper - mean) if upper is not None else math.inf,
                           (mean - lower) if lower is not None else math.inf))  # fmt: skip
    both = None if lower is None or upper is None else (upper - lower) / 6
    return Capability(
        n,
        mean,
        within,
        overall,
        None if both is None else _chi_interval(both / within, n),
        _bissell(room / (3 * within), n),
        None if both is None else _chi_interval(both / overall, n),
        _bissell(room / (3 * overall), n),
    )


def _chi_interval(index: float, n: int) -> tuple[float, float, float]:
    from scipy.stats import chi2

    low, high = chi2.ppf([0.025, 0.975], n - 1)
    return index, index * math.sqrt(low / (n - 1)), index * math.sqrt(high / (n - 1))


def _bissell(index: float, n: int) -> tuple[float, float, float]:
    half = 1.959964 * math.sqrt(1 / (9 * n) + index**2 / (2 * (n - 1)))
    return index, index - half, index + half


def _shape(groups: Floats) -> tuple[int, int]:
    m, n = groups.shape
    if m < 2 or n < 1:
        raise UsageError(f"a control chart needs at least two subgroups; there are {m}")
    return m, n
