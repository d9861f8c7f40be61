"""What stated errors of poses hide of other scatter, and what they do not: variance components of the residuals.

Where errors of poses are stated as far larger than noise, χ² of all residuals hardly sees anything else. But a pose
turns the truth and does not lengthen it: some combinations of readings feel no pose. MINQUE (Rao 1971, J. Multivariate
Anal. 1, 257) weighs each combination by how well it is known. Of combinations c that no coefficient moves, with stated
covariance C, scatter alike on all readings is shown by c'C⁻²c; errors of poses beyond the stated ones, of covariance D,
by c'GDGc with G = (C + that scatter)⁻¹. Degrees of freedom are those of quadratic forms (Satterthwaite 1946).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core import linear_algebra
from station.domain.core.types import Floats
from station.domain.methods import coefficients, residual_scatter
from station.domain.methods.method import Fit, FitProblem
from station.domain.methods.scatter import LackOfFit
from station.domain.recipe.recipe import Recipe

#: Singular values below this share of the largest are rounding.
RANK = 1e-9
#: Variance of the mean of a pose whose visits were all left out, in units of the largest: it says nothing.
UNOBSERVED = 1e4


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """One kind of scatter: ratio (u) of its variance with what is stated to that alone, degrees of freedom (u) of the
    ratio, and the variance (u, v, 3) of each reading that the ratio is in units of."""

    ratio: Floats
    dof: Floats
    unit: Floats


def apply(recipe: Recipe, problem: FitProblem, fit: Fit) -> bool:
    """Whether errors of poses are stated and felt, and a reading is left over."""
    stated = problem.pose_std_rad > 0 and problem.pose_known and recipe.reference.source != "gold"
    return stated and fit.tilt is None and fit.misfit[0].size > fit.parameters + len(fit.explained)


def components(
    problem: FitProblem, fit: Fit, found: LackOfFit, usual: tuple[float, float]
) -> tuple[Component, Component]:
    """Scatter alike on all readings, and errors of poses beyond the stated ones. found: misfits of the pose means;
    usual: ratio and degrees of freedom of the former that earlier units had."""
    basis, of_poses = _contrasts(problem, fit), _covariance_of_poses(problem, fit)
    noise = np.where(found.observed, found.of_mean, UNOBSERVED * found.of_between.max(axis=1, keepdims=True))
    c = (found.mean[:, None] @ basis).transpose(0, 2, 1)
    D = basis.T @ of_poses @ basis
    C = D + (basis.T * noise[:, None]) @ basis
    ratio, dof, variance = _component(C, np.broadcast_to(np.eye(len(basis.T)), C.shape), C, c)
    each = np.broadcast_to(variance[:, None, None], (len(c), len(problem.pose), 3))
    scatter = (residual_scatter.excess(ratio, dof, usual)[0] * variance)[:, None, None] * np.eye(len(basis.T))
    more, dof_of_more, share = _component(C + scatter, D, C, c)
    on_axes = np.einsum("uii->ui", of_poses).reshape(len(c), -1, problem.pose.max() + 1)
    stated = np.zeros((len(c), len(problem.pose), 3))
    stated[..., : on_axes.shape[1]] = share[:, None, None] * on_axes[:, :, problem.pose].transpose(0, 2, 1)
    return Component(ratio, dof, each), Component(more, dof_of_more, stated)


def _component(weight: Floats, kind: Floats, C: Floats, c: Floats) -> tuple[Floats, Floats, Floats]:
    """Ratio (u) of c'GKGc to what the stated covariance C makes of it, its degrees of freedom (u), and its unit (u):
    ratio − 1 times that is how much of the kind K there is. G: inverse of weight; c (u, m, 1)."""
    G = linear_algebra.inverse(weight)
    GK, half = G @ kind, G @ c
    expected = GK @ G @ C
    trace = _trace(expected)
    ratio = (half * (kind @ half)).sum(axis=(1, 2)) / trace
    return ratio, trace**2 / _trace(expected @ expected), trace / _trace(GK @ GK)


def _contrasts(problem: FitProblem, fit: Fit) -> Floats:
    """Orthonormal combinations (a·p, m) of the pose means that neither coefficients nor stated shared errors move."""
    axes, first = np.eye(fit.misfit.shape[2]), _first_visits(problem)
    of_pose = np.column_stack([np.ones(len(first)), problem.true[0, first]])
    cells = [divmod(k - 3, 3) if k >= 3 else (k, -1) for k in np.flatnonzero(fit.free).tolist()]
    columns = [np.kron(axes[i], of_pose[:, 1 + j]) for i, j in cells]
    columns += [np.kron(axis, extra) for axis in axes for extra in problem.nuisance[first].T]
    columns += [pattern[first].T.ravel() for pattern in fit.explained]
    basis, size, _ = np.linalg.svd(np.column_stack(columns))
    return np.asarray(basis[:, int((size > RANK * size[0]).sum()) :])


def _covariance_of_poses(problem: FitProblem, fit: Fit) -> Floats:
    """Covariance (u, a·p, a·p) of the pose means by stated errors of poses, to second order."""
    first, a, std = _first_visits(problem), fit.misfit.shape[2], problem.pose_std_rad
    turn = coefficients.matrix_of(fit.theta)[:, None].transpose(0, 1, 3, 2)
    felt = std * (problem.turns()[:, :, first] @ turn)[..., :a]
    if problem.turned is None:
        along = std**2 * (problem.true[:1, None, first] @ turn)[..., :a]
        felt = np.concatenate([felt, along], axis=1)
    u, p = len(fit.theta), len(first)
    out, own = np.zeros((u, a, p, a, p)), np.arange(p)
    out[:, :, own, :, own] = np.einsum("urpi,urpj->puij", felt, felt)
    return out.reshape(u, a * p, a * p)


def _first_visits(problem: FitProblem) -> NDArray[np.intp]:
    """The first visit of each pose."""
    return np.unique(problem.pose, return_index=True)[1]


def _trace(of: Floats) -> Floats:
    return np.asarray(np.einsum("uii->u", of))
