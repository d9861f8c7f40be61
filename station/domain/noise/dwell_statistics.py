"""What the readings of dwells come to: robust means, their standard errors, and signs of trouble. Bulk, no names.

Everything is worked out dwell by dwell or unit by unit, in an order that does not depend on what else is in the
table: one unit alone gives the same bits as a thousand together.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.medians import medians
from station.domain.core.types import Floats
from station.domain.noise import noise, noise_prior
from station.domain.noise.noise_prior import NoisePrior
from station.domain.noise.standard_error import DwellGroup, Ints, UnitRows, standard_errors

#: A reading further from the median than this many robust standard deviations is left out (more in short dwells).
OUTLIER_SIGMA = 6.0
#: From here on (a normal deviate) a dwell's variance is its own, not that of the unit's other dwells.
ODD_VARIANCE_SIGMA = 4.5
#: Readings looked at together: enough to be fast, few enough for a processor's cache.
CHUNK_READINGS = 1 << 14


@dataclass(frozen=True, slots=True, eq=False)
class DwellStatistics:
    """Dwells (d) of three axes. count, rejected (d) readings; mean, std (d, 3) without the rejected; variance
    (d, 3) of the mean from noise alone, widened for being an estimate (noise.widening); dof (d, 3) of it;
    correlation (d, 3, 3) between axes; drift (d, 3) first half minus second half; drift_z (d, 3) the same in
    standard deviations; low, high (d, 3) least and greatest reading; step (d, 3) least difference of neighbours
    that differ, infinite when all are alike.
    """

    count: Ints
    rejected: Ints
    mean: Floats
    std: Floats
    variance: Floats
    dof: Floats
    correlation: Floats
    drift: Floats
    drift_z: Floats
    low: Floats
    high: Floats
    step: Floats


#: Per-dwell sums, filled for all dwells of one length at a time: name → trailing shape.
_COLUMNS = {
    "rejected": (),
    "mean": (3,),
    "square": (3,),
    "neighbours": (3,),
    "cross": (3, 3),
    "drift": (3,),
    "low": (3,),
    "high": (3,),
    "step": (3,),
}
Columns = dict[str, Floats]


def measure(reading: Floats, start: Ints, count: Ints, unit: Ints, prior: NoisePrior | None = None) -> DwellStatistics:
    """Dwell d is reading[start[d] : start[d] + count[d]], readings (n, 3); `unit` (d) never falls.

    prior: what is known of such units' noise.
    """
    columns = {name: np.zeros((len(start), *shape)) for name, shape in _COLUMNS.items()}
    units = _units(count, unit, prior)
    groups = []
    for rows, n, cut in _by_length(count, units):
        parts = [
            block_means(_fill_columns(_rows_of(reading, start[part], n), columns, part), cut)
            for part in np.split(rows, range(max(CHUNK_READINGS // n, 1), len(rows), max(CHUNK_READINGS // n, 1)))
        ]
        groups.append(DwellGroup(rows, n, cut, np.concatenate(parts)))
    ratio = variance_ratios(columns["square"], columns["neighbours"], count, units)
    errors = standard_errors(groups, ratio, units, prior)
    return DwellStatistics(
        count=count,
        rejected=columns["rejected"].astype(np.int64),
        mean=columns["mean"],
        std=np.sqrt(columns["square"] / np.maximum(count - 1, 1)[:, None]),
        variance=errors.variance * noise.widening(errors.dof),
        dof=errors.dof,
        correlation=_correlation(columns, count, units),
        drift=columns["drift"],
        drift_z=errors.drift_z,
        low=columns["low"],
        high=columns["high"],
        step=columns["step"],
    )


def _units(count: Ints, unit: Ints, prior: NoisePrior | None) -> UnitRows:
    first = np.flatnonzero(np.r_[True, unit[1:] != unit[:-1]])
    longest = np.maximum.reduceat(count, first)
    informed = np.array([noise_prior.applies(prior, int(n)) for n in longest])
    scales = [
        (prior.step, prior.reach)
        if noise_prior.applies(prior, int(n))
        else (noise.step_of(int(n)), noise.reach_of(int(n)))
        for n in longest
    ]
    step, reach = np.array(scales).T
    return UnitRows(
        first=first,
        of=np.repeat(np.arange(len(first)), np.diff(np.r_[first, len(unit)])),
        step=step,
        reach=reach,
        informed=informed,
    )


def _by_length(count: Ints, units: UnitRows) -> Iterator[tuple[Ints, int, noise.BlockCut]]:
    """Rows of dwells that are as long and are cut alike, with their length and cut."""
    step = units.step[units.of]
    for n, samples in np.unique(np.stack([count, step], axis=1), axis=0):
        yield np.flatnonzero((count == n) & (step == samples)), int(n), noise.cut(int(n), int(samples))


def _rows_of(reading: Floats, start: Ints, n: int) -> Floats:
    """Dwells (d, 3, n) that begin at `start` (d) of readings (…, 3)."""
    return np.ascontiguousarray(reading[start[:, None] + np.arange(n)].transpose(0, 2, 1))


def _fill_columns(x: Floats, columns: Columns, rows: Ints) -> Floats:
    """Fills the columns of dwells x (d, 3, n); returns deviations from the mean, 0 where rejected."""
    n = x.shape[2]
    least = least_step(x)
    mean, deviation, accepted = deviations(x, least)
    half = max(n // 2, 1)
    columns["rejected"][rows] = n - accepted
    columns["mean"][rows] = mean
    columns["square"][rows], columns["neighbours"][rows] = squares(deviation)
    columns["cross"][rows] = deviation @ deviation.transpose(0, 2, 1)
    columns["drift"][rows] = deviation[..., :half].mean(axis=2) - deviation[..., n - half :].mean(axis=2)
    columns["low"][rows], columns["high"][rows] = x.min(axis=2), x.max(axis=2)
    columns["step"][rows] = least
    return deviation


def least_step(x: Floats) -> Floats:
    """Least difference (d, 3) of neighbours of dwells x (d, 3, n) that differ; infinite when all are alike."""
    apart = np.abs(np.diff(x, axis=2))
    return np.asarray(np.where(apart > 0, apart, np.inf).min(axis=2, initial=np.inf))


def deviations(x: Floats, least: Floats) -> tuple[Floats, Floats, Ints]:
    """Means (d, 3) of dwells x (d, 3, n) without what is far off, deviations (d, 3, n) from them, 0 where left out,
    and how many readings (d) were kept. least (d, 3): see least_step."""
    n = x.shape[2]
    off = np.abs(x - medians(x)[..., None])
    step = np.where(np.isfinite(least), least, 0.0)[..., None]
    # Coarse readings may have no median deviation at all: half lie within half a step, by noise of .74 steps at most.
    scale = 1.4826 * np.maximum(medians(off)[..., None], step / 2)
    bound = OUTLIER_SIGMA * (1 + 8 / n) * scale + 2 * step
    keep = (off <= bound).all(axis=1, keepdims=True)
    accepted = keep.sum(axis=2, keepdims=True)
    mean = np.where(keep, x, 0.0).sum(axis=2, keepdims=True) / accepted
    return mean[..., 0], np.where(keep, x - mean, 0.0), accepted[:, 0, 0]


def squares(deviation: Floats) -> tuple[Floats, Floats]:
    """Sums (d, 3) of squares of deviations (d, 3, n), and of products of neighbours."""
    return (deviation**2).sum(axis=2), (deviation[..., 1:] * deviation[..., :-1]).sum(axis=2)


def block_means(deviation: Floats, cut: noise.BlockCut) -> Floats:
    """Means (d, 3, blocks) of the blocks of a cut; a dwell shorter than one block is one block."""
    if cut.samples == 1:
        return deviation
    used = deviation[..., : cut.blocks * cut.samples]
    return np.asarray(used.reshape(*used.shape[:2], cut.blocks, -1).mean(axis=3))


def variance_ratios(square: Floats, neighbours: Floats, count: Ints, units: UnitRows) -> Floats:
    """Variance of a sample over that of the unit's usual dwell (d, 3); 1 where the two agree. square, neighbours
    (d, 3): see squares.

    Agreement is a normal deviate below ODD (Wilson & Hilferty 1931), with degrees of freedom for first-order
    noise, (n − 1)(1 − φ²)/(1 + φ²).
    """
    variance = square / np.maximum(count - 1, 1)[:, None]
    usual = _medians(variance, units)[units.of]
    # About its own mean a short dwell looks less correlated than it is (Marriott & Pope 1954, Biometrika 41).
    n = np.maximum(count, 4)[:, None]
    phi = np.clip((n * neighbours / np.maximum(square, 1e-300) + 1) / (n - 3), 0.0, 0.97)
    phi = _medians(phi, units)[units.of]
    dof = np.maximum((count - 1)[:, None] * (1 - phi**2) / (1 + phi**2), 1.0)
    ratio = np.where(usual > 0, variance / np.where(usual > 0, usual, 1.0), 1.0)
    spread = 2 / (9 * dof)
    deviate = np.abs(np.cbrt(ratio) - (1 - spread)) / np.sqrt(spread)
    return np.where((deviate > ODD_VARIANCE_SIGMA) & (ratio > 0), ratio, 1.0)


def _medians(value: Floats, units: UnitRows) -> Floats:
    """Median (u, 3) over each unit's dwells of value (d, 3): the lower one of two."""
    size = np.diff(np.r_[units.first, len(value)])
    middle = units.first + (size - 1) // 2
    return np.stack([column[np.lexsort((column, units.of))][middle] for column in value.T], axis=1)


