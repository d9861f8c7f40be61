"""The course of temperature through a run of very many visits, at a cost that is linear in them.

The same model as in `temperature_course.py`. Level and slope at a visit are a state that depends on the one before
alone: Kalman's filter whitens the visits (Durbin and Koopman, Time Series Analysis by State Space Methods, 2012,
ch. 4), and the precision of all states together has a narrow band.
"""

from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: Visits so many times closer to each other than usual are one to the course.
SAME_TIME_SHARE = 0.25
#: The least stiffness, beside the cube of the usual time between visits: below it rounding is felt, and nothing else.
LEAST_STIFFNESS = 1e-11
#: How exactly the modes are found.
MODE_TOLERANCE = 1e-6


def likelihoods(time: Floats, value: Floats, ratios: Floats) -> tuple[Floats, Floats]:
    """log|V| + log|BᵀV⁻¹B| and the sum of squares left, of runs (r, n) together at each of some ratios (ρ)."""
    order = np.argsort(time, axis=1, kind="stable")
    t = np.take_along_axis(time, order, axis=1)
    T = np.take_along_axis(value, order, axis=1) - value.mean(axis=1, keepdims=True)
    # (n, 1, r, 3): the straight line and the temperatures.
    columns = np.stack([np.ones_like(t), t, T], axis=-1).swapaxes(0, 1)[:, None]
    white, logdet = _white(np.diff(t, axis=1, prepend=0.0).T, columns, ratios[:, None])
    line, left = white[..., :2], white[..., 2]
    normal = np.einsum("nqri,nqrj->qrij", line, line)
    toward = np.einsum("nqri,nqr->qri", line, left)
    taken = np.einsum("qri,qri->qr", toward, np.linalg.solve(normal, toward[..., None])[..., 0])
    squares = np.einsum("nqr,nqr->qr", left, left) - taken
    return (logdet + np.linalg.slogdet(normal)[1]).sum(1), squares.sum(1)


def _white(gap: Floats, columns: Floats, ratio: Floats) -> tuple[Floats, Floats]:
    """Columns (n, 1, r, c) of visits so long (n, r) after each other, whitened at each ratio (ρ, 1): (n, ρ, r, c);
    and the log-determinant (ρ, r)."""
    shape = np.broadcast_shapes(ratio.shape, gap[0].shape)
    white = np.empty((len(gap), *shape, columns.shape[-1]))
    level, slope = np.zeros(white.shape[1:]), np.zeros(white.shape[1:])
    # Covariance of the two, and so of what is read, which has noise of variance 1.
    ll, ls, ss, logdet = (np.zeros(shape) for _ in range(4))
    for j, h in enumerate(gap):
        level = level + h[:, None] * slope
        ll = ll + h * (2 * ls + h * ss) + ratio * h**3 / 3
        ls = ls + h * ss + ratio * h**2 / 2
        ss = ss + ratio * h
        total = 1 + ll
        off = columns[j] - level
        white[j] = off / np.sqrt(total)[..., None]
        logdet += np.log(total)
        level = level + (ll / total)[..., None] * off
        slope = slope + (ls / total)[..., None] * off
        ss = ss - ls**2 / total
        ls, ll = ls / total, ll / total
    return white, logdet


def course_and_modes(time: Floats, value: Floats, ratio: float, modes: int) -> tuple[Floats, Floats, Floats]:
    """Value and slope (n) of one run at each visit, and the largest modes (n, modes) of the slope's error, noise of
    variance 1."""
    place, t = _distinct(time)
    count = np.bincount(place).astype(float)
    usual = float(np.median(np.diff(t)))
    banded = _precision(np.diff(t), count, max(ratio, LEAST_STIFFNESS / usual**3), usual)
    solve = partial(scipy.linalg.cho_solve_banded, (scipy.linalg.cholesky_banded(banded), False), check_finite=False)
    middle = float(value.mean())
    state = solve(np.stack([np.bincount(place, value - middle), np.zeros(len(t))], axis=1).ravel())

    def unknown(along: Floats) -> Floats:
        return np.asarray(solve(np.stack([np.zeros(len(t)), along.ravel()], axis=1).ravel())[1::2])

    # Loaded only where a run is that long.
    from scipy.sparse.linalg import LinearOperator, eigsh

    start = np.random.default_rng(0).standard_normal(len(t))
    operator = LinearOperator((len(t), len(t)), matvec=unknown, dtype=float)
    values, vectors = eigsh(operator, k=modes, v0=start, tol=MODE_TOLERANCE, ncv=min(len(t), 20 * modes))
    largest = vectors * np.sqrt(np.maximum(values, 0.0))
    return middle + state[::2][place], state[1::2][place] / usual, largest[place] / usual


def _distinct(time: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Which of the distinct times, which follow, each visit (n) is at."""
    order = np.argsort(time, kind="stable")
    gap = np.diff(time[order])
    least = SAME_TIME_SHARE * float(np.median(gap[gap > 0]))
    times, place = [float(time[order[0]])], np.zeros(len(time), np.intp)
    for i in order:
        if time[i] - times[-1] > least:
            times.append(float(time[i]))
        place[i] = len(times) - 1
    return place, np.array(times)


def _precision(gap: Floats, count: Floats, ratio: float, usual: float) -> Floats:
    """Precision of level and slope · usual at all times (4, 2n): its upper band, as LAPACK takes it.

    A step from (f, s) to (f', s') adds the square of its surprise, whose covariance is ratio · (h³/3, h²/2; h²/2, h).
    """
    n, h = len(count), gap / usual
    # Surprise = after − F · before, F = (1, h; 0, 1); everything in units of the usual gap.
    inverse = np.empty((n - 1, 2, 2))
    inverse[:, 0, 0], inverse[:, 1, 1] = 12 / h**3, 4 / h
    inverse[:, 0, 1] = inverse[:, 1, 0] = -6 / h**2
    inverse /= ratio * usual**3
    step = np.zeros((n - 1, 2, 4))
    step[:, 0, 0] = step[:, 1, 1] = -1
    step[:, 0, 1] = -h
    step[:, 0, 2] = step[:, 1, 3] = 1
    normal = step.swapaxes(1, 2) @ inverse @ step
    band = np.zeros((4, 2 * n))
    for i in range(4):
        for j in range(i, 4):
            # Rows 2g + i, columns 2g + j of the whole, g being the step.
            band[3 + i - j, j : j + 2 * (n - 1) : 2] += normal[:, i, j]
    band[3, ::2] += count
    return band
