"""What other ways to choose a cause make of the same readings and the same signatures.

All get the calibration-free columns of every cause of the library at every shape and level, whitened by the true
white floor, and need not compete with kernels of the unknown. STLSQ and the forest get each cause at its usual level
and best-fitting shape. The omnibus test takes the noise from one sample to the next and only detects.
"""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from station.diagnosis.candidates.bank import Candidate, candidates, cause_library, is_testable
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.results.diagnose import Diagnosis

Array = Any
#: STLSQ keeps coefficients beyond so many standard errors; a library of unit columns in white noise has errors of 1.
STANDARD_ERRORS = 3.0
TREES = 50
#: A direction that keeps less than this share of the longest one is lost in the calibration.
RANK = 1e-6


@dataclass(frozen=True, eq=False)
class Readings:
    """Stops' means and contrasts in units of their noise, free of each unit's offset and gain: data (v, m); free
    turns columns (v, m, k) into the same."""

    view: ResidualView
    data: Array
    scale: Array
    basis: tuple[tuple[Array, Array], ...]

    @staticmethod
    def of(view: ResidualView) -> "Readings":
        """The readings of a view of the ideal simulation."""
        r = view.reduced
        scale = np.sqrt(r.count.sum(1)) / r.sigma
        calibration = scale[:, None, None] * view.calibration(matrix=False)
        unit = view.scene.visits.unit.code
        parts = [np.flatnonzero(unit == u) for u in np.unique(unit)]
        basis = tuple((at, np.linalg.qr(calibration[at].reshape(-1, calibration.shape[2]))[0]) for at in parts)
        mean, contrast = view.simulated()
        bare = Readings(view, np.zeros(0), scale, basis)
        rows = bare.white((r.mean - mean)[..., None], (r.contrast - contrast)[..., None])
        return Readings(view, rows[..., 0], scale, basis)

    def white(self, stop: Array, dwell: Array | None) -> Array:
        """Columns (v, 3, k) and (v, B−1, 3, k) as (v, m, k)."""
        stop = stop * self.scale[:, None, None]
        for at, Q in self.basis:
            flat = stop[at].reshape(len(at) * 3, -1)
            stop[at] = (flat - Q @ (Q.T @ flat)).reshape(len(at), 3, -1)
        r = self.view.reduced
        within = np.zeros((*r.contrast.shape, stop.shape[2])) if dwell is None else dwell / r.sigma
        return np.concatenate([stop, within.reshape(len(stop), -1, stop.shape[2])], axis=1)

    @property
    def count(self) -> int:
        """Numbers left."""
        return int(np.count_nonzero(self.data)) - sum(int(Q.shape[1]) for _, Q in self.basis)


@dataclass(frozen=True, eq=False)
class Fit:
    """A cause by least squares: orthonormal columns (rows, k), the sum of squares they take up, and among how many
    groups they were chosen."""

    candidate: Candidate
    basis: Array
    drop: float
    among: int = 1

    @property
    def count(self) -> int:
        """Coefficients."""
        return int(self.basis.shape[1])


def named(d: Diagnosis, seed: int = 1) -> Mapping[str, str]:
    """The cause that each way names."""
    readings = Readings.of(d.search_result.first.view)
    fits = list(_fits(readings))
    rss, n = float(np.sum(readings.data**2)), readings.count
    log_left = {id(f): float(np.log(max(rss - f.drop, 1e-9 * rss))) for f in fits}

    def least(score: Any) -> str:
        return str(min(fits, key=score).candidate.name)

    def log_p(f: Fit) -> float:
        ratio = (f.drop / f.count) / ((rss - f.drop) / (n - f.count))
        return float(stats.f.logsf(ratio, f.count, n - f.count) + np.log(f.among))

    usual = [f for f in fits if f.candidate.effect is not None and f.candidate.of == f.candidate.effect.of[0]]
    best = list({f.candidate.name: f for f in sorted(usual, key=lambda f: f.drop)}.values())
    return {
        "smallest p": least(log_p),
        "AIC": least(lambda f: n * log_left[id(f)] + 2 * f.count),
        "BIC": least(lambda f: n * log_left[id(f)] + np.log(n) * f.count),
        "STLSQ (pysindy)": _stlsq(best, readings),
        "random forest (scikit-learn)": _forest(best, readings, seed),
    }


