"""Standard errors of dwell means: the noise of a unit's dwells pooled, shape by shape (station.domain.noise.noise)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.domain.noise import noise
from station.domain.noise.noise_prior import NoisePrior

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class UnitRows:
    """Where each unit's dwells stand. first (u) row of its first dwell; of (d) unit number of each dwell;
    step, reach (u): see station.domain.noise.noise; informed (u) bool: whether a prior is heard."""

    first: Ints
    of: Ints
    step: Ints
    reach: Ints
    informed: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class DwellGroup:
    """Dwells of one length: rows (g) among all dwells, their count of readings, the cut, block means (g, 3, b)."""

    rows: Ints
    count: int
    cut: noise.BlockCut
    blocks: Floats


@dataclass(frozen=True, slots=True, eq=False)
class StandardErrors:
    """variance (d, 3) of the mean; dof (d, 3) of that variance; drift_z (d, 3) in standard deviations."""

    variance: Floats
    dof: Floats
    drift_z: Floats


def standard_errors(
    groups: Sequence[DwellGroup], variance_ratio: Floats, units: UnitRows, prior: NoisePrior | None = None
) -> StandardErrors:
    """Errors of all dwells. variance_ratio (d, 3): of a dwell to the unit's usual one; prior: for informed units."""
    errors = StandardErrors(np.zeros_like(variance_ratio), np.zeros_like(variance_ratio), np.zeros_like(variance_ratio))
    for step, reach, informed in np.unique(np.stack([units.step, units.reach, units.informed], axis=1), axis=0):
        member = (units.step == step) & (units.reach == reach) & (units.informed == informed)
        number = np.where(member, np.cumsum(member) - 1, -1)[units.of]
        mine = [_only(g, number[g.rows] >= 0) for g in groups if g.cut.step == step]
        _fill(
            errors, [g for g in mine if len(g.rows)], variance_ratio, number, (int(reach), prior if informed else None)
        )
    return errors


def _only(group: DwellGroup, keep: NDArray[np.bool_]) -> DwellGroup:
    return DwellGroup(group.rows[keep], group.count, group.cut, group.blocks[keep])


def _fill(
    errors: StandardErrors,
    groups: Sequence[DwellGroup],
    variance_ratio: Floats,
    number: Ints,
    known: tuple[int, NoisePrior | None],
) -> None:
    """Fills the rows of units that share a family; number (d): their unit among these; known: its reach, a prior."""
    reach, prior = known
    families = [noise.family(g.cut.blocks, g.cut.width, reach) for g in groups]
    units = int(number.max()) + 1
    shapes = len(families[0].log_prior)
    misfit, dof, log_det = np.zeros((units, 3, shapes)), np.zeros((units, 1)), np.zeros((units, shapes))
    leading = []
    for g, f in zip(groups, families, strict=True):
        coefficient = (g.blocks / np.sqrt(variance_ratio[g.rows])[..., None]) @ f.transform.T
        leading.append(coefficient[..., min(1, g.cut.blocks - 1)])
        first = np.flatnonzero(np.r_[True, np.diff(number[g.rows]) > 0])
        who = number[g.rows][first]
        # A dwell that is odd in one axis was disturbed or moved: it says nothing of the usual noise.
        usual = (variance_ratio[g.rows] == 1).all(axis=1)
        many = np.add.reduceat(usual.astype(float), first)
        misfit[who] += np.add.reduceat(coefficient**2 * usual[:, None, None], first) @ f.inverse
        dof[who, 0] += many * (g.cut.blocks - 1)
        log_det[who] += many[:, None] * f.log_det
    dof = np.maximum(dof, 1.0)
    if prior is None:
        weight, variance = noise.posterior(misfit, dof, log_det, families[0].log_prior)
    else:
        weight, variance, dof = prior.posterior(misfit, dof, log_det)
    for g, f, c in zip(groups, families, leading, strict=True):
        who, own = number[g.rows], variance_ratio[g.rows]
        shrink = g.cut.blocks * g.cut.samples / g.count
        mean_variance, nu = noise.average_shapes(weight, variance * f.mean_variance * shrink, dof)
        errors.variance[g.rows] = mean_variance[who] * own
        # A variance of its own is known only as well as one dwell tells.
        errors.dof[g.rows] = 1 / (1 / nu[who] + np.where(own != 1, 2 / max(g.count - 1, 1), 0.0))
        if g.cut.blocks > 1:
            usual = (weight * variance / f.inverse[1]).sum(axis=-1)
            errors.drift_z[g.rows] = c / np.sqrt(np.maximum(usual[who], 1e-300))
