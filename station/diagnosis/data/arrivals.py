"""Whether dwells are livelier as they begin than as they end: a fixture that rings after each move, or creeps, by
another size or another way each time, so that the dwells have no course in common.

Noise of any colour takes as much of a wave that dies away from the first sample on as of the same wave backwards from
the last one. The sizes E and L that the dwells have of both, none above what a dwell usually has by far, differ by
chance as two samples of the same numbers do: t = mean(E − L) / √(2·var(L)/n) is Student's. Sizes are lengths of a few
normal numbers, to the power of 2/3, which makes them nearly normal (Wilson, Hilferty, Proc. Natl. Acad. Sci. 17, 684,
1931): otherwise a small mean would come with a small variance. n counts the numbers that are left of each piece where
the courses of the runs are taken off, since the dwells are alike by that.
"""

from collections.abc import Iterator

import numpy as np
import scipy
from numpy.typing import NDArray

from station.diagnosis.data.contrast_noise import without_courses
from station.diagnosis.data.visit_noise import MAD_PER_SIGMA
from station.domain.core.types import Array, Floats
from station.model.scene import Scene

#: Pieces that a dwell is cut into.
PIECES = 24
#: Waves in a dwell, and the shares of it after which a third of one is left, that are tried.
WAVES, FADES = np.arange(0.0, 10.5), (0.12, 0.3)
#: Dwells of which the livelier end is told, and how many medians of a dwell's sizes are the most that count.
LEAST_DWELLS, MOST_MEDIANS = 12, 2.5
#: Power of a length that is nearly normal.
NORMAL_POWER = 2 / 3
#: Units whose dwells are looked at: of many any trifle shows.
MOST_UNITS = 24
#: Standard deviations that a piece is from its dwell's mean at the most.
FURTHEST = 4.0


def pieces_of_dwells(reading: Floats, visit: NDArray[np.intp]) -> Array:
    """Means (v, PIECES, 3) of equal pieces of each dwell, in single precision, about their mean; zero of dwells that
    are short, or where the samples (n) are not in the order of the visits."""
    visits = int(visit.max()) + 1 if len(visit) else 0
    first = np.flatnonzero(np.diff(visit, prepend=-1))
    found = np.zeros((visits, PIECES, 3), np.float32)
    count = np.diff(np.append(first, len(visit)))
    long = count >= PIECES
    if len(first) != visits or not long.any():
        return found
    # As many samples in each piece, half of them from the first one on, half of them up to the last.
    each, back = count[long, None] // PIECES, np.arange(PIECES // 2, 0, -1)
    begin, end = first[long, None], (first + count)[long, None]
    starts = np.concatenate([begin + each * np.arange(PIECES // 2), end - each * back], axis=1)
    # What no piece holds stands between where it ends and the next one starts.
    edges = np.stack([starts, starts + each], axis=2).ravel()
    sums = np.add.reduceat(np.append(reading, np.zeros((1, 3)), axis=0), edges)
    means = sums[::2].reshape(*starts.shape, 3) / each[..., None]
    found[long] = means - means.mean(axis=1, keepdims=True)
    return found


def chance_of_early(pieces: Array, mean: Floats, scene: Scene) -> float:
    """How often noise makes dwells, by their pieces (v, PIECES, 3) and means (v, 3), as much livelier early than late;
    what each run's dwells have in common, or take from their moves, is none of it."""
    there = np.any(pieces, axis=(1, 2)) & (scene.visits.unit.code < MOST_UNITS)
    if np.count_nonzero(there) < LEAST_DWELLS:
        return 1.0
    usual = np.median(np.abs(pieces[there]), axis=(0, 1)) / MAD_PER_SIGMA
    # One outlier would stand in the course of its whole run.
    every = np.clip(pieces.astype(float), -FURTHEST * usual, FURTHEST * usual)
    apart = [without_courses(every[..., i], mean[:, i], scene, there) for i in range(3)]
    left, free = np.stack([rest for rest, _ in apart], axis=2), min(free for _, free in apart)
    if free < 2:
        return 1.0
    left = left / np.maximum(np.sqrt(np.mean(left**2, axis=(0, 1))), 1e-300)
    found = [_chance(left, free, wave) for wave in _dying_waves()]
    return min(1.0, len(found) * min(found))


def _dying_waves() -> Iterator[Floats]:
    """Orthonormal courses (PIECES, 1 or 2) of waves of any phase that die away, about their means."""
    t = (np.arange(PIECES) + 0.5) / PIECES
    for fade in FADES:
        for waves in WAVES:
            both = np.exp(-t / fade)[:, None] * np.stack(
                [np.cos(2 * np.pi * waves * t), np.sin(2 * np.pi * waves * t)], 1
            )
            yield np.linalg.qr((both - both.mean(axis=0))[:, : 2 if waves else 1])[0]


def _chance(left: Floats, free: int, wave: Floats) -> float:
    """How often what the early ends of the dwells have of a wave is as much more than what their late ends have, where
    so many dwells' worth of numbers are free."""
    early, late = (np.linalg.norm(way.T @ left, axis=(1, 2)) for way in (wave, wave[::-1]))
    most = MOST_MEDIANS * float(np.median(late))
    early, late = (np.minimum(size, most) ** NORMAL_POWER for size in (early, late))
    error = np.sqrt(2 * np.var(late, ddof=1) / free)
    return float(scipy.special.stdtr(free - 1, -np.mean(early - late) / error)) if error > 0 else 1.0
