"""Would a bent response explain more? Quadratic and cubic terms, judged on poses that were left out.

In sample a larger model always fits better; on a pose it has not seen it need not. Both are told: the F test, and the
residual leaving one pose out, by the linear fit's own leverages (Cook & Weisberg 1982, sect. 3.6, for groups).
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from station.domain.capture import rest_segments
from station.domain.core.types import Floats, ReducedVisits
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.methods import method, rank
from station.domain.recipe.recipe import Recipe

#: A larger model is taken when chance would gain as much this rarely, and it also gains on poses left out.
LEVEL = 0.01


@dataclass(frozen=True, slots=True)
class LargerModel:
    """One larger model against the present one: p of the F test (NaN where it cannot be fitted), rms left out
    before and after in the recipe's unit, and whether it pays."""

    terms: str
    p: float
    rms: float
    rms_left_out: float
    larger_rms: float
    larger_rms_left_out: float
    pays: bool


def compare(rows: Floats, more: dict[str, Floats], misfit: Floats, group: NDArray[np.intp]) -> tuple[LargerModel, ...]:
    """Every larger model against the present linear one.

    rows (n, k): present design; more: further columns (n, q) by name; misfit (n): residuals of the present fit, in
    the recipe's unit; group (n): number of the pose.
    """
    before, left_out = _fitted(rows, misfit, group)
    return tuple(_one(name, rows, columns, (before, left_out), misfit, group) for name, columns in more.items())


def _one(
    name: str, rows: Floats, columns: Floats, before: tuple[Floats, Floats], misfit: Floats, group: NDArray[np.intp]
) -> LargerModel:
    wide = np.column_stack([rows, columns])
    dof = len(wide) - wide.shape[1]
    summary = (name, float("nan"), _rms(before[0]), _rms(before[1]))
    if dof < 1 or rank.of(wide) < wide.shape[1]:
        return LargerModel(*summary, float("nan"), float("nan"), pays=False)
    after, after_out = _fitted(wide, misfit, group)
    drop = float((before[0] ** 2).sum() - (after**2).sum())
    q = columns.shape[1]
    p = float(scipy.special.fdtrc(q, dof, drop / q / max(float((after**2).sum()) / dof, 1e-300)))
    pays = p < LEVEL and _rms(after_out) < _rms(before[1])
    return LargerModel(name, p, *summary[2:], _rms(after), _rms(after_out), pays=pays)


def _fitted(rows: Floats, misfit: Floats, group: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Residuals (n) of a linear fit, and those of each group from a fit without it: (I − H_gg)⁻¹ r_g."""
    q, _ = np.linalg.qr(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300))
    r = misfit - q @ (q.T @ misfit)
    out = r.copy()
    for g in np.unique(group):
        at = group == g
        H = q[at] @ q[at].T
        out[at] = np.linalg.lstsq(np.eye(len(H)) - H, r[at], rcond=None)[0]
    return r, out


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))


def of_unit(recipe: Recipe, result: CalibrationResult) -> tuple[LargerModel, ...]:
    """Quadratic and cubic terms on each axis for a calibrated unit; nothing for methods with positions to match."""
    found, visits, kind = result.calibration, result.visits, method.of(recipe)
    if found is None or visits is None or not kind.open_ended:
        return ()
    used = ~found.disturbed
    corrected = found.correct(visits.mean)[used]
    group = _groups(recipe, visits, corrected, used)
    if kind.by_magnitude:
        size = np.asarray(np.linalg.norm(corrected, axis=1), float)
        known = np.asarray(np.linalg.norm(visits.true[used], axis=1), float)
        wanted: Floats = known if recipe.pose_known else np.full(len(size), recipe.reference.strength())
        rows, _ = kind.design(corrected, recipe, np.zeros((len(corrected), 0)))
        along = corrected / size[:, None]
        more = {"quadratic": along * corrected**2, "cubic": along * corrected**3}
        return compare(rows, more, np.asarray(size - wanted), group)
    true = visits.true[used]
    rows, _ = kind.design(true, recipe, np.zeros((len(true), 0)))
    # Axis by axis: all visits of x, then of y, then of z.
    wide = rows if len(rows) == 3 * len(true) else np.asarray(np.kron(np.eye(3), rows), float)
    more = {name: _columns_per_axis(true**power) for name, power in (("quadratic", 2), ("cubic", 3))}
    return compare(wide, more, found.residual[used].T.ravel(), np.tile(group, 3))


def _columns_per_axis(values: Floats) -> Floats:
    """Columns (3v, 3): each axis' values (v, 3) in its own rows."""
    v = len(values)
    out = np.zeros((3 * v, 3))
    for i in range(3):
        out[i * v : (i + 1) * v, i] = values[:, i]
    return out


def _groups(recipe: Recipe, visits: ReducedVisits, corrected: Floats, used: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Visits that are left out together: those of one pose; of hand-held visits, those that look alike."""
    if not recipe.pose_known:
        return rest_segments.orientations(corrected)
    keys = [k for k, keep in zip(zip(visits.position, visits.seating, strict=True), used, strict=True) if keep]
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    return np.array([number[k] for k in keys], np.intp)
