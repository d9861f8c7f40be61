"""From samples to few robust numbers: a mean for each stop, and what changes within the stop.

A dwell is cut into sub-blocks that grow with the time since its first sample (shares .06, .09, .25, .60; the
blocks 0–.15–.4–1.0 s with the first one halved, so that a settling of .1 s shows its slope).
Each block gives a Huber mean. The blocks of a stop are then turned into their weighted mean and into contrasts that
are orthogonal to it: a cause that stands still during a dwell shows in the mean only, one that moves also in the
contrasts, and the noise of the two is independent.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.visit_noise import axis_noise, excess_variance, sample_noise
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.scene import COVARIATES, Scene, fit_temperature_slopes, scene_of_table

#: Ends of the sub-blocks as shares of the dwell.
BLOCK_EDGES = np.array([0.06, 0.15, 0.40, 1.0])
#: Gauss–Legendre nodes of a block, in standard deviations of its samples' times about their mean, and their weights.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4) * np.array([[np.sqrt(3.0)], [0.5]])
#: Huber's constant: 99 % efficient under Gauss; a t₅ tail is bounded.
HUBER_K = 2.0
#: In a block of fewer samples no mean can tell a wild one from the rest.
MIN_HUBER_SAMPLES = 7
#: Samples looked at together: enough to be fast, few enough for a processor's cache.
SAMPLES_AT_ONCE = 1 << 14


@dataclass(frozen=True, slots=True, eq=False)
class ReducedScene:
    """Stops (v) of a measured table. Readings in the recipe's unit.

    scene: one row a stop, at its mean time; fine: rows (v · B · nodes) inside the blocks, for causes that move
    during a dwell; mean (v, 3); contrast (v, B−1, 3), scaled so that it has the noise of a single sample;
    count (v, B) samples in each block; sigma: noise of a sample, from one to the next, axis_noise (3) that of each axis
    beside it, 1 where nothing shows that they differ; excess (v, 3) the square of a stop's noise beside that of all,
    axis_excess (v, 3) that which `count` leaves to each axis; rate_error (v, modes): by what the rate of temperature
    may be wrong, degC/s, each mode times a standard normal number a run.
    """

    scene: Scene
    fine: Scene
    mean: Floats
    contrast: Floats
    count: Floats
    sigma: float
    rate_error: Floats | None = None
    axis_noise: Floats = field(default_factory=lambda: np.ones(3))
    excess: Floats = field(default_factory=lambda: np.ones((1, 3)))
    axis_excess: Floats = field(default_factory=lambda: np.ones((1, 3)))

    def by_own_noise(self) -> "ReducedScene":
        """The same where each stop has the noise of its own samples: a noisier one counts as so many fewer at that of
        all."""
        e = self.excess.mean(1)
        count, contrast = self.count / e[:, None], self.contrast / np.sqrt(e)[:, None, None]
        return replace(self, count=count, contrast=contrast, axis_excess=self.excess / e[:, None])

    @property
    def rows_of_visit(self) -> int:
        """Rows of `fine` that a visit has."""
        return int(self.count.shape[1]) * len(NODES)

    def reduce_fine(self, rows: Floats, visits: NDArray[np.bool_] | None = None) -> tuple[Floats, Floats]:
        """Mean (v, c) and contrasts (v, B−1, c) of values on the rows of `fine` (v · B · nodes, c), or of those of some
        visits alone."""
        count = self.count if visits is None else self.count[visits]
        inside = rows.reshape(*count.shape, len(NODES), rows.shape[1])
        return mean_and_contrasts(inside.swapaxes(2, 3) @ WEIGHTS, count)


def mean_and_contrasts(block: Floats, count: Floats) -> tuple[Floats, Floats]:
    """Weighted mean (v, …) of block values (v, B, …) and the contrasts across it (v, B−1, …)."""
    root = np.sqrt(count)
    weighted = root.reshape(*root.shape, *[1] * (block.ndim - 2)) * block
    mean = np.einsum("vb,vb...->v...", root / count.sum(1, keepdims=True), weighted)
    return mean, np.einsum("vcb,vb...->vc...", _complement(root), weighted)


def reduce_samples(recipe: Recipe, table: SampleTable) -> ReducedScene:
    """The stops of a table. SamplesError when a position or seating is not in the recipe."""
    full = scene_of_table(recipe, table)
    stops = len(full.visits)
    since, length = _since_first(full, stops)
    block = np.searchsorted(BLOCK_EDGES, np.minimum(since / length[full.visit], 1.0), side="left").astype(np.intp)
    cell = full.visit * len(BLOCK_EDGES) + block
    count = np.bincount(cell, minlength=stops * len(BLOCK_EDGES)).astype(float)
    sigma = sample_noise(table.reading, full.visit)
    reading = clip_outliers(table.reading, full.visit, sigma, count[cell] < MIN_HUBER_SAMPLES)
    means = huber_means(reading, full.time_s, cell, count, np.where(sigma > 0, sigma, np.inf))
    count = count.reshape(stops, -1)
    mean, contrast = mean_and_contrasts(means.reshape(*count.shape, 3), count)
    scene = _rows_of(full, stops)
    noise = float(np.sqrt(np.mean(sigma**2)))
    axes = axis_noise(sigma, len(table) - stops)
    return ReducedScene(
        scene,
        _fine(full, scene, cell),
        mean,
        contrast,
        count,
        noise,
        _rate_error(scene),
        axes,
        excess_variance(table.reading, full.visit, sigma),
    )


def _rate_error(scene: Scene) -> Floats | None:
    """What is not known of the rate of temperature at the stops (v, modes)."""
    if scene.temperature_degC is None:
        return None
    return np.concatenate([s.modes for s in fit_temperature_slopes(scene.time_s, scene.temperature_degC, scene.visits)])


def clip_outliers(values: Floats, visit: NDArray[np.intp], sigma: Floats, few: NDArray[np.bool_]) -> Floats:
    """The readings (n, k) without the wild ones among `few` (n): far off their neighbours in the stop, which agree.

    sigma (k): noise of a sample. What moves, moves its neighbours too, and is left alone.
    """
    rows = np.flatnonzero(few)
    first, last = np.searchsorted(visit, visit[rows], "left"), np.searchsorted(visit, visit[rows], "right") - 1
    rows, first, last = (x[last - first >= 4] for x in (rows, first, last))
    before, after = np.where(rows > first, rows - 1, rows + 2), np.where(rows < last, rows + 1, rows - 2)
    centre = (values[before] + values[after]) / 2
    nearby = (before, after), (before, np.clip(before - 1, first, last)), (after, np.clip(after + 1, first, last))
    motion = sum(np.maximum(np.abs(values[a] - values[b]) - 3 * sigma, 0.0) for a, b in nearby)
    off = values[rows] - centre
    wild = np.abs(off) > 5 * sigma + 3 * motion
    winsorised = np.array(values)
    winsorised[rows] = np.where(wild, centre + np.clip(off, -HUBER_K * sigma, HUBER_K * sigma), values[rows])
    return winsorised


def huber_means(values: Floats, time_s: Floats, cell: NDArray[np.intp], count: Floats, scale: Floats) -> Floats:
    """Huber's location (cells, k) of values (n, k) in each cell, at the mean time of the cell's samples.

    A straight line in time is taken off first, and a cell that spreads wider than scale (k) is clipped wider: what
    moves within a block is not an outlier.
    """
    filled = np.maximum(count, 1.0)[:, None]
    late = time_s - (np.bincount(cell, time_s, len(count)) / filled[:, 0])[cell]
    room = np.maximum(np.bincount(cell, late**2, len(count)), 1e-300)[:, None]
    mean, slope = _sums(values, cell, len(count)) / filled, np.zeros((len(count), values.shape[1]))
    portions = _portions(cell, len(count))
    for _ in range(8):
        arrived = True
        for rows, cells in portions:
            of, weights = cell[rows] - cells.start, (filled[cells], room[cells], scale)
            step, turn, done = _step(values[rows], late[rows], of, (mean[cells], slope[cells]), weights)
            mean[cells], slope[cells] = mean[cells] + step, slope[cells] + turn
            arrived &= done
        # All together, so that a cell does not depend on which others are in its portion.
        if arrived:
            break
    return mean


def _step(
    values: Floats, late: Floats, cell: NDArray[np.intp],
    line: tuple[Floats, Floats], weights: tuple[Floats, Floats, Floats],
) -> tuple[Floats, Floats, bool]:  # fmt: skip
    """By how much means and slopes (cells, k) of a portion's lines move, and whether that is next to nothing."""
    (mean, slope), (filled, room, scale), cells = line, weights, len(line[0])
    off = values - mean[cell] - slope[cell] * late[:, None]
    wide = np.maximum(scale, 1.2533 * _sums(np.abs(off), cell, cells) / filled)
    off = np.clip(off, -HUBER_K * wide[cell], HUBER_K * wide[cell])
    step = _sums(off, cell, cells) / filled
    turn = _sums(off * late[:, None], cell, cells) / room
    return step, turn, bool(np.all(np.abs(step) <= 1e-3 * wide / np.sqrt(filled)))