def _correlation(columns: Columns, count: Ints, units: UnitRows) -> Floats:
    """Correlation (d, 3, 3) between the axes' noise over all dwells of the unit; 0 where it is not significant."""
    cross = np.add.reduceat(columns["cross"], units.first)
    size = np.add.reduceat(count, units.first)
    root = np.sqrt(np.maximum(np.einsum("uii->ui", cross), 1e-300))
    found = np.clip(cross / (root[:, :, None] * root[:, None, :]), -0.999, 0.999)
    bound = 4 / np.sqrt(size)
    found = np.where(np.abs(found) > bound[:, None, None], found, 0.0)
    found[:, range(3), range(3)] = 1.0
    return found[units.of]


#: A dwell at an extreme with less than this share of the usual scatter has a flat top.
FLAT_SHARE = 0.2
#: A shorter dwell says nothing.
MIN_READINGS = 8
#: Readings that go from one code to the next, and no further, scatter by where they lie between the two.
TWO_CODES = 1.5


def flat_topped(dwells: DwellStatistics) -> NDArray[np.bool_]:
    """Dwells (d, 3) of one unit that a limited range cuts: at the axis' greatest or least reading, without the scatter
    that the axis has elsewhere, or with most readings exactly at that extreme.

    Readings coarser than their noise say nothing: they are constant but near the edge between two codes. Where all axes
    stand still, and not all at an end, the sensor froze.
    """
    step = dwells.step.min(axis=0)
    coarse = np.isfinite(step) & (medians((dwells.high - dwells.low).T) < TWO_CODES * step)
    usual = medians(dwells.std.T)
    sufficient = (dwells.count >= MIN_READINGS)[:, None] & (len(dwells.count) > 2)
    out = np.zeros(dwells.mean.shape, bool)
    for extreme, at, side in (
        (dwells.high.max(axis=0), dwells.high, 1.0),
        (dwells.low.min(axis=0), dwells.low, -1.0),
    ):
        # What is cut on one side leaves a mean nearer to the extreme than the scatter of a whole dwell allows.
        near = side * (extreme - dwells.mean) < 0.5 * usual
        quiet = dwells.std < FLAT_SHARE * usual
        out |= (at == extreme) & near & quiet & sufficient
    frozen = (dwells.high == dwells.low).all(axis=1) & ~out.all(axis=1)
    return np.asarray(out & (usual > 0) & ~coarse & ~frozen[:, None])
