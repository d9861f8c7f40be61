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
    """The location chart and the spread chart of subgroups (m, n), with 3σ limits and Nelson's rules."""
    _, n = _shape(groups)
    sigma, means = sigma_within(groups), groups.mean(axis=1)
    half = 3 * sigma / math.sqrt(n)
    kind = chart_kind(n)
    names = {"i-mr": ("individual", "moving range"), "xbar-r": ("mean", "range"), "xbar-s": ("mean", "deviation")}[kind]
    centre = float(means.mean())
    location = Chart(names[0], means, centre, centre - half, centre + half, nelson(means, centre, sigma / math.sqrt(n)))
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


def nelson(points: Floats, centre: float, sigma: float) -> tuple[tuple[int, str], ...]:
    """Nelson's eight rules (1984, J. Quality Technology 16; ISO 7870-2): the index of the point that completes a
    pattern, and the rule."""
    if sigma <= 0:
        return ()
    z = (np.asarray(points, float) - centre) / sigma
    step = np.sign(np.diff(z))
    found = [(int(i), "beyond 3σ") for i in np.flatnonzero(np.abs(z) > 3)]
    for side in (1, -1):
        found += [(i, "two of three beyond 2σ") for i in _runs(side * z > 2, 3, 2)]
        found += [(i, "four of five beyond 1σ") for i in _runs(side * z > 1, 5, 4)]
        found += [(i, "nine on a side") for i in _runs(side * z > 0, 9, 9)]
        found += [(i + 1, "six in a trend") for i in _runs(side * step > 0, 5, 5)]
    found += [(i + 2, "fourteen alternating") for i in _runs(step[1:] * step[:-1] < 0, 12, 12)]
    found += [(i, "fifteen within 1σ") for i in _runs(np.abs(z) < 1, 15, 15)]
    found += [(i, "eight beyond 1σ on both sides") for i in _runs(np.abs(z) > 1, 8, 8)]
    return tuple(sorted(set(found)))


def _runs(beyond: NDArray[np.bool_], window: int, wanted: int) -> list[int]:
    """Indices that are beyond themselves and end a window with `wanted` such points; the first windows are short."""
    count = np.convolve(beyond.astype(int), np.ones(window, int))[: len(beyond)] if len(beyond) else np.zeros(0)
    return [int(i) for i in np.flatnonzero((count >= wanted) & beyond)]


def _shape(groups: Floats) -> tuple[int, int]:
    m, n = groups.shape
    if m < 2 or n < 1:
        raise UsageError("chart-too-few-subgroups", subgroups=m)
    return m, n
