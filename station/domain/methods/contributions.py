"""What each cause of the budget does to the coefficients: covariances (u, 12, 12), carried by the fit's derivative.

An error δt of the truth acts as a reading that is off by matrix · δt. What visits share is one pattern over all, and
does not average out.
"""

from functools import lru_cache

import numpy as np
import scipy

from station.domain.core.types import Floats, ReducedVisits
from station.domain.methods import coefficients, coverage
from station.domain.methods.method import Fit, FitProblem, same_at_all_visits
from station.domain.recipe import assumptions
from station.domain.recipe.recipe import Recipe

#: Fewer shortenings than this, lengths and signs considered, have cancelled each other.
ONE_SIDED = 0.1
#: Of its step, what a converter that cuts off takes of every reading.
CUT_OFF = 0.5


def diagonal(variance: Floats) -> Floats:
    """Variances (…, 3) as covariances (…, 3, 3)."""
    return variance[..., None] * np.eye(3)


def noise(fit: Fit, cov: Floats) -> Floats:
    """From independent errors of the means, cov (u, v, 3, 3)."""
    # Which way a unit takes is its own affair: the same bits alone as among many.
    even = fit.consistent & same_at_all_visits(cov)
    if not even.any():
        return _of_noise(fit.jacobian, cov)
    out = _of_uniform_noise(fit.jacobian[int(np.argmax(even))], cov[:, 0])
    if not even.all():
        out[~even] = _of_noise(fit.jacobian[~even], cov[~even])
    return out


def _of_noise(jacobian: Floats, cov: Floats) -> Floats:
    u, _, v, _ = jacobian.shape
    carried = (jacobian.transpose(0, 2, 1, 3) @ cov).transpose(0, 2, 1, 3).reshape(u, 12, 3 * v)
    return np.asarray(carried @ jacobian.reshape(u, 12, 3 * v).transpose(0, 2, 1))


def _of_uniform_noise(jacobian: Floats, cov: Floats) -> Floats:
    """J (12, v, 3) with the same covariance (u, 3, 3) at every visit: Σ_kl cov_kl · J_k J_lᵀ, the nine products once.

    Calm fits have a regression for each axis, so that of the nine terms only one is not zero: the sum is exact in any
    order, and a unit's bits do not depend on its neighbours.
    """
    products = _products(np.ascontiguousarray(jacobian).tobytes())
    return np.asarray((cov.reshape(-1, 9) @ products).reshape(-1, 12, 12))


@lru_cache(maxsize=64)
def _products(jacobian: bytes) -> Floats:
    J = np.frombuffer(jacobian).reshape(12, -1, 3)
    return np.asarray(np.einsum("ivk,jvl->klij", J, J).reshape(9, 144))


def patterns(fit: Fit, of_truth: Floats) -> Floats:
    """From patterns (k, v, 3) of errors of the truth, each common to all visits."""
    matrix = coefficients.matrix_of(fit.theta)
    u, _, v, _ = fit.jacobian.shape
    felt = (of_truth.reshape(-1, 3) @ matrix.transpose(0, 2, 1)).reshape(u, len(of_truth), 3 * v)
    return of_readings(fit, felt)


def of_readings(fit: Fit, felt: Floats) -> Floats:
    """From patterns (u, k, 3v) of errors of the readings."""
    effect = felt @ fit.jacobian.reshape(len(fit.theta), 12, -1).transpose(0, 2, 1)
    return np.asarray(effect.transpose(0, 2, 1) @ effect)


def by_pose(problem: FitProblem, effect: Floats) -> Floats:
    """Sums of effects (u, 12, k, v) over the visits of each pose: (u, 12, k · poses)."""
    if (np.diff(problem.pose) > 0).all():  # each pose once, in order
        return effect.reshape(*effect.shape[:2], -1)
    order = np.argsort(problem.pose, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(problem.pose[order]) > 0])
    summed = np.add.reduceat(effect[..., order], first, axis=3)
    return np.asarray(summed.reshape(*summed.shape[:2], -1))


def position(problem: FitProblem, fit: Fit, std_rad: Floats) -> Floats:
    """Pose errors of std_rad (u) about each axis, one draw for all visits of a pose, to second order.

    A pose turned by φ shortens the truth by |φ|²/2 across it: δ² in the mean over poses, and as much from pose to pose.
    Where the method fits magnitudes it does not feel that.
    """
    u = len(fit.theta)
    if not problem.pose_known or not std_rad.any():
        return np.zeros((u, 12, 12))
    matrix = coefficients.matrix_of(fit.theta)[:, None]
    effect = np.einsum("uivk,uavk->uiav", fit.jacobian, problem.turns() @ matrix.transpose(0, 1, 3, 2))
    each = by_pose(problem, effect) * std_rad[:, None, None]
    total = each @ each.transpose(0, 2, 1)
    if fit.tilt is None and problem.turned is None:
        along = np.einsum("uivk,uavk->uiav", fit.jacobian, problem.true[:, None] @ matrix.transpose(0, 1, 3, 2))
        short = by_pose(problem, along) * std_rad[:, None, None] ** 2
        common = shortening(short)[:, :, None]
        total = total + short @ short.transpose(0, 2, 1) + common @ common.transpose(0, 2, 1)
    return np.asarray(total)


