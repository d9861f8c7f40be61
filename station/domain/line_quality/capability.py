"""Process capability with intervals that hold (ISO 22514-2): right degrees of freedom, normality, percentiles."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from station.domain.core.types import Floats
from station.domain.line_quality import spc
from station.errors import UsageError

#: Of a normal test: below this p the percentile method is the one to read.
NORMALITY = 0.05
#: Shares of a process between which it is said to lie (± 3σ of a normal one).
LOW_SHARE, HIGH_SHARE = 0.00135, 0.99865
Index = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Capability:
    """Capability with 95 % confidence intervals; a one-sided limit gives no Cp and no Pp.

    dof_within: degrees of freedom of σ within; normality: p of Anderson and Darling's test of all values; percentile:
    Ppk by the percentiles of a fitted lognormal with an origin, as a skew process needs; None where values are normal.
    """

    n: int
    mean: float
    sigma_within: float
    sigma_overall: float
    cp: Index | None
    cpk: Index
    pp: Index | None
    ppk: Index
    dof_within: float
    normality: float
    percentile: float | None


def capability(groups: Floats, lower: float | None, upper: float | None) -> Capability:
    """Cp, Cpk from σ within and Pp, Ppk from σ overall of subgroups (m, n), each with a 95 % interval.

    σ is known as χ with the degrees of freedom that its estimator has (Patnaik 1950, Biometrika 37): Cp and Pp follow
    by χ², Cpk and Ppk by the noncentral t of the nearer limit. UsageError when neither limit is given or the data do
    not vary.
    """
    values = groups.ravel()
    within, overall = spc.sigma_within(groups), float(np.std(values, ddof=1))
    if lower is None and upper is None:
        raise UsageError("capability-without-limit")
    if within <= 0 or overall <= 0:
        raise UsageError("capability-without-variation")
    mean, n = float(values.mean()), len(values)
    room = min((upper - mean) if upper is not None else math.inf, (mean - lower) if lower is not None else math.inf)
    spread = dof_of_sigma(groups)
    dof = dof_of_spread(spread)
    p = normality(values)
    both = None if lower is None or upper is None else (upper - lower) / 6
    # Unbiased estimates of σ are larger than χ's by this.
    shrink = math.sqrt(1 + spread)
    return Capability(
        n=n,
        mean=mean,
        sigma_within=within,
        sigma_overall=overall,
        cp=None if both is None else _of_width(both / within, dof, shrink),
        cpk=_of_room(room / (3 * within), n, dof, shrink),
        pp=None if both is None else _of_width(both / overall, n - 1, 1.0),
        ppk=_of_room(room / (3 * overall), n, n - 1, 1.0),
        dof_within=dof,
        normality=p,
        percentile=None if p >= NORMALITY else _by_percentiles(values, lower, upper),
    )


def dof_of_sigma(groups: Floats) -> float:
    """Squared coefficient of variation of the estimate of σ within subgroups (m, n)."""
    m, n = int(groups.shape[0]), int(groups.shape[1])
    kind = spc.chart_kind(n)
    if kind == "i-mr":
        # Neighbouring ranges share a value: Var |x₂ − x₁| and the covariance of neighbours, in σ².
        own, shared, count = 2 * (1 - 2 / math.pi), 4 / math.pi * (math.sqrt(0.75) + math.asin(0.5) / 2 - 1), m - 1
        return float(count * own + 2 * (count - 1) * shared) / count**2 / spc.D2[2] ** 2
    if kind == "xbar-r":
        return (spc.D3[n] / spc.D2[n]) ** 2 / m
    return (1 / spc.c4(n) ** 2 - 1) / m


def dof_of_spread(square: float) -> float:
    """Degrees of freedom of the χ that has this squared coefficient of variation (Patnaik 1950)."""
    return 1 / (2 * (math.sqrt(1 + 2 * square) - 1)) + 0.25 if square > 0 else math.inf


def normality(values: Floats) -> float:
    """p of Anderson and Darling's test, mean and σ estimated (D'Agostino & Stephens 1986, table 4.9)."""
    x = np.sort((values - values.mean()) / values.std(ddof=1))
    n: int = len(x)
    i = np.arange(1, n + 1)
    log = scipy.special.log_ndtr(x) + scipy.special.log_ndtr(-x[::-1])
    a = (-n - float(((2 * i - 1) * log).sum()) / n) * (1 + 0.75 / n + 2.25 / n**2)
    if a < 0.2:
        return float(1 - math.exp(-13.436 + 101.14 * a - 223.73 * a**2))
    if a < 0.34:
        return float(1 - math.exp(-8.318 + 42.796 * a - 59.938 * a**2))
    if a < 0.6:
        return math.exp(0.9177 - 4.279 * a - 1.38 * a**2)
    return math.exp(max(1.2937 - 5.709 * a + 0.0186 * a**2, -700.0)) if a < 150 else 0.0


def _of_width(index: float, dof: float, shrink: float) -> Index:
    low, high = np.sqrt(scipy.special.chdtri(dof, [0.975, 0.025]) / dof) * shrink * index
    return index, float(low), float(high)


def _of_room(index: float, n: int, dof: float, shrink: float) -> Index:
    t, root = 3 * math.sqrt(n) * index * shrink, 3 * math.sqrt(n)
    low, high = (float(scipy.special.nctdtrinc(dof, p, t)) / root for p in (0.975, 0.025))
    return index, low, high


def _by_percentiles(values: Floats, lower: float | None, upper: float | None) -> float:
    """Ppk between the percentiles of a lognormal with an origin (ISO 22514-2, 6.2.3), mirrored where it leans left."""
    side = 1.0 if float(((values - values.mean()) ** 3).mean()) >= 0 else -1.0
    x = np.sort(side * values)
    width = float(x[-1] - x[0])
    origins = x[0] - width * np.geomspace(1e-3, 1e2, 200)
    logs = np.log(x - origins[:, None])
    likelihood = -len(x) * np.log(logs.std(axis=1)) - logs.sum(axis=1)
    best = int(np.argmax(likelihood))
    at = scipy.special.ndtri(np.array([LOW_SHARE, 0.5, HIGH_SHARE]))
    found = side * (origins[best] + np.exp(logs[best].mean() + logs[best].std(ddof=1) * at))
    low, middle, high = (float(v) for v in np.sort(found))
    rooms = [] if upper is None else [(upper - middle) / (high - middle)]
    rooms += [] if lower is None else [(middle - lower) / (middle - low)]
    return min(rooms)
