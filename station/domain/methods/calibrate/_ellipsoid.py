"""The orientation-free part of the norm fit: |K (mean − b)| = magnitude, K upper triangular, for many units at once.

Nine parameters: b (3), then K's upper triangle row by row (xx xy xz yy yz zz).
"""

from dataclasses import dataclass

import numpy as np

from station.domain.core.linear_algebra import solve
from station.domain.core.types import Floats
from station.domain.methods.calibrate._outliers import HatMatrix
from station.domain.methods.method import FitProblem

ROWS, COLUMNS = np.triu_indices(3)
STEPS = 50
#: A step that changes the magnitudes by less than this share has arrived.
CONVERGED = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Ellipsoid:
    """b (u, 3), K (u, 3, 3), residual r (u, v) of the magnitudes, its variance (u, v) by noise and in all, derivative
    J (u, v, 9) of r by the parameters and G (u, 9, v, 3) of those by the readings, hat which takes out of r
    what the parameters explain, converged (u)."""

    b: Floats
    K: Floats
    r: Floats
    noise: Floats
    variance: Floats
    J: Floats
    G: Floats
    hat: HatMatrix
    converged: Floats


def fit(problem: FitProblem, keep: Floats) -> Ellipsoid:
    """Weighted Gauss–Newton from the better of two starts: a perfect sensor and the algebraic ellipsoid."""
    p = _start(problem, keep)
    done = np.zeros(len(p), bool)
    for _ in range(STEPS):
        r, J, variance, _ = _linearise(p, problem)
        step = solve(*_normal(J, keep / variance, r))[..., 0]
        # Each unit stops by itself, so that its bits do not depend on its neighbours.
        p = np.where(done[:, None], p, _shorten(p, step, problem, keep))
        size = np.abs((J @ step[..., None])[..., 0]).max(axis=1)
        done = done | (size < CONVERGED * problem.magnitude.max(axis=1))
        if done.all():
            break
    r, J, variance, slope = _linearise(p, problem)
    weight = keep / variance
    A, _ = _normal(J, weight, r)
    gain = solve(A, (J * weight[..., None]).transpose(0, 2, 1))
    return Ellipsoid(
        b=p[:, :3],
        K=_upper(p[:, 3:]),
        r=r,
        noise=_noise(slope, problem),
        variance=variance,
        J=J,
        G=-gain[..., None] * slope[:, None],
        hat=HatMatrix(J[:, None], gain[:, None]),
        converged=done,
    )


def design(true: Floats) -> Floats:
    """J (v, 9) of a perfect sensor that sees `true` (v, 3)."""
    n = true / np.linalg.norm(true, axis=1, keepdims=True)
    return np.concatenate([-n, n[:, ROWS] * true[:, COLUMNS]], axis=1)


def _normal(J: Floats, weight: Floats, r: Floats) -> tuple[Floats, Floats]:
    JW = (J * weight[..., None]).transpose(0, 2, 1)
    return JW @ J, -JW @ r[..., None]


def _upper(k: Floats) -> Floats:
    K = np.zeros((len(k), 3, 3))
    K[:, ROWS, COLUMNS] = k
    return K


def _linearise(p: Floats, problem: FitProblem) -> tuple[Floats, Floats, Floats, Floats]:
    """r (u, v), J (u, v, 9), variance (u, v) of r, and dr/dmean (u, v, 3)."""
    K = _upper(p[:, 3:])
    apart = problem.mean - p[:, None, :3]
    felt = apart @ K.transpose(0, 2, 1)
    size = np.linalg.norm(felt, axis=2)
    n = felt / np.maximum(size, 1e-300)[..., None]
    slope = n @ K
    J = np.concatenate([-slope, n[..., ROWS] * apart[..., COLUMNS]], axis=2)
    return size - problem.magnitude, J, _noise(slope, problem) + problem.scatter(), slope


def _noise(slope: Floats, problem: FitProblem) -> Floats:
    """Variance (u, v) of r that noise of the means makes."""
    variance = (slope[:, :, None, :] @ problem.cov @ slope[..., None])[..., 0, 0]
    return np.maximum(variance, (1e-9 * problem.magnitude) ** 2)


def _cost(p: Floats, problem: FitProblem, keep: Floats) -> Floats:
    """Plain squared residuals (u): comparable between steps, as no weight moves with the parameters."""
    felt = (problem.mean - p[:, None, :3]) @ _upper(p[:, 3:]).transpose(0, 2, 1)
    return np.asarray((keep * (np.linalg.norm(felt, axis=2) - problem.magnitude) ** 2).sum(axis=1))


def _shorten(p: Floats, step: Floats, problem: FitProblem, keep: Floats) -> Floats:
    """p + step, the step halved for units where it would make things clearly worse."""
    before = _cost(p, problem, keep)
    length = np.ones(len(p))
    for _ in range(8):
        worse = _cost(p + length[:, None] * step, problem, keep) > 1.5 * before + 1e-18
        if not worse.any():
            break
        length = np.where(worse, length / 2, length)
    return np.asarray(p + length[:, None] * step)


def _start(problem: FitProblem, keep: Floats) -> Floats:
    perfect = np.tile(np.r_[np.zeros(3), np.eye(3)[ROWS, COLUMNS]], (len(problem.mean), 1))
    algebraic = _algebraic(problem, keep)
    better = _cost(algebraic, problem, keep) < _cost(perfect, problem, keep)
    return np.where(better[:, None], algebraic, perfect)


def _algebraic(problem: FitProblem, keep: Floats) -> Floats:
    """The ellipsoid a'Ma + n'a = 1 about the mean reading by linear least squares; NaN where it is none."""
    middle = problem.mean.mean(axis=1, keepdims=True)
    size = problem.magnitude.mean(axis=1)[:, None, None]
    a = (problem.mean - middle) / size
    twice = np.where(ROWS == COLUMNS, 1.0, 2.0)
    X = np.concatenate([a[..., ROWS] * a[..., COLUMNS] * twice, a], axis=2) * keep[..., None]
    q = (np.linalg.pinv(X) @ keep[..., None])[..., 0]
    M = np.zeros((len(q), 3, 3))
    M[:, ROWS, COLUMNS] = M[:, COLUMNS, ROWS] = q[:, :6]
    with np.errstate(all="ignore"):
        sound = np.linalg.eigvalsh(M)[:, 0] > 1e-6
        M = np.where(sound[:, None, None], M, np.eye(3))
        centre = -solve(M, q[:, 6:, None])[..., 0] / 2
        level = 1 + (centre[:, None] @ M @ centre[..., None])[:, 0, 0]
        sound &= level > 0
        K = np.linalg.cholesky(M / np.where(sound, level, 1.0)[:, None, None]).transpose(0, 2, 1)
    out = np.concatenate([middle[:, 0] + centre * size[:, 0], K[:, ROWS, COLUMNS]], axis=1)
    return np.where(sound[:, None], out, np.nan)
