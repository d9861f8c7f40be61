"""Bias and linearity of a measurement system against references (AIAG MSA, 4th edition, chapter III, section B)."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from station.domain.core.types import Floats
from station.errors import UsageError

#: Chance alone makes a difference this rarely.
LEVEL = 0.05


@dataclass(frozen=True, slots=True)
class Bias:
    """Mean difference of n readings of one reference from its value, with its 95 % half-width; t and p against none."""

    n: int
    mean: float
    s: float
    bias: float
    half: float
    t: float
    p: float

    @property
    def judgement(self) -> str:
        """Whether zero lies in the interval."""
        return "no bias evident" if self.p >= LEVEL else "biased"


@dataclass(frozen=True, slots=True)
class FittedBias:
    """Bias at one reference by the line, with the 95 % half-width of the line there, and the mean of its readings."""

    reference: float
    mean: float
    fitted: float
    half: float


@dataclass(frozen=True, slots=True)
class Linearity:
    """Bias over the range: bias = intercept + slope · reference, with 95 % half-widths and t of each; r2: share of the
    variation that the line explains; p of no bias anywhere (F test of both)."""

    n: int
    intercept: float
    slope: float
    intercept_half: float
    slope_half: float
    intercept_t: float
    slope_t: float
    r2: float
    p: float
    fitted: tuple[FittedBias, ...]

    @property
    def judgement(self) -> str:
        """Whether the line of no bias is one that the readings allow."""
        return "no bias evident over the range" if self.p >= LEVEL else "biased over the range"


def bias_study(readings: Floats, reference: float) -> Bias:
    """Of readings (n) of one reference. Errors: UsageError."""
    x = np.asarray(readings, float)
    n = len(x)
    if n < 2 or np.ptp(x) == 0:
        raise UsageError("accuracy-without-scatter", count=n)
    s, bias = float(x.std(ddof=1)), float(x.mean() - reference)
    of_mean = s / math.sqrt(n)
    half = float(scipy.special.stdtrit(n - 1, 1 - LEVEL / 2)) * of_mean
    t = bias / of_mean
    return Bias(n, float(x.mean()), s, bias, half, t, float(2 * scipy.special.stdtr(n - 1, -abs(t))))


def linearity(reference: Floats, readings: Floats) -> Linearity:
    """Of readings (n) of references (n) over at least two values. Errors: UsageError."""
    x, bias = np.asarray(reference, float), np.asarray(readings, float) - np.asarray(reference, float)
    n = len(x)
    if n < 4 or np.ptp(x) == 0:
        raise UsageError("linearity-too-few", count=n)
    X = np.column_stack([np.ones(n), x])
    inverse = np.linalg.inv(X.T @ X)
    found = inverse @ X.T @ bias
    rest = float(((bias - X @ found) ** 2).sum())
    if rest == 0:
        raise UsageError("accuracy-without-scatter", count=n)
    s2, k = rest / (n - 2), float(scipy.special.stdtrit(n - 2, 1 - LEVEL / 2))
    std = np.sqrt(s2 * np.diagonal(inverse))
    about = float(((bias - bias.mean()) ** 2).sum())
    values = np.unique(x)
    at = np.column_stack([np.ones(len(values)), values])
    halves = k * np.sqrt(s2 * np.einsum("vi,ij,vj->v", at, inverse, at))
    return Linearity(
        n=n,
        intercept=float(found[0]),
        slope=float(found[1]),
        intercept_half=k * float(std[0]),
        slope_half=k * float(std[1]),
        intercept_t=float(found[0] / std[0]),
        slope_t=float(found[1] / std[1]),
        r2=1 - rest / about if about > 0 else 0.0,
        p=float(scipy.special.fdtrc(2, n - 2, (float((bias**2).sum()) - rest) / 2 / s2)),
        fitted=tuple(
            FittedBias(float(v), float(bias[x == v].mean()), float(f), float(h))
            for v, f, h in zip(values, at @ found, halves, strict=True)
        ),
    )
