"""The uncertainty budget of every coefficient (GUM, JCGM 100): each cause carried through the fit's own derivative.

A cause is either noise of the means, or patterns of errors of the truth that several stops share. An error δt of the
truth acts as a reading that is off by matrix · δt, so one derivative serves all causes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from station.domain.core.types import Floats, ReducedVisits
from station.domain.methods import coefficients, scatter
from station.domain.methods.method import Fit, FitProblem, same_at_all_visits
from station.domain.noise import noise
from station.domain.recipe import sensor
from station.domain.recipe.recipe import Recipe

#: The budget line for what stops differ by beyond noise and declared pose errors (station.domain.methods.scatter).
SCATTER = "scatter"


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """Covariances (12, 12) of one unit by cause, their sum, and the degrees of freedom (12) of its diagonal.

    Standard deviations are to be read with a normal quantile: ± 1.96 of them cover 95 %, although noise is itself
    an estimate (the covariance is widened by (t₀.₉₇₅,ν/1.96)² where it is). scatter: standard deviation, in the
    recipe's unit, of what stops differ by beyond noise and declared pose errors; 0 when those explain the residuals.
    """

    parts: Mapping[str, Floats]
    total: Floats
    dof: Floats
    scatter: float

    def std(self, cause: str | None = None) -> Floats:
        """Standard uncertainties (12), of one cause or of all."""
        of = self.total if cause is None else self.parts[cause]
        return np.asarray(np.sqrt(np.maximum(np.diagonal(of), 0.0)))

    def document(self, unit: str) -> list[dict[str, object]]:
        """One entry a coefficient: name, unit, standard uncertainty, its share by cause, expanded U for 95 %."""
        std = self.std()
        by_cause = {cause: self.std(cause) for cause in self.parts}
        return [
            {
                "coefficient": name,
                "unit": coefficients.unit_of(i, unit),
                "std": float(std[i]),
                "expanded": float(1.96 * std[i]),
                "parts": {cause: float(s[i]) for cause, s in by_cause.items()},
            }
            for i, name in enumerate(coefficients.NAMES)
        ]


def budgets(recipe: Recipe, problem: FitProblem, fit: Fit, stops: ReducedVisits, rounding: Floats) -> list[Budget]:
    """The budget of each unit. stops: of one of them; rounding (12): standard deviations of the coefficients' rounding
    in the device."""
    parts = {
        "noise": covariance_of_noise(fit, problem.cov - _diagonal(problem.quantisation)),
        "quantisation": covariance_of_noise(fit, _diagonal(problem.quantisation)),
        "position": _position(recipe, problem, fit),
        **_truth(recipe, problem, fit, stops),
        "temperature": _temperature(recipe, problem, fit),
        "rounding": np.broadcast_to(np.diag(np.where(fit.free, rounding, 0.0) ** 2), (len(fit.theta), 12, 12)),
    }
    parts[SCATTER] = _scatter(problem, fit)
    total = np.sum(list(parts.values()), axis=0)
    total = (total + total.transpose(0, 2, 1)) / 2
    spread = problem.scatter_pose + problem.scatter_visit
    dof = _dof(problem, parts["noise"], total)
    return [
        Budget({k: v[u] for k, v in parts.items()}, total[u], dof[u], float(np.sqrt(spread[u])))
        for u in range(len(fit.theta))
    ]


def _scatter(problem: FitProblem, fit: Fit) -> Floats:
    """Covariance (u, 12, 12) from scatter of stops, and from scatter that the stops of a pose share."""
    u, _, v, _ = fit.jacobian.shape
    if not (problem.scatter_visit.any() or problem.scatter_pose.any()):
        return np.zeros((u, 12, 12))
    found = scatter.lack_of_fit(problem, fit)
    stop = problem.scatter_visit * noise.widening(np.maximum(found.dof_within, 1))
    pose = problem.scatter_pose * noise.widening(np.maximum(found.dof_between, 1))
    own = fit.jacobian.reshape(u, 12, 3 * v)
    shared = _by_pose(problem, fit.jacobian.transpose(0, 1, 3, 2))
    of_stop = stop[:, None, None] * (own @ own.transpose(0, 2, 1))
    return np.asarray(of_stop + pose[:, None, None] * (shared @ shared.transpose(0, 2, 1)))


def _by_pose(problem: FitProblem, effect: Floats) -> Floats:
    """Sums of effects (u, 12, k, v) over the stops of each pose: (u, 12, k · poses)."""
    order = np.argsort(problem.pose, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(problem.pose[order]) > 0])
    summed = np.add.reduceat(effect[..., order], first, axis=3)
    return np.asarray(summed.reshape(*summed.shape[:2], -1))


def _diagonal(variance: Floats) -> Floats:
    return variance[..., None] * np.eye(3)


def covariance_of_noise(fit: Fit, cov: Floats) -> Floats:
    """Covariance (u, 12, 12) from independent errors of the means, cov (u, v, 3, 3)."""
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
    """J (12, v, 3) with the same covariance (u, 3, 3) at every stop: Σ_kl cov_kl · J_k J_lᵀ, the nine products once.

    Calm fits have a regression for each axis, so that of the nine terms only one is not zero: the sum is exact in any
    order, and a unit's bits do not depend on its neighbours.
    """
    products = _products(np.ascontiguousarray(jacobian).tobytes())
    return np.asarray((cov.reshape(-1, 9) @ products).reshape(-1, 12, 12))


@lru_cache(maxsize=64)
def _products(jacobian: bytes) -> Floats:
    J = np.frombuffer(jacobian).reshape(12, -1, 3)
    return np.asarray(np.einsum("ivk,jvl->klij", J, J).reshape(9, 144))


def covariance_of_patterns(fit: Fit, patterns: Floats) -> Floats:
    """Covariance (u, 12, 12) from patterns (k, v, 3) of errors of the truth, each common to all stops."""
    u, _, v, _ = fit.jacobian.shape
    matrix = coefficients.matrix_of(fit.theta)
    felt = (patterns.reshape(-1, 3) @ matrix.transpose(0, 2, 1)).reshape(u, len(patterns), 3 * v)
    effect = felt @ fit.jacobian.reshape(u, 12, 3 * v).transpose(0, 2, 1)
    return np.asarray(effect.transpose(0, 2, 1) @ effect)


def _position(recipe: Recipe, problem: FitProblem, fit: Fit) -> Floats:
    """Pose errors of one standard deviation about each axis, one draw for all stops of a pose."""
    u = len(fit.theta)
    if not problem.pose_known or recipe.reference.source == "gold":
        return np.zeros((u, 12, 12))
    std = np.maximum(fit.pose_std_rad, problem.pose_std_rad)
    if not std.any():
        return np.zeros((u, 12, 12))
    turned = np.cross(np.eye(3)[None, :, None], problem.true[:, None])
    felt = turned @ coefficients.matrix_of(fit.theta)[:, None].transpose(0, 1, 3, 2)
    effect = np.einsum("uivk,uavk->uiav", fit.jacobian, felt)
    by_pose = _by_pose(problem, effect) * std[:, None, None]
    return np.asarray(by_pose @ by_pose.transpose(0, 2, 1))


def _truth(recipe: Recipe, problem: FitProblem, fit: Fit, stops: ReducedVisits) -> dict[str, Floats]:
    """What the sensor kind says its stimulus may be wrong by; hand-held stops know no more than the magnitude."""
    kind = sensor.of(recipe)
    if problem.pose_known:
        found = kind.truth_errors(recipe, stops.position, stops.seating, stops.true)
        return {name: covariance_of_patterns(fit, patterns) for name, patterns in found.items()}
    relative = recipe.reference.relative_std()
    gain = np.where(coefficients.OFFSETS, 0.0, fit.theta) * relative
    return {"magnitude": gain[:, :, None] * gain[:, None, :]}


def _temperature(recipe: Recipe, problem: FitProblem, fit: Fit) -> Floats:
    """What the sheet's temperature coefficients make of the differences in temperature between the stops."""
    u, _, v, _ = fit.jacobian.shape
    device = recipe.device
    known = np.asarray(np.isfinite(problem.temperature_degC).all(axis=1))
    if not known.any() or not (device.offset_tempco or device.gain_tempco):
        return np.zeros((u, 12, 12))
    T = np.where(known[:, None], problem.temperature_degC, 0.0)
    apart = T - T.mean(axis=1, keepdims=True)
    axes = np.eye(3)[None, :, None]
    offset = device.offset_tempco * apart[:, None, :, None] * axes
    felt = np.where(np.isfinite(problem.true), problem.true, 0.0)[:, None] * axes
    gain = device.gain_tempco * apart[:, None, :, None] * felt
    patterns = np.concatenate([offset, gain], axis=1).reshape(u, 6, 3 * v)
    effect = patterns @ fit.jacobian.reshape(u, 12, 3 * v).transpose(0, 2, 1)
    return np.asarray(effect.transpose(0, 2, 1) @ effect)


def _dof(problem: FitProblem, noise_part: Floats, total: Floats) -> Floats:
    """Degrees of freedom (u, 12): those of the axis' noise, more where noise is a part only (Welch–Satterthwaite)."""
    axis = problem.dof.min(axis=1)
    own = np.concatenate([axis, np.repeat(axis, 3, axis=1)], axis=1)
    share = np.einsum("uii->ui", noise_part) / np.maximum(np.einsum("uii->ui", total), 1e-300)
    return np.asarray(own / np.maximum(share, 1e-6) ** 2)
