"""Measurement-system studies (AIAG MSA, 4th edition): type-1 study and gauge R&R, by ANOVA and by X̄-R."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from station.domain.core.types import Floats
from station.errors import UsageError

#: AIAG MSA 4th ed., appendix C: 1/d2 for trials (many subgroups), 1/d2* for appraisers and parts (one subgroup).
K1 = {2: 0.8862, 3: 0.5908, 4: 0.4857, 5: 0.4299}
K23 = {2: 0.7071, 3: 0.5231, 4: 0.4467, 5: 0.4030, 6: 0.3742, 7: 0.3534, 8: 0.3375, 9: 0.3249, 10: 0.3146}


#: Draws of the intervals: the ends are known to about 1 % of their width.
DRAWS, DRAW_SEED = 10_000, 20260101


@dataclass(frozen=True, slots=True)
class Type1:
    """A type-1 study: repeats of one reference. bias in the readings' unit; t, p of the bias against zero."""

    n: int
    mean: float
    s: float
    bias: float
    t: float
    p: float
    cg: float | None
    cgk: float
    resolution_share: float | None


@dataclass(frozen=True, slots=True)
class GaugeStudy:
    """Standard deviations of a crossed study and what follows: %GRR of total variation and of tolerance, ndc.

    intervals: of grr, part, percent_grr, percent_tolerance and ndc, 95 %, by analysis of variance.
    """

    method: str
    repeatability: float
    reproducibility: float
    interaction: float
    grr: float
    part: float
    total: float
    percent_grr: float
    percent_tolerance: float | None
    ndc: int
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def judgement(self) -> str:
        """AIAG's words: below 10 % acceptable, 10–30 % conditional, above not acceptable."""
        return "acceptable" if self.percent_grr < 10 else "conditional" if self.percent_grr <= 30 else "not acceptable"


def type1(
    readings: Floats,
    reference: float,
    tolerance: float,
    *,
    k_percent: float = 20,
    spread: float = 6,
    resolution: float = 0,
) -> Type1:
    """Type-1 study of repeats (n) against a reference; tolerance is the full width T.

    Cg = (K/100·T)/(L·s); Cgk = (K/200·T − |x̄ − x_ref|)/(L/2·s); K and L are k_percent and spread.
    """
    x = np.asarray(readings, float)
    if len(x) < 2 or tolerance <= 0:
        raise UsageError("type-1-too-few", readings=len(x))
    n, mean, s = len(x), float(x.mean()), float(x.std(ddof=1))
    bias = mean - reference
    if s == 0:
        raise UsageError("type-1-all-equal")
    t = bias / (s / math.sqrt(n))
    return Type1(
        n=n,
        mean=mean,
        s=s,
        bias=bias,
        t=t,
        p=float(2 * scipy.special.stdtr(n - 1, -abs(t))),
        cg=k_percent / 100 * tolerance / (spread * s),
        cgk=(k_percent / 200 * tolerance - abs(bias)) / (spread / 2 * s),
        resolution_share=resolution / tolerance if resolution else None,
    )


def anova(readings: Floats, tolerance: float | None = None) -> GaugeStudy:
    """Crossed gauge R&R by ANOVA of readings (parts, appraisers, trials); random effects, method of moments.

    An interaction with p > 0.25 is pooled into repeatability, as AIAG does.
    """
    x = _crossed(readings)
    p, a, r = x.shape
    grand, part_means, appraiser_means, cell = x.mean(), x.mean((1, 2)), x.mean((0, 2)), x.mean(2)
    ss_part = a * r * float(((part_means - grand) ** 2).sum())
    ss_appraiser = p * r * float(((appraiser_means - grand) ** 2).sum())
    ss_cell = r * float(((cell - grand) ** 2).sum())
    ss_interaction, ss_error = ss_cell - ss_part - ss_appraiser, float(((x - cell[..., None]) ** 2).sum())
    df_interaction, df_error = (p - 1) * (a - 1), p * a * (r - 1)
    ms_error = ss_error / df_error
    ms_interaction = ss_interaction / df_interaction
    pooled = ms_error == 0 or float(scipy.special.fdtrc(df_interaction, df_error, ms_interaction / ms_error)) > 0.25
    if pooled:
        ms_error = ms_interaction = (ss_error + ss_interaction) / (df_error + df_interaction)
    study = _summary(
        "anova",
        repeatability=ms_error,
        appraiser=max(0.0, (ss_appraiser / (a - 1) - ms_interaction) / (p * r)),
        interaction=max(0.0, (ms_interaction - ms_error) / r),
        part=max(0.0, (ss_part / (p - 1) - ms_interaction) / (a * r)),
        tolerance=tolerance,
    )
    freedom = (p - 1, a - 1, df_interaction, df_error)
    squares = (ss_part, ss_appraiser, ss_interaction, ss_error)
    return replace(study, intervals=_intervals((p, a, r), freedom, squares, tolerance))


