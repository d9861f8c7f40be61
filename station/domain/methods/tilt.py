"""How far each pose seems to be from its nominal direction, as far as a linear fit has not taken it in."""

import numpy as np

from station.domain.core import linear_algebra
from station.domain.core.types import Floats
from station.domain.methods import coefficients
from station.domain.methods.method import Fit, FitProblem

#: A stimulus weaker than this share of the strongest has no direction to speak of: its tilt is told as 0 ± 0.
WEAK = 1e-3


def of(problem: FitProblem, fit: Fit) -> tuple[Floats, Floats]:
    """Angle between nominal and found direction, and its standard deviation about each axis, in rad, each (u, v).

    A method that finds tilts by itself has told them. A linear fit takes part of every tilt into its coefficients:
    the share `leverage` of it is missing from the residual, and stands, as large as the residuals of all visits make
    likely, in the standard deviation.
    """
    if fit.tilt is not None:
        return fit.tilt
    size = problem.magnitude
    directed = size > WEAK * size.max(axis=1, keepdims=True)
    size = np.where(directed, size, 1.0)
    inverse = linear_algebra.inverse(coefficients.matrix_of(fit.theta))
    off = fit.residual @ inverse.transpose(0, 2, 1) / size[..., None]
    along = problem.true / size[..., None]
    # A difference of angles is the tilt itself; one of vectors is, as far as it lies across them.
    toward = (along * off).sum(axis=2) if problem.turned is None else np.zeros(size.shape)
    across = (off - along * toward[..., None]) * directed[..., None]
    leverage = leverages(problem, fit)
    still = np.maximum(1 - leverage, 0.0)
    noise = (still * np.einsum("uvii->uvi", problem.cov)).mean(axis=2) / size**2
    scatter = (across**2).sum(axis=(1, 2)) / np.maximum(still.mean(axis=2).sum(axis=1), 1e-9)
    std = np.sqrt(noise + leverage.mean(axis=2) * scatter[:, None] / 2)
    return np.arctan2(np.linalg.norm(across, axis=2), 1 + toward) * directed, std * directed


def leverages(problem: FitProblem, fit: Fit) -> Floats:
    """How much of its own reading each visit's fitted value takes over: (u, v, 3), between 0 and 1."""
    by_own = np.einsum("ukvi->uvik", fit.jacobian)
    u, v = problem.magnitude.shape
    by_matrix = by_own[..., 3:].reshape(u, v, 3, 3, 3)
    leverage = np.einsum("uvii->uvi", by_own[..., :3]) + np.einsum("uviij,uvj->uvi", by_matrix, problem.true)
    return np.asarray(np.clip(leverage, 0.0, 1.0))
