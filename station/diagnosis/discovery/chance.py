"""The score that the best of all terms reaches by chance: the null distribution of the maximum over the whole grammar.

Null data are drawn from the floor and its uncertainty, as for the alarm of the diagnosis, and scored by every term of
the scan. The threshold is a quantile of the largest score, whose tail is taken as exponential.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from station.diagnosis.discovery.scan import Scan
from station.diagnosis.linear.noise_floor import FittedFloor, covariance_root
from station.diagnosis.linear.projection import ResidualSpace
from station.diagnosis.search.scoring import ScoringProblem
from station.domain.core.types import Array, Floats

#: Null data sets, in how many floors; how many at once.
NULL_SETS, NULL_FLOORS = 512, 8
#: Chance of any formula where nothing is wrong; the quantile at which the exponential tail begins.
FALSE_ALARMS, TAIL_START = 0.01, 0.9


def threshold(problem: ScoringProblem, fitted: FittedFloor, scans: Sequence[Scan], seed: int) -> float:
    """The score that the best of all terms exceeds by chance in FALSE_ALARMS of the campaigns."""
    return tail_quantile(largest_scores(problem, fitted, scans, seed))


def largest_scores(problem: ScoringProblem, fitted: FittedFloor, scans: Sequence[Scan], seed: int) -> Floats:
    """The largest score (n) of each null data set."""
    best = []
    for i, scan in enumerate(scans):
        rng = np.random.default_rng([seed, i])
        parts = [scan.largest_scores(data) for data in null_residuals(problem, fitted, scan.space, rng)]
        best.append(np.concatenate(parts))
    return np.asarray(np.max(best, axis=0))


def tail_quantile(largest: Floats) -> float:
    """The quantile at FALSE_ALARMS."""
    start = float(np.quantile(largest, TAIL_START))
    beyond = largest[largest > start] - start
    scale = float(beyond.mean()) if len(beyond) else 0.0
    return start + scale * float(np.log((1 - TAIL_START) / FALSE_ALARMS))


def null_residuals(
    problem: ScoringProblem, fitted: FittedFloor, space: ResidualSpace, rng: np.random.Generator
) -> Iterator[Array]:
    """Residuals (U, M, n) by chance alone, some sets after others."""
    mean, root = fitted.floor.variances, covariance_root(fitted.covariance)
    runs = space.covariance.runs.single_precision()
    (U, R), m = runs.member.shape, runs.rows
    n, M = NULL_SETS // NULL_FLOORS, space.live.shape[1]
    flat = space.shared_basis.reshape(U * M, -1).astype(np.float32)
    basis = space.basis.astype(np.float32)
    for _ in range(NULL_FLOORS):
        variances = np.clip(mean + root @ rng.standard_normal(3), [0.25 * mean[0], 0.0, 0.0], problem.upper)
        true = replace(problem.structure.covariance(variances).runs.single_precision(), member=runs.member)
        noise = rng.standard_normal((U, M, n), dtype=np.float32) * space.live[..., None]
        white = np.ascontiguousarray(noise[:, : R * m].reshape(U, R, m, n))
        visits = runs.whiten(true.coloured(white)).reshape(U, R * m, n)
        rows = np.concatenate([visits, noise[:, R * m :]], axis=1)
        rows -= basis @ (basis.swapaxes(1, 2) @ rows)
        if flat.shape[1]:
            rows -= (flat @ (flat.T @ rows.reshape(U * M, n))).reshape(U, M, n)
        yield rows
