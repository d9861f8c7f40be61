"""What the data say of a time constant: weights over the values that it may have, not a peak with a curvature.

Two constants a decade apart may fit equally well, with amplitudes that differ as much. The curvature at the best value
does not show that. The evidence is therefore summed over the logarithm of the constant with a uniform prior (Jeffreys),
and the intervals of the coefficients include how they move with it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.shape import FormEstimate, evidence_of, log_range, with_form_value
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.projection import ResidualSpace
from station.domain.core.types import Floats
from station.model.effect import Parameter

#: Distance of the values looked at, in standard deviations by the curvature; at this one the sum over a Gauss curve is
#: its integral to a part in a thousand.
STEP = 0.75
#: A value whose evidence is so many nats below the best is the last on its side; and so many on a side are enough.
LAST_NATS, MOST_VALUES = 6.0, 24


@dataclass(frozen=True, slots=True, eq=False)
class FormPosterior:
    """estimate: mean and standard deviation of a parameter of the form, on its logarithm; values, weights (n): what it
    may be, and how likely."""

    estimate: FormEstimate
    values: Floats
    weights: Floats


def form_posterior(
    candidate: Candidate, best: FormEstimate, p: Parameter, view: ResidualView, space: ResidualSpace
) -> FormPosterior:
    """The weights of a parameter of a candidate's form. best: where its evidence is greatest, and the curvature."""
    return weigh(
        best, log_range(p), lambda x: evidence_of(with_form_value(candidate, p.field, math.exp(x), view), view, space)
    )


def weigh(best: FormEstimate, bounds: tuple[float, float], evidence_at: Callable[[float], float]) -> FormPosterior:
    """The weights from the best value outwards, within bounds of its logarithm. evidence_at: nats at a logarithm."""
    spread, middle = best.std / best.value, math.log(best.value)
    evidence = {middle: evidence_at(middle)}
    for side in (-STEP * spread, STEP * spread):
        for n in range(1, MOST_VALUES + 1):
            x = middle + n * side
            if not bounds[0] <= x <= bounds[1]:
                break
            evidence[x] = evidence_at(x)
            if evidence[x] < evidence[middle] - LAST_NATS:
                break
    logs, found = np.array(list(evidence)), np.array(list(evidence.values()))
    weights = np.exp(found - found.max())
    weights /= weights.sum()
    mean = float(weights @ logs)
    if len(logs) > 1:
        spread = float(np.sqrt(weights @ (logs - mean) ** 2))
    value = math.exp(mean)
    return FormPosterior(FormEstimate(best.field, value, value * spread), np.exp(logs), weights)