def _intervals(
    sizes: tuple[int, int, int],
    freedom: tuple[int, ...],
    squares: tuple[float, ...],
    tolerance: float | None,
) -> dict[str, tuple[float, float]]:
    """95 % intervals by generalised pivots: each sum of squares over a χ² of its degrees of freedom is what its mean
    square may be (Hamada & Weerahandi 2000, J. Quality Technology 32). GRR is a sum of mean squares with positive
    weights (Burdick, Borror & Montgomery 2003, J. Quality Technology 35): cut at 0 one by one, effects that are not
    there would push its interval up. Its ends are the mean of those by pivots and by `_large_sample`. Seeded, so that
    one study has one answer."""
    p, a, r = sizes
    rng = np.random.default_rng(DRAW_SEED)
    part, appraiser, interaction, error = (
        ss / rng.chisquare(dof, DRAWS) for ss, dof in zip(squares, freedom, strict=True)
    )
    grr2 = error * (1 - 1 / r) + interaction * (1 - 1 / p) / r + appraiser / (p * r)
    part2 = np.maximum(part - interaction, 0.0) / (a * r)
    grr, pv = np.sqrt(grr2), np.sqrt(part2)
    found = {"grr": grr, "part": pv, "percent_grr": 100 * grr / np.sqrt(grr2 + part2), "ndc": 1.41 * pv / grr}
    ends = {name: (float(np.quantile(v, 0.025)), float(np.quantile(v, 0.975))) for name, v in found.items()}
    weights = np.array([1 / (p * r), (1 - 1 / p) / r, 1 - 1 / r])
    low, high = _large_sample(weights * np.array(squares[1:]) / freedom[1:], np.array(freedom[1:]))
    # Pivots alone cover a little less than 95 % with two appraisers, large samples a little more.
    ends["grr"] = math.sqrt((ends["grr"][0] ** 2 + low) / 2), math.sqrt((ends["grr"][1] ** 2 + high) / 2)
    if tolerance is not None:
        ends["percent_tolerance"] = 600 * ends["grr"][0] / tolerance, 600 * ends["grr"][1] / tolerance
    return ends


def _large_sample(parts: Floats, dof: Floats) -> tuple[float, float]:
    """95 % interval of a sum of mean squares with positive weights (n), dof (n) degrees of freedom each: the modified
    large-sample method (Graybill & Wang 1980, J. Am. Stat. Assoc. 75, 869)."""
    below = 1 - dof / scipy.special.chdtri(dof, 0.025)
    above = dof / scipy.special.chdtri(dof, 0.975) - 1
    total = float(parts.sum())
    return total - math.hypot(*(below * parts)), total + math.hypot(*(above * parts))


def xbar_r(readings: Floats, tolerance: float | None = None) -> GaugeStudy:
    """Crossed gauge R&R by average and range (AIAG MSA 4th ed., figure III-B 16) of (parts, appraisers, trials)."""
    x = _crossed(readings)
    p, a, r = x.shape
    for count, table, what in ((r, K1, "trials"), (a, K23, "appraisers"), (p, K23, "parts")):
        if count not in table:
            raise UsageError(f"gauge-xbar-r-{what}", least=min(table), most=max(table), count=count)
    ev = float(np.ptp(x, axis=2).mean()) * K1[r]
    difference = float(np.ptp(x.mean((0, 2)))) * K23[a]
    av2 = max(0.0, difference**2 - ev**2 / (p * r))
    pv = float(np.ptp(x.mean((1, 2)))) * K23[p]
    return _summary("xbar-r", repeatability=ev**2, appraiser=av2, interaction=0.0, part=pv**2, tolerance=tolerance)


def _crossed(readings: Floats) -> Floats:
    x = np.asarray(readings, float)
    if x.ndim != 3 or min(x.shape) < 2:
        raise UsageError("gauge-too-few", shape=" × ".join(map(str, x.shape)))
    return x


def _summary(
    method: str, *, repeatability: float, appraiser: float, interaction: float, part: float, tolerance: float | None
) -> GaugeStudy:
    grr2 = repeatability + appraiser + interaction
    total = math.sqrt(grr2 + part)
    if total == 0:
        raise UsageError("gauge-all-equal")
    grr, pv = math.sqrt(grr2), math.sqrt(part)
    return GaugeStudy(
        method=method,
        repeatability=math.sqrt(repeatability),
        reproducibility=math.sqrt(appraiser),
        interaction=math.sqrt(interaction),
        grr=grr,
        part=pv,
        total=total,
        percent_grr=100 * grr / total,
        percent_tolerance=None if tolerance is None else 100 * 6 * grr / tolerance,
        ndc=max(1, int(1.41 * pv / grr)) if grr > 0 else 99,
    )
