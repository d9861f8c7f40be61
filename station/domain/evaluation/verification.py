"""The last proof: what the device itself puts out, corrected by its own new coefficients, against the truth."""

from dataclasses import dataclass

import numpy as np
import scipy

from station.domain.core.types import Calibration, Floats, Reason
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.methods.decision import Decision, decide_limit
from station.domain.noise import resolution
from station.domain.noise.dwell_statistics import measure
from station.domain.recipe import assumptions, references
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: What decisions on verify positions are called, before the position's name.
WHAT = "verification"
#: An error that chance would make this rarely tells of something between calibration and output that is not right.
MIN_P_VALUE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedPosition:
    """One verify position: mean (3) of the compensated output, true (3) stimulus (NaN where the pose is unknown)
    and its magnitude, in the recipe's unit; cov (3, 3): how far off the mean is forecast to be, or None; measured
    (3, 3): covariance of the error as it was measured, by dwell and stimulus, or None."""

    position: str
    mean: Floats
    true: Floats
    strength: float
    cov: Floats | None = None
    measured: Floats | None = None

    @property
    def error(self) -> float:
        """Length of the difference, in the recipe's unit; of the magnitudes where the pose is unknown."""
        if not np.isfinite(self.true).all():
            return abs(float(np.linalg.norm(self.mean)) - self.strength)
        return float(np.linalg.norm(self.mean - self.true))

    @property
    def std(self) -> float:
        """Standard uncertainty of the error, along it; of one too small to have a direction, the largest there is."""
        if self.measured is None:
            return 0.0
        known = np.isfinite(self.true).all()
        off = self.mean - self.true if known else self.mean
        along = off / max(float(np.linalg.norm(off)), 1e-300)
        widest = float(np.linalg.eigvalsh(self.measured)[-1])
        own = float(along @ self.measured @ along)
        return float(np.sqrt(widest if known and self.error**2 < widest else own))

    @property
    def chance(self) -> float | None:
        """Probability of an error as large by chance, if calibration, noise and poses are what they are said to be."""
        if self.cov is None:
            return None
        if not np.isfinite(self.true).all():
            along = self.mean / np.linalg.norm(self.mean)
            return float(scipy.special.chdtrc(1, self.error**2 / (along @ self.cov @ along)))
        off = self.mean - self.true
        return float(scipy.special.chdtrc(3, off @ np.linalg.solve(self.cov, off)))


def error_covariance(found: CalibrationResult, recipe: Recipe, true: Floats, reading: Floats) -> Floats | None:
    """Covariance (3, 3) of the error at a verify position, from the calibration and what is measured there.

    true (3) or NaN; reading (n, 3) of the verify dwell. The calibration's own covariance is carried to this stimulus;
    noise and rounding of the dwell, the declared or found error of its pose, and scatter between visits come on top.
    """
    calibration, budget = found.calibration, found.budget
    if calibration is None or budget is None or len(reading) < 2:
        return None
    at = true if np.isfinite(true).all() else np.asarray(reading.mean(axis=0))
    by_coefficient = np.concatenate([np.eye(3), np.kron(np.eye(3), at)], axis=1)
    carried = by_coefficient @ calibration.covariance @ by_coefficient.T
    inverse = np.linalg.inv(calibration.matrix)
    pose = _pose_variance(calibration, recipe) * (at @ at * np.eye(3) - np.outer(at, at))
    fitted = inverse @ (carried + budget.scatter**2 * np.eye(3)) @ inverse.T
    return np.asarray(fitted + _of_dwell(reading, recipe.device.lsb) + pose)


def measured_covariance(
    found: CalibrationResult, recipe: Recipe, at: tuple[str, str], true: Floats, reading: Floats
) -> Floats | None:
    """Covariance (3, 3) of an error as it was measured: of the dwell, of this pose, and of the stimulus itself.

    at: position and seating; true (3) or NaN; reading (n, 3) of the verify dwell. What the stimulus may be wrong by the
    calibration shares, so that it does not show as an error, and is in what the device puts out all the same.
    """
    if found.calibration is None or len(reading) < 2:
        return None
    of_dwell = _of_dwell(reading, recipe.device.lsb)
    if not np.isfinite(true).all():
        mean = np.asarray(reading.mean(axis=0))
        return np.asarray(of_dwell + assumptions.magnitude_relative_std(recipe) ** 2 * np.outer(mean, mean))
    pose = _pose_variance(found.calibration, recipe) * (true @ true * np.eye(3) - np.outer(true, true))
    return np.asarray(of_dwell + pose + references.stimulus_covariance(recipe, *at, true))


def _pose_variance(calibration: Calibration, recipe: Recipe) -> float:
    """Variance of a pose about each axis, rad²: as declared, or as the tilts of the fit show it if that is more."""
    tilts = np.deg2rad(calibration.tilt_deg[~calibration.disturbed])
    return max(float(np.deg2rad(recipe.reference.pose_std_deg or 0.0)) ** 2, float((tilts**2).mean()) / 2)


def _of_dwell(reading: Floats, lsb: float) -> Floats:
    """Covariance (3, 3) of a dwell's mean by noise and rounding."""
    one = np.zeros(1, np.int64)
    dwell = measure(reading, one, np.array([len(reading)]), one)
    noise = resolution.noise_under(np.full(3, lsb), dwell.std)
    root = np.sqrt(dwell.variance[0])
    rounding = np.diag(resolution.rounding_variance(np.full(3, lsb), noise))
    return np.asarray(root[:, None] * dwell.correlation[0] * root + rounding + 1e-30 * np.eye(3))


def verify_decisions(verified: tuple[VerifiedPosition, ...], recipe: Recipe) -> tuple[Decision, ...]:
    """What the recipe's limit came to at each verify position, by the rule of all limits; none without a limit."""
    limit, limits, unit = recipe.verify.limit, recipe.limits, recipe.unit
    if limit is None:
        return ()
    return tuple(decide_limit(limits, (f"{WHAT} {v.position}", unit), v.error, v.std, limit) for v in verified)


def check(verified: tuple[VerifiedPosition, ...], recipe: Recipe) -> tuple[Reason, ...]:
    """A reason for each verify position whose error is not accepted; without a limit, is beyond the forecast."""
    if recipe.verify.limit is None:
        return tuple(
            _unexpected_error(v, recipe.unit) for v in verified if v.chance is not None and v.chance < MIN_P_VALUE
        )
    decided = zip(verified, verify_decisions(verified, recipe), strict=True)
    return tuple(_refused(v, d) for v, d in decided if not d.accepted)


def _refused(v: VerifiedPosition, d: Decision) -> Reason:
    message = Message(
        "output-beyond-limit", position=v.position, value=d.value, unit=d.unit, limit=d.limit, guard=d.guard
    )
    return Reason(message, d.value, d.limit - d.guard, d.unit, check="verify")


def _unexpected_error(v: VerifiedPosition, unit: str) -> Reason:
    message = Message("output-beyond-forecast", position=v.position, value=v.error, unit=unit)
    return Reason(message, v.error, None, unit, check="verify")