def omnibus(d: Diagnosis) -> bool:
    """Whether χ² of all stops' means is beyond its 99 % quantile."""
    readings = Readings.of(d.search_result.first.view)
    means = readings.data[:, :3]
    return bool(stats.chi2.sf(np.sum(means**2), means.size - sum(Q.shape[1] for _, Q in readings.basis)) < 0.01)


def _fits(readings: Readings) -> Iterator[Fit]:
    """Least squares for every cause at every shape and level that leaves anything; of many groups the best one."""
    view = readings.view
    effects = [e for e in cause_library(view.scene.recipe) if is_testable(e, view)]
    y = readings.data.ravel()
    for candidate in (c for e in effects for c in candidates(e, view)):
        X = readings.white(candidate.visit, candidate.dwell)
        if candidate.pattern == "scan":
            alone = [Fit(candidate, B, float(np.sum((B.T @ y) ** 2))) for B in _each_group(candidate, readings)]
            best = max(alone, key=lambda f: f.drop)
            yield Fit(candidate, best.basis, best.drop, len(alone))
            continue
        code, groups = candidate.code, len(candidate.names)
        wide = _grouped(candidate, readings, code, groups) if groups > 1 else X.reshape(len(y), -1)
        B = _basis(wide)
        if B.shape[1]:
            yield Fit(candidate, B, float(np.sum((B.T @ y) ** 2)))


def _grouped(candidate: Candidate, readings: Readings, code: Array, groups: int) -> Array:
    """Columns (rows, groups · a) of all groups side by side."""
    rows = np.arange(len(code))
    stop = np.zeros((len(code), 3, groups, candidate.axes))
    stop[rows, :, code] = candidate.visit
    dwell = None
    if candidate.dwell is not None:
        dwell = np.zeros((*candidate.dwell.shape[:3], groups, candidate.axes))
        dwell[rows, :, :, code] = candidate.dwell
        dwell = dwell.reshape(*dwell.shape[:3], -1)
    white = readings.white(stop.reshape(len(code), 3, -1), dwell)
    return white.reshape(-1, groups * candidate.axes)


def _each_group(candidate: Candidate, readings: Readings) -> Iterator[Array]:
    """Orthonormal columns of each group alone."""
    wide = _grouped(candidate, readings, candidate.code, len(candidate.names))
    for part in np.split(wide, len(candidate.names), axis=1):
        B = _basis(part)
        if B.shape[1]:
            yield B


def _basis(columns: Array) -> Array:
    """Orthonormal columns for the same span, by the normal matrix: they are few beside the rows."""
    m, E = np.linalg.eigh(columns.T @ columns)
    stored = m > max(RANK * m.max(initial=0.0), 1e-12)
    return columns @ (E[:, stored] / np.sqrt(m[stored]))


def _stlsq(fits: list[Fit], readings: Readings) -> str:
    """The cause with the largest coefficient that sequentially thresholded least squares keep; "" for none."""
    from pysindy import STLSQ

    X = np.concatenate([f.basis for f in fits], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = STLSQ(threshold=STANDARD_ERRORS, alpha=0.05).fit(X, readings.data.reshape(-1, 1)).coef_[0]
    ends = np.cumsum([f.count for f in fits])
    largest = [float(np.max(np.abs(part), initial=0.0)) for part in np.split(found, ends[:-1])]
    return fits[int(np.argmax(largest))].candidate.name if max(largest) > 0 else ""


def _forest(fits: list[Fit], readings: Readings, seed: int) -> str:
    """The cause whose signature a forest finds most important beside unit and axis, for the residual of each stop."""
    from sklearn.ensemble import RandomForestRegressor

    view = readings.view
    shapes = [f.candidate.visit.sum(axis=-1).ravel() for f in fits]
    unit = np.repeat(view.scene.visits.unit.code, 3)
    X = np.stack([*shapes, unit, np.tile([0, 1, 2], len(unit) // 3)], axis=1)
    forest = RandomForestRegressor(n_estimators=TREES, random_state=seed, n_jobs=1, max_features=0.5)
    importance = forest.fit(X, readings.data[:, :3].ravel()).feature_importances_[: len(fits)]
    return fits[int(np.argmax(importance))].candidate.name
