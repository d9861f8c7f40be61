"""Axes that are swapped or have the wrong sign, and readings off by a whole factor: the nearest of 48 signed
permutations."""

from collections.abc import Container
from dataclasses import dataclass, replace

import numpy as np

from station.diagnosis.data.faults.gross_fault import (
    BlockGain,
    FaultParameter,
    GrossFault,
    block_gain,
    halves_of,
    rows_of_units,
    unit_label,
)
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.recognition.ellipsoid import axis_parallel
from station.model.effects.axis_permutation import MAPPINGS, MATRICES
from station.model.scene import Scene

#: Factors of ranges and units; the last two are degrees and revolutions.
FACTORS = (0.001, 1 / 9.80665, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 9.80665, 16.0, 1000.0, 9806.65, 180 / np.pi)
#: A good unit's gain is within this factor of 1; a factor is taken for one of the list within the same.
GAIN_FACTOR = 1.15
#: Lengths that spread by more than this share do not tell a factor without the ellipsoid they lie on.
MAX_LENGTH_SPREAD = 0.1
#: Nats that a decoding is worth which no other visit can confirm.
PLAIN_NATS = 10.0
#: Likeness (cosine) of the fitted matrix to the best mapping, and how much better than to the right one.
MIN_COSINE, MIN_COSINE_LEAD = 0.9, 0.15


@dataclass(frozen=True, slots=True)
class AxisDecoding:
    """How a unit is decoded: number of its mapping, and the factor of its readings."""

    mapping: int
    factor: float
    measured: float


def wrong_decodings(scene: Scene, mean: Floats, clipped: Container[int]) -> dict[int, AxisDecoding]:
    """What is on the axes of each unit that is decoded wrongly; mean (v, 3) of the visits; clipped: the units whose
    readings are cut off, which makes them look smaller by any factor other than that of a range or unit."""
    found, true = {}, _nominal(scene)
    for u, rows in enumerate(rows_of_units(scene.visits.unit)):
        read = _by_pose(true[rows], mean[rows]) if scene.recipe.pose_known else _by_magnitude(scene, mean[rows])
        if read is not None and u in clipped and read.factor not in FACTORS:
            read = replace(read, factor=1.0)
        if read is not None and (read.mapping or read.factor != 1.0):
            found[u] = read
    return found


def mapping_by_pose(true: Floats, mean: Floats) -> int | None:
    """Number of the mapping between nominal vectors (v, 3) and readings (v, 3), 0 as it should be; None where they
    tell none."""
    found = _by_pose(true, mean)
    return None if found is None else found.mapping


def _by_pose(true: Floats, mean: Floats) -> AxisDecoding | None:
    """From the matrix between nominal vectors (v, 3) and readings (v, 3)."""
    A = np.concatenate([true, np.ones((len(true), 1))], axis=1)
    if np.linalg.matrix_rank(A, 1e-6 * max(float(np.abs(true).max()), 1e-30)) < 4:
        return None
    matrix = np.linalg.lstsq(A, mean, rcond=None)[0][:3].T
    size = float(np.linalg.norm(matrix))
    if size == 0.0:
        return None
    like = np.einsum("kij,ij->k", MATRICES, matrix) / (size * np.sqrt(3))
    best = int(np.argmax(like))
    if like[best] < MIN_COSINE:
        return None
    best = best if like[best] > like[0] + MIN_COSINE_LEAD else 0
    measured = float(np.median(np.einsum("ij,ij->i", MATRICES[best], matrix)))
    return AxisDecoding(best, _factor(measured), measured)


def _by_magnitude(scene: Scene, mean: Floats) -> AxisDecoding | None:
    """From the size of the ellipsoid that the readings lie on, or from their lengths where these agree and show no
    ellipsoid: an offset as large as the stimulus (hard iron) is no factor."""
    true = float(np.linalg.norm(scene.visits.stimulus[0]))
    length = np.linalg.norm(mean, axis=1)
    middle = float(np.median(length)) or 1.0
    found = axis_parallel(mean / middle)
    if found is not None:
        radius = found[1] * middle
        if radius.max() > GAIN_FACTOR**2 * radius.min():
            return None
        measured = float(np.median(radius)) / true
    elif float(np.std(length)) < MAX_LENGTH_SPREAD * middle:
        measured = middle / true
    else:
        return None
    factor = _factor(measured)
    return AxisDecoding(0, factor, measured) if factor in FACTORS else None


def _factor(measured: float) -> float:
    """1 for a good gain, a listed factor nearby, or the measured one."""
    if 1 / GAIN_FACTOR <= measured <= GAIN_FACTOR:
        return 1.0
    near = min(FACTORS, key=lambda f: abs(np.log(max(measured, 1e-12) / f)))
    return near if max(measured / near, near / max(measured, 1e-12)) < GAIN_FACTOR else measured


