"""What the data say of several parameters of one form together: a time constant and a frequency.

Of a wave of which a dwell holds the end alone, size, time constant and frequency go together: a wave that dies away
sooner began larger. One parameter after the other, each with the others at their best, shows a part of it. The evidence
is summed over a lattice along the axes of its peak, from the best point outwards as far as it matters.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from station.diagnosis.candidates.shape import FormEstimate
from station.diagnosis.results.form_posterior import LAST_NATS, FormPosterior
from station.domain.core.types import Floats

#: Distance of the lattice's points, in standard deviations by the curvature: at this one the sum over a Gauss curve is
#: its integral to a part in ten thousand. Most points, and steps outwards.
STEP, MOST_POINTS, MOST_STEPS = 1.4, 100, 24
#: Correlation of two parameters at most.
MOST_COMMON = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class JointForm:
    """estimates: the likeliest peak's mean of each parameter of a form, and the standard deviation about it, on its
    logarithm; values (n, p), weights (n): what they may be together, and how likely; nats: log of the evidence's
    integral."""

    estimates: tuple[FormEstimate, ...]
    values: Floats
    weights: Floats
    nats: float = 0.0

    @staticmethod
    def of_one(found: FormPosterior) -> "JointForm":
        """Of a single parameter."""
        return JointForm((found.estimate,), found.values[:, None], found.weights)

    @staticmethod
    def of_peaks(peaks: Sequence["JointForm"]) -> "JointForm":
        """Of peaks that do not overlap, about the likeliest."""
        first = max(peaks, key=lambda peak: peak.nats)
        shares = np.exp([peak.nats - first.nats for peak in peaks])
        weights = np.concatenate([s * peak.weights for s, peak in zip(shares, peaks, strict=True)]) / shares.sum()
        values = np.concatenate([peak.values for peak in peaks])
        off = np.log(values) - np.log([e.value for e in first.estimates])
        spread = np.sqrt(weights @ off**2)
        estimates = [
            FormEstimate(e.field, e.value, e.value * float(s)) for e, s in zip(first.estimates, spread, strict=True)
        ]
        return JointForm(tuple(estimates), values, weights, first.nats + float(np.log(shares.sum())))

    def holds(self, values: Floats) -> bool:
        """Whether values (p) belong to this peak: beside any of its own."""
        spread = np.array([e.std / e.value for e in self.estimates])
        return bool(np.any(np.all(np.abs(np.log(self.values) - np.log(values)) < spread, axis=1)))


def weigh_together(
    best: Sequence[FormEstimate], bounds: Sequence[tuple[float, float]], evidence_at: Callable[[Floats], Floats]
) -> JointForm:
    """The weights of parameters from their best values outwards, within bounds of their logarithms. best: where the
    evidence of each is greatest with the others as they are, and the curvature; evidence_at: nats (n) at logarithms
    (n, p)."""
    middle = np.log([b.value for b in best])
    low, high = np.array(bounds).T
    axes = STEP * _axes(middle, np.array([b.std / b.value for b in best]), evidence_at)
    found: dict[tuple[int, ...], float] = {}
    ahead = [(0,) * len(best)]
    for _ in range(MOST_STEPS):
        points = middle + np.array(ahead) @ axes.T
        found.update(zip(ahead, evidence_at(points).tolist(), strict=True))
        top = max(found.values())
        going = [a for a in ahead if found[a] >= top - LAST_NATS]
        beside = dict.fromkeys(b for a in going for b in _beside(a) if b not in found)
        ahead = [b for b in beside if np.all((low <= (x := middle + axes @ b)) & (x <= high))]
        if not ahead or len(found) > MOST_POINTS:
            break
    logs, nats = middle + np.array(list(found)) @ axes.T, np.array(list(found.values()))
    weights = np.exp(nats - top)
    total = float(weights.sum())
    weights /= total
    mean = weights @ logs
    spread = np.sqrt(weights @ (logs - mean) ** 2) if len(logs) > 1 else np.array([b.std / b.value for b in best])
    estimates = (
        FormEstimate(b.field, float(v), float(v * s)) for b, v, s in zip(best, np.exp(mean), spread, strict=True)
    )
    volume = top + float(np.log(total) + np.linalg.slogdet(axes)[1])
    return JointForm(tuple(estimates), np.exp(logs), weights, volume)


def _beside(place: tuple[int, ...]) -> list[tuple[int, ...]]:
    """The neighbours of a point of the lattice along its axes."""
    return [tuple(x + step * (k == i) for k, x in enumerate(place)) for i, step in product(range(len(place)), (-1, 1))]


def _axes(middle: Floats, spread: Floats, evidence_at: Callable[[Floats], Floats]) -> Floats:
    """The axes (p, p) of a peak, as columns one standard deviation long: curvatures of single parameters (p), and of
    each two by the corners beside the middle."""
    p = len(middle)
    bend = np.diag(spread**-2.0)
    for i in range(p):
        for k in range(i):
            corners = np.zeros((4, p))
            corners[:, i], corners[:, k] = spread[i] * np.array([1, 1, -1, -1]), spread[k] * np.array([1, -1, 1, -1])
            both = evidence_at(middle + corners) @ np.array([1.0, -1.0, -1.0, 1.0])
            # What two have in common is less than what they are: beyond it the corners lie on another peak.
            most = MOST_COMMON / (spread[i] * spread[k])
            bend[i, k] = bend[k, i] = np.clip(-both / (4 * spread[i] * spread[k]), -most, most)
    return np.asarray(np.linalg.cholesky(np.linalg.inv(bend)))