def shortening(short: Floats) -> Floats:
    """What coefficients (u, 12) are given beside the scatter of shortenings (u, 12, poses), which never lengthen.

    A sum of n alike has a gamma distribution with mean and variance n: ± 1.96 u is to hold its 95 % quantile.
    """
    total, variance = short.sum(axis=2), (short**2).sum(axis=2)
    n = total**2 / np.where(variance > 0, variance, 1.0)
    held = scipy.special.gammaincinv(np.maximum(n, ONE_SIDED), coverage.PROBABILITY) / coverage.NORMAL
    excess = np.maximum(held**2 / np.maximum(n, ONE_SIDED) - 1, 0.0)
    return np.asarray(np.sqrt(excess * variance) * (n > ONE_SIDED))


def converter(recipe: Recipe, problem: FitProblem, fit: Fit) -> tuple[Floats, Floats]:
    """Covariance (u, 12, 12) of half a step that every reading may be low by, where the converter is not stated to
    round to the nearest; and by how much that shifts each coefficient (u, 12)."""
    u = len(fit.theta)
    if recipe.device.rounding == "nearest":
        return np.zeros((u, 12, 12)), np.zeros((u, 12))
    step = np.maximum(recipe.device.lsb, np.sqrt(12 * problem.quantisation.max(axis=1)))
    effect = CUT_OFF * step[:, None] * fit.jacobian.sum(axis=2)
    shared = coverage.SHIFT_STD * effect
    return shared @ shared.transpose(0, 2, 1), np.abs(effect).sum(axis=2)


def method(recipe: Recipe, problem: FitProblem, fit: Fit) -> Floats:
    """What coefficients that the method takes for granted may be off by."""
    u, _, v, _ = fit.jacobian.shape
    std = np.where(fit.free, 0.0, assumptions.unestimated_std(recipe))[3:].reshape(3, 3)
    if fit.tilt is not None or not std.any():
        return np.zeros((u, 12, 12))
    felt = np.einsum("ij,uvj,ik->uijvk", std, problem.true, np.eye(3)).reshape(u, 9, 3 * v)
    return of_readings(fit, felt)


def turn_on(recipe: Recipe, fit: Fit, visits: ReducedVisits) -> Floats:
    """An offset that differs from run to run, on each axis by itself; of usual data sheets, where nobody says that
    power is switched between runs, one for all."""
    u, _, v, _ = fit.jacobian.shape
    std = assumptions.turn_on_std(recipe)
    if std == 0:
        return np.zeros((u, 12, 12))
    felt = offsets_of_runs(visits).reshape(-1, 3, 3 * v)
    if recipe.device.turn_on_std is None:
        felt = felt.sum(axis=0, keepdims=True)
    felt = std * felt.reshape(-1, 3 * v)
    return of_readings(fit, np.broadcast_to(felt, (u, *felt.shape)))


def offsets_of_runs(visits: ReducedVisits) -> Floats:
    """Patterns (k, v, 3) of readings that are off by 1 on one axis in one run."""
    run = (np.unique(visits.run)[:, None] == visits.run).astype(float)
    return np.asarray(np.einsum("rv,ik->rivk", run, np.eye(3)).reshape(-1, len(visits.run), 3))


def temperature(recipe: Recipe, problem: FitProblem, fit: Fit) -> Floats:
    """What temperature coefficients make of differences between the visits, and of the thermometer. Those that nobody
    stated count where the temperature was measured, at which the result is then said to hold."""
    u, _, v, _ = fit.jacobian.shape
    known = np.asarray(np.isfinite(problem.temperature_degC).all(axis=1))
    stated = recipe.device.offset_tempco, recipe.device.gain_tempco
    of_offset, of_gain = (
        np.where(known | (own is not None), tempco, 0.0)[:, None, None, None]
        for own, tempco in zip(stated, assumptions.tempcos(recipe), strict=True)
    )
    if not (of_offset.any() or of_gain.any()):
        return np.zeros((u, 12, 12))
    T = np.where(known[:, None], problem.temperature_degC, 0.0)
    apart = T - T.mean(axis=1, keepdims=True)
    common = np.full((u, v), assumptions.thermometer_degC(recipe))
    axes = np.eye(3)[None, :, None]
    true = np.where(np.isfinite(problem.true), problem.true, 0.0)[:, None] * axes
    felt = np.concatenate(
        [
            part
            for t in (apart, common)
            for part in (
                of_offset * t[:, None, :, None] * axes,
                of_gain * t[:, None, :, None] * true,
            )
        ],
        axis=1,
    )
    return of_readings(fit, felt.reshape(u, 12, 3 * v))


def reproducibility(recipe: Recipe, fit: Fit) -> Floats:
    """As the recipe states it from history."""
    stated = recipe.reproducibility
    std = np.zeros(12)
    if stated is not None:
        kinds = ((coefficients.OFFSETS, stated.offset), (coefficients.GAINS, stated.gain))
        for which, value in (*kinds, (coefficients.CROSS, stated.cross_axis)):
            std[which] = value
    return np.broadcast_to(np.diag(np.where(fit.free, std, 0.0) ** 2), (len(fit.theta), 12, 12))
