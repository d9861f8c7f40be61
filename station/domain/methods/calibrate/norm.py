"""Norm: offsets, gains and non-orthogonality from the magnitude alone; poses give nothing but three alignment angles.

Hybrid of the ellipsoid fit and Wahba's problem: errors of poses cannot reach offsets, gains and non-orthogonality,
and every pose gets an estimate of its own tilt.
"""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from station.domain.core import rotation
from station.domain.core.linear_algebra import inverse
from station.domain.core.types import Floats
from station.domain.methods import residual_scatter, scatter
from station.domain.methods.calibrate import _alignment, _ellipsoid, _outliers
from station.domain.methods.calibrate._ellipsoid import COLUMNS, ROWS, Ellipsoid
from station.domain.methods.method import Fit, FitProblem
from station.domain.recipe.recipe import Recipe
from station.errors import RecipeError
from station.messages import Message

NAMES = (
    *(f"offset {a}" for a in "xyz"),
    *(f"gain {'xyz'[i]}" if i == j else f"cross-axis {'xyz'[i]}{'xyz'[j]}" for i, j in zip(ROWS, COLUMNS, strict=True)),
)


class Norm:
    """matrix = K⁻¹·Q: K upper triangular from |K(reading − offset)| = magnitude, Q from the nominal poses.

    Where poses are unknown Q is the identity, so that the matrix is upper triangular.
    """

    open_ended: ClassVar[bool] = True
    by_magnitude: ClassVar[bool] = True

    def check(self, recipe: Recipe) -> None:
        """Any positions with a stimulus; how many are enough is the design's question."""
        for position in recipe.positions if recipe.pose_known else ():
            if not np.any(recipe.true_vector(position)):
                raise RecipeError("norm-no-magnitude", position=position.name, recipe=recipe.name)

    def design(self, true: Floats, recipe: Recipe, nuisance: Floats) -> tuple[Floats, tuple[str, ...]]:
        """One row a visit, nine columns."""
        return _ellipsoid.design(true), NAMES

    def together(self, problem: FitProblem) -> Fit | None:
        """None: every unit has an ellipsoid of its own."""
        return None

    def fit(self, problem: FitProblem) -> Fit:
        """Ellipsoid, then alignment; visits that fit neither with the others are left out and marked."""
        keep = np.ones(problem.mean.shape[:2])
        for _ in range(max(len(problem.pose) // 4, 1)):
            e = _ellipsoid.fit(problem, keep)
            worst = _outliers.worst_visit(e.r[..., None], e.hat, e.variance[..., None], keep, 9)
            if not worst.any():
                break
            keep = np.where(worst, 0.0, keep)
        return _aligned(problem, e, keep) if problem.pose_known else _unaligned(problem, e, keep)


def _unaligned(problem: FitProblem, e: Ellipsoid, keep: Floats) -> Fit:
    """The matrix is K⁻¹; a visit's residual is its distance from the ellipsoid along the found direction."""
    u, v = keep.shape
    theta, jacobian = _coefficients(e, np.tile(np.eye(3), (u, 1, 1)), np.zeros((u, 3, v, 3)))
    found, _ = _found_directions(problem, e)
    modelled = e.b[:, None] + (found * problem.magnitude[..., None]) @ inverse(e.K).transpose(0, 2, 1)
    upper = np.r_[np.ones(3, bool), np.triu(np.ones((3, 3), bool)).ravel()]
    nothing = np.zeros((u, v))
    return _fit(e, keep, theta, jacobian, upper, problem.mean - modelled, (nothing, nothing), (np.zeros(u), np.ones(u)))


def _aligned(problem: FitProblem, e: Ellipsoid, keep: Floats) -> Fit:
    """The same, turned onto the nominal poses; what is left of each pose is its tilt."""
    found, size = _found_directions(problem, e)
    nominal = problem.true / problem.magnitude[..., None]
    Q = _alignment.align(found, nominal, keep)
    turn, d = _alignment.rotation_derivative(Q, nominal, keep)
    moves = _direction_derivative(problem, e, size)
    turned = np.einsum("uavi,uviwj->uawj", turn, moves)
    theta, jacobian = _coefficients(e, Q, turned)
    off = np.cross(d, found)
    tilt = np.arctan2(np.linalg.norm(off, axis=2), (d * found).sum(axis=2))
    noise = _tilt_noise(problem, d, moves, turned)
    pose_std, pose_dof = _pose_std(problem, off, noise, keep, _explained(problem, nominal))
    common = _alignment_spread(problem, d, keep) * pose_std[:, None] ** 2
    modelled = e.b[:, None] + problem.true @ (inverse(e.K) @ Q).transpose(0, 2, 1)
    residual = problem.mean - modelled
    tilts = tilt, np.sqrt(noise + common)
    return _fit(e, keep, theta, jacobian, np.ones(12, bool), residual, tilts, (pose_std, pose_dof))


def _fit(
    e: Ellipsoid,
    keep: Floats,
    theta: Floats,
    jacobian: Floats,
    free: NDArray[np.bool_],
    residual: Floats,
    tilts: tuple[Floats, Floats],
    pose_std: tuple[Floats, Floats],
) -> Fit:
    lost = (Message("norm-not-settled"),)
    return Fit(
        theta=theta,
        jacobian=jacobian,
        free=free,
        residual=residual,
        tilt=tilts,
        disturbed=keep == 0,
        misfit=e.r[..., None],
        noise=e.noise[..., None],
        pose_variance=np.zeros((*e.r.shape, 1)),
        parameters=9,
        explained=np.zeros((0, *e.r.shape[1:], 1)),
        consistent=np.zeros(len(theta), bool),
        pose_std_rad=pose_std[0],
        pose_dof=pose_std[1],
        notes=tuple(() if ok else lost for ok in e.converged),
    )


def _found_directions(problem: FitProblem, e: Ellipsoid) -> tuple[Floats, Floats]:
    """Found directions (u, v, 3) in the ellipsoid's frame, and the magnitudes they had (u, v)."""
    felt = (problem.mean - e.b[:, None]) @ e.K.transpose(0, 2, 1)
    size = np.linalg.norm(felt, axis=2)
    return felt / size[..., None], size


def _coefficients(e: Ellipsoid, Q: Floats, turned: Floats) -> tuple[Floats, Floats]:
    """theta (u, 12) and its derivative (u, 12, v, 3). turned (u, 3, v, 3): rotation vector of Q by the readings.

    d(K⁻¹Q) = −K⁻¹ dK K⁻¹ Q + K⁻¹ [φ]× Q.
    """
    u, _, v, _ = e.G.shape
    U = inverse(e.K)
    A = U @ Q
    by_K = -U[:, :, ROWS, None] * A[:, COLUMNS][:, None]
    by_turn = (U[:, None] @ rotation.cross_matrix(np.eye(3))) @ Q[:, None]
    into_K = by_K.transpose(0, 1, 3, 2).reshape(u, 9, 6)
    into_turn = by_turn.transpose(0, 2, 3, 1).reshape(u, 9, 3)
    matrix = into_K @ e.G[:, 3:].reshape(u, 6, 3 * v) + into_turn @ turned.reshape(u, 3, 3 * v)
    theta = np.concatenate([e.b, A.reshape(u, 9)], axis=1)
    return theta, np.concatenate([e.G[:, :3], matrix.reshape(u, 9, v, 3)], axis=1)


def _direction_derivative(problem: FitProblem, e: Ellipsoid, size: Floats) -> Floats:
    """How found directions move with the readings: (u, v, 3, w, 3), along the direction itself left in."""
    u, v = size.shape
    apart = problem.mean - e.b[:, None]
    by_p = np.zeros((u, v, 3, 9))
    by_p[..., :3] = -e.K[:, None]
    by_p[:, :, ROWS, 3 + np.arange(6)] = apart[..., COLUMNS]
    moves = (by_p.reshape(u, 3 * v, 9) @ e.G.reshape(u, 9, 3 * v)).reshape(u, v, 3, v, 3)
    moves[:, range(v), :, range(v)] += e.K
    return np.asarray(moves / size[:, :, None, None, None])


def _tilt_noise(problem: FitProblem, d: Floats, moves: Floats, turned: Floats) -> Floats:
    """Variance (u, v) of a tilt about one of its two axes that noise makes, through everything fitted."""
    u, v, _ = d.shape
    own = rotation.cross_matrix(d) @ moves.reshape(u, v, 3, 3 * v)
    across = np.eye(3) - d[..., :, None] * d[..., None, :]
    E = (own - across @ turned.reshape(u, 1, 3, 3 * v)).reshape(u, v, 3, v, 3)
    return np.asarray(np.einsum("uviwk,uwkl,uviwl->uv", E, problem.cov, E, optimize=True) / 2)


def _explained(problem: FitProblem, nominal: Floats) -> Floats:
    """Orthonormal patterns (k, v, 3) of tilts that stated errors shared by all visits leave after the alignment."""
    t, errors = nominal[0], problem.patterns / problem.magnitude[0][:, None]
    turned = np.cross(t[None], errors)
    across = np.eye(3) - t[:, :, None] * t[:, None, :]
    common = np.linalg.solve(across.sum(axis=0), turned.sum(axis=1).T).T
    return scatter.basis(turned - np.einsum("vij,kj->kvi", across, common))


def _pose_std(
    problem: FitProblem, off: Floats, noise: Floats, keep: Floats, explained: Floats
) -> tuple[Floats, Floats]:
    """Pose error (u) about each axis as the tilts show it or leave it possible, at least as declared, and its degrees
    of freedom (u). off (u, v, 3): tilts as rotation vectors; explained: see `_explained`."""
    if len(explained):
        basis = explained.reshape(len(explained), -1)
        flat = off.reshape(len(off), -1)
        off = (flat - flat @ basis.T @ basis).reshape(off.shape)
    group = (problem.pose[:, None] == np.arange(problem.pose.max() + 1)).astype(float)
    count = np.maximum(keep @ group, 1e-9)
    mean = (off * keep[..., None]).transpose(0, 2, 1) @ group / count[:, None]
    expected = (keep * noise) @ group / count**2
    observed = keep @ group > 0
    dof = 2 * observed.sum(axis=1) - 3.0 - len(explained)
    square = (mean**2).sum(axis=1) * observed
    chi2 = (square / np.maximum(expected, 1e-30)).sum(axis=1)
    usual = (expected * observed).sum(axis=1) / np.maximum(observed.sum(axis=1), 1)
    over, nu = residual_scatter.excess(chi2 / np.maximum(dof, 1.0), dof)
    return np.maximum(np.sqrt(over * usual), problem.pose_std_rad), nu


def _alignment_spread(problem: FitProblem, d: Floats, keep: Floats) -> Floats:
    """Variance (u, v) of a tilt about one axis through the alignment, for pose errors of variance 1."""
    alone = keep / problem.visits_of_pose()
    S = np.einsum("uv,ij->uij", alone, np.eye(3)) - (d * alone[..., None]).transpose(0, 2, 1) @ d
    across = np.eye(3) - d[..., :, None] * d[..., None, :]
    return np.asarray(np.einsum("uvij,uji->uv", across, inverse(S)) / 2)