def faults(table: SampleTable, scene: Scene, found: dict[int, AxisDecoding], mean: Floats) -> list[GrossFault]:
    """The faults of the units that are decoded wrongly; mean (v, 3) of the visits."""
    turned = {u: r for u, r in found.items() if r.mapping}
    scaled = {u: r for u, r in found.items() if r.factor != 1.0}
    out = []
    if turned:
        numbers = tuple(
            FaultParameter("mapping", None, unit_label(table.unit, u), MAPPINGS[r.mapping], None, "")
            for u, r in turned.items()
        )
        u, r = next(iter(turned.items()))
        sentence = f"{MAPPINGS[r.mapping]} stands on x, y, z of {unit_label(table.unit, u)}"
        indistinguishable = _indistinguishable(scene, turned, len(table.unit.names))
        gain = _held_out_gain(scene, mean, {u: replace(r, factor=1.0) for u, r in turned.items()})
        out.append(GrossFault("axis-permutation", "unit", numbers, sentence, _nats(gain), indistinguishable, gain))
    if scaled:
        numbers = tuple(
            FaultParameter("factor", None, unit_label(table.unit, u), r.factor, 0.01 * r.factor, "1")
            for u, r in scaled.items()
        )
        u, r = next(iter(scaled.items()))
        sentence = f"{unit_label(table.unit, u)} reads {r.measured:.4g} times too much"
        gain = _held_out_gain(scene, mean, scaled)
        out.append(GrossFault("wrong-scale", "unit", numbers, sentence, _nats(gain), (), gain))
    return out


def _nats(gain: BlockGain | None) -> float:
    """The total gain of a decoding, for the alarm; where no gain was measured, that of an obvious fault."""
    return PLAIN_NATS if gain is None else max(gain.total, 0.0)


def _held_out_gain(scene: Scene, mean: Floats, found: dict[int, AxisDecoding]) -> BlockGain | None:
    """The gain of another decoding of some units at the visits it was not fitted to. Mapping, factor and offset are
    fitted to every second visit of a unit and predict the others; the comparison is the readings as they came with an
    offset alone. The spread is that of the fitted visits. Where only the length of the stimulus is known, lengths are
    predicted."""
    score, squares = [], np.zeros(2)
    true, of_unit = _nominal(scene), rows_of_units(scene.visits.unit)
    for u, read in found.items():
        rows = of_unit[u]
        y, x = mean[rows], true[rows]
        half = halves_of(len(y))
        turned = x @ MATRICES[read.mapping].T * read.factor
        if not scene.recipe.pose_known:
            y, x, turned = (np.linalg.norm(v, axis=1, keepdims=True) for v in (y, x, turned))
        for part in (0, 1):
            fitted, judged = half != part, half == part
            if fitted.sum() < 2 or not judged.any():
                continue
            sides = [_gaussian_scores(y, side, fitted, judged) for side in (x, turned)]
            score.append(sides[1][0] - sides[0][0])
            squares += [sides[0][1], sides[1][1]]
    if not score:
        return None
    every = np.concatenate(score)
    before, after = np.sqrt(squares / (len(every) * (3 if scene.recipe.pose_known else 1)))
    return block_gain(every, np.ones(len(every)), None, rms=(float(before), float(after)))


def _gaussian_scores(y: Floats, predicted: Floats, fitted: Array, judged: Array) -> tuple[Floats, float]:
    """Log-likelihood (j) of the visits judged, with offset and spread of those fitted, and their sum of squares."""
    offset = (y - predicted)[fitted].mean(0) if y.shape[1] == 3 else np.zeros(1)
    off = (y - predicted - offset)[fitted]
    spread = max(float(np.sqrt(np.mean(off**2))), 1e-6 * float(np.abs(y).max()), 1e-300)
    residual = (y - predicted - offset)[judged]
    return -0.5 * np.sum((residual / spread) ** 2 + 2 * np.log(spread), axis=1), float(np.sum(residual**2))


def _nominal(scene: Scene) -> Floats:
    """What an ideal part feels at each visit (v, 3)."""
    visits = scene.visits
    return np.asarray(np.einsum("vji,vj->vi", np.einsum("vij,vjk->vik", visits.nest_R, visits.seat_R), visits.stimulus))


def _indistinguishable(scene: Scene, turned: dict[int, AxisDecoding], units: int) -> tuple[str, ...]:
    """A proper rotation may be the mounting as well as the decoding; a mirror image can only be the decoding."""
    if any(np.linalg.det(MATRICES[r.mapping]) < 0 for r in turned.values()):
        return ()
    same = len(turned) == units and len({r.mapping for r in turned.values()}) == 1
    reseated = len(np.unique(np.round(scene.visits.seat_R, 6).reshape(len(scene.visits), -1), axis=0)) > 1
    return ("package-rotation", "nest-tilt") if same and not reseated else ("package-rotation",)


def corrected_readings(table: SampleTable, found: dict[int, AxisDecoding]) -> Floats:
    """Readings (n, 3) with the decoding corrected."""
    reading = table.reading.copy()
    units = rows_of_units(table.unit)
    for u, r in found.items():
        rows = units[u]
        reading[rows] = reading[rows] @ MATRICES[r.mapping] / r.factor
    return reading