def _portions(cell: NDArray[np.intp], cells: int) -> list[tuple[slice, slice]]:
    """Rows and cells of whole stops that are small enough for a processor's cache; one portion of all rows where those
    of a stop do not stand together."""
    stop = cell // len(BLOCK_EDGES)
    begins = np.flatnonzero(np.diff(stop, prepend=-1))
    if np.any(np.diff(stop[begins]) < 0):
        return [(slice(0, len(cell)), slice(0, cells))]
    begins = begins[np.diff(begins // SAMPLES_AT_ONCE, prepend=-1) > 0]
    rows, first = [*begins.tolist(), len(cell)], [0, *(stop[begins[1:]] * len(BLOCK_EDGES)).tolist(), cells]
    return [(slice(*r), slice(*c)) for r, c in zip(pairwise(rows), pairwise(first), strict=True)]


def _sums(values: Floats, cell: NDArray[np.intp], cells: int) -> Floats:
    """Sums of values (n, k) over cells."""
    return np.stack([np.bincount(cell, column, cells) for column in values.T], axis=1)


def _since_first(full: Scene, stops: int) -> tuple[Floats, Floats]:
    """Time since the first sample of the stop (n), and how long the stop was measured (v)."""
    first = np.full(stops, np.inf)
    last = np.full(stops, -np.inf)
    np.minimum.at(first, full.visit, full.time_s)
    np.maximum.at(last, full.visit, full.time_s)
    return full.time_s - first[full.visit], np.maximum(last - first, 1e-9)


def _rows_of(full: Scene, stops: int) -> Scene:
    """The scene with one row a stop, at the mean of its covariates."""
    cell = full.visit
    count = np.bincount(cell, minlength=stops)
    names = ["time_s", *(k for k in COVARIATES if getattr(full, k) is not None)]
    means: dict[str, Any] = {k: np.bincount(cell, getattr(full, k), stops) / count for k in names}
    return replace(full, visit=np.arange(stops), **means)


def _fine(full: Scene, scene: Scene, cell: NDArray[np.intp]) -> Scene:
    """The scene at the nodes of every block; what is a clock runs on, the rest stays as at the stop's mean."""
    cells = len(scene.visits) * len(BLOCK_EDGES)
    count = np.maximum(np.bincount(cell, minlength=cells), 1)
    late = full.time_s - scene.time_s[full.visit]
    mean = np.bincount(cell, late, cells) / count
    spread = np.sqrt(np.maximum(np.bincount(cell, late**2, cells) / count - mean**2, 0.0))
    later = (mean[:, None] + spread[:, None] * NODES).ravel()
    visit = np.repeat(scene.visit, len(BLOCK_EDGES) * len(NODES))
    clocks = ("time_s", "since_arrival_s", "since_power_s", "since_clamp_s")
    rows = {k: getattr(scene, k) for k in ("time_s", *COVARIATES)}
    moved: dict[str, Any] = {k: x[visit] + (later if k in clocks else 0.0) for k, x in rows.items() if x is not None}
    return replace(full, visit=visit, **moved)


def _complement(root: Floats) -> Floats:
    """Orthonormal rows (v, B−1, B) across unit vectors along root (v, B): the rest of a Householder reflection."""
    unit = root / np.linalg.norm(root, axis=1, keepdims=True)
    v = unit.copy()
    v[:, 0] += 1.0
    reflection = np.eye(root.shape[1]) - 2 * v[:, :, None] * v[:, None, :] / np.sum(v**2, axis=1)[:, None, None]
    return np.asarray(reflection[:, 1:])
