"""From samples to few robust numbers: a mean for each visit, and what changes within the visit.

A dwell is cut into sub-blocks that grow with the time since its first sample (shares .06, .09, .25, .60; the
blocks 0–.15–.4–1.0 s with the first one halved, so that a settling of .1 s shows its slope).
Each block gives a Huber mean. The blocks of a visit are then turned into their weighted mean and into contrasts that
are orthogonal to it: a cause that stands still during a dwell shows in the mean only, one that moves also in the
contrasts, and the noise of the two is independent. Where the fixture rings faster than these blocks follow
(`ringing.py`), the dwells are cut into quarters of its waves instead, as long as it rings.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.arrivals import chance_of_early, pieces_of_dwells
from station.diagnosis.data.contrast_noise import ContrastNoise, contrast_noise, without_bumps
from station.diagnosis.data.missing_axes import noise_of_all, with_noise_on_missing
from station.diagnosis.data.ringing import Ringing, find_ringings
from station.diagnosis.data.visit_means import visit_means
from station.diagnosis.data.visit_noise import VisitDifferences, axis_noise, sample_noise, visit_differences
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.likely_courses import TemperatureCourse
from station.model.scene import COVARIATES, Scene, fit_temperature_courses, scene_of_table, visits_scene_of_table
from station.model.turning_temperature import own_rates, with_own_rates

#: Ends of the sub-blocks as shares of the dwell.
BLOCK_EDGES = np.array([0.06, 0.15, 0.40, 1.0])
#: Blocks a wave of what rings, time constants for which they go on, share of the dwell that they may take, and how many
#: there are at most; beside them a block is longer by this factor at least.
WAVE_BLOCKS, RINGS_FOR, MOST_OF_DWELL, MOST_BLOCKS, NEXT_BLOCK = 4, 3.0, 0.8, 20, 1.3
#: Gauss–Legendre nodes of a block, in standard deviations of its samples' times about their mean, and their weights.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4) * np.array([[np.sqrt(3.0)], [0.5]])
#: Huber's constant: 99 % efficient under Gauss; a t₅ tail is bounded. Rounds after which hardly any mean moves.
HUBER_K, HUBER_ROUNDS = 2.0, 8
#: In a block of fewer samples no mean can tell an outlier from the rest.
MIN_HUBER_SAMPLES = 7
#: Samples looked at together: enough to be fast, few enough for a processor's cache.
SAMPLES_AT_ONCE = 1 << 14
#: Whose the angles are at which a turning table's dwells begin: each unit's at each visit, those of a visit for all
#: units that ride together, or those of a position where the table always begins at the same.
TableAngles = Literal["own", "ridden-together", "position"]


@dataclass(frozen=True, slots=True, eq=False)
class ReducedScene:
    """Visits (v) of a measured table. Readings in the recipe's unit.

    scene: one row a visit, at its mean time; fine: rows (v · B · nodes) inside the blocks, for causes that move
    during a dwell; mean (v, 3); contrast (v, B−1, 3), scaled so that it has the noise of a single sample;
    count (v, B) samples in each block; sigma: noise of a sample, from one to the next, axis_noise (3) that of each axis
    beside it, 1 where nothing shows that they differ; excess (v, 3) the square of a visit's noise beside that of all,
    axis_excess (v, 3) that which `count` leaves to each axis; rate_error (v, modes): by what the rate of temperature
    may be wrong, degC/s, each mode times a standard normal number a run; degC_error (v, modes): the same of the
    temperature, None where it is as it was read; edges (B): ends of the blocks as shares of a dwell; ringing_hz:
    frequencies of what rings within the dwells; sample_axes (3): axis_noise as the samples show it, whatever the means
    have; axis_correlation (3, 3) what the noise of two axes has in common, visit_correlation that of the visits' means,
    where it is another one; table_angles: whose the angles are at which dwells on a rate table begin.
    """

    scene: Scene
    fine: Scene
    mean: Floats
    contrast: Floats
    count: Floats
    sigma: float
    rate_error: Floats | None = None
    degC_error: Floats | None = None
    axis_noise: Floats = field(default_factory=lambda: np.ones(3))
    excess: Floats = field(default_factory=lambda: np.ones((1, 3)))
    axis_excess: Floats = field(default_factory=lambda: np.ones((1, 3)))
    edges: Floats = field(default_factory=lambda: BLOCK_EDGES)
    ringing_hz: tuple[float, ...] = ()
    sample_axes: Floats = field(default_factory=lambda: np.ones(3))
    axis_correlation: Floats = field(default_factory=lambda: np.eye(3))
    visit_correlation: Floats | None = None
    read_degC: Floats | None = None
    early_chance: float = 1.0
    table_angles: TableAngles = "own"

    @property
    def contrast_noise(self) -> ContrastNoise:
        """Noise of each contrast and axis (B−1, 3) beside that of a sample, and what contrasts have in common."""
        contrast = np.einsum("ij,vbj->vbi", self.axes_apart, self.contrast)
        return contrast_noise(contrast, self.mean, self.scene, self.sigma * self.sample_axes)

    @property
    def axes_apart(self) -> Floats:
        """What makes of readings whose noise the axes share such as share none, each of its axis' noise (3, 3): the
        inverse root of the correlation between the axes."""
        return self._apart(self.axis_correlation)

    @property
    def means_apart(self) -> Floats:
        """The same of the visits' means (3, 3)."""
        return self._apart(self.axis_correlation if self.visit_correlation is None else self.visit_correlation)

    def _apart(self, correlation: Floats) -> Floats:
        size, axes = np.linalg.eigh(correlation)
        apart = (axes / np.sqrt(size)) @ axes.T if np.any(correlation != np.eye(3)) else np.eye(3)
        return np.asarray(apart * self.axis_noise[:, None] / self.axis_noise)

    def by_own_noise(self) -> "ReducedScene":
        """The same where each visit has the noise of its own samples: a noisier one counts as so many fewer at that of
        all."""
        e = self.excess.mean(1)
        count, contrast = self.count / e[:, None], self.contrast / np.sqrt(e)[:, None, None]
        return replace(self, count=count, contrast=contrast, axis_excess=self.excess / e[:, None])

    def of_runs(self, there: NDArray[np.bool_]) -> "ReducedScene":
        """The visits of some whole runs, there (v); what holds for all samples is that of all."""
        of_visits = ("mean", "contrast", "count", "rate_error", "degC_error", "excess", "axis_excess", "read_degC")
        values = {name: getattr(self, name) for name in of_visits}
        kept = {name: x[there] for name, x in values.items() if x is not None and len(x) == len(there)}
        return replace(self, scene=self.scene.of_runs(there), fine=self.fine.of_runs(there), **kept)

    @property
    def rows_of_visit(self) -> int:
        """Rows of `fine` that a visit has."""
        return int(self.count.shape[1]) * len(NODES)

    def reduce_fine(self, rows: Floats, visits: NDArray[np.bool_] | slice | None = None) -> tuple[Floats, Floats]:
        """Mean (v, c) and contrasts (v, B−1, c) of values on the rows of `fine` (v · B · nodes, c), or of those of some
        visits alone."""
        count = self.count if visits is None else self.count[visits]
        inside = rows.reshape(*count.shape, len(NODES), rows.shape[1])
        return mean_and_contrasts(inside.swapaxes(2, 3) @ WEIGHTS, count)


def mean_and_contrasts(block: Floats, count: Floats) -> tuple[Floats, Floats]:
    """Weighted mean (v, …) of block values (v, B, …) and the contrasts across it (v, B−1, …): the rest of a Householder
    reflection of the blocks by their weights."""
    root = np.sqrt(count)
    weighted = root[..., None] * block.reshape(*root.shape, -1)
    mean = ((root / count.sum(1, keepdims=True))[:, None] @ weighted)[:, 0]
    mirror = root / np.linalg.norm(root, axis=1, keepdims=True)
    mirror[:, 0] += 1.0
    along = (2 * mirror / np.sum(mirror**2, axis=1, keepdims=True))[:, None] @ weighted
    contrasts = weighted[:, 1:] - mirror[:, 1:, None] * along
    return mean.reshape(len(root), *block.shape[2:]), contrasts.reshape(len(root), -1, *block.shape[2:])


@dataclass(frozen=True, slots=True, eq=False)
class ReducedPart:
    """Some whole units of a table, reduced. sigma (3): noise of a sample of theirs; means: one row a visit (v), values
    and readings its plain means; since_s (v) mean time since its first sample; count (v, B) and block (v, B, 3) samples
    and robust mean of each block; warming (v, 2) the mean rate of temperature by its own samples, degC/s, NaN where
    they do not tell it; late, spread (v, B) mean and deviation of its samples' times about the visit's mean;
    differences: how noisy each is; pieces (v, PIECES, 3): means of equal pieces about the visit's."""

    sigma: Floats
    means: SampleTable
    since_s: Floats
    count: Floats
    block: Floats
    late: Floats
    spread: Floats
    differences: VisitDifferences
    warming: Floats
    pieces: Array


def reduce_samples(recipe: Recipe, table: SampleTable) -> ReducedScene:
    """The visits of a table. SamplesError when a position or seating is not in the recipe."""
    visit = visits_scene_of_table(recipe, table).visit
    sigma = sample_noise(table.reading, visit)
    ringings = find_ringings(recipe, table, visit, sigma)
    if not ringings:
        part = reduce_part(table, visit, sigma)
        return join_parts(recipe, part.means, [part], sigma)
    edges = ringing_edges(ringings, float(np.median(_first_and_length(table.time_s, visit, int(visit.max()) + 1)[1])))
    part = reduce_part(table, visit, sigma, edges)
    return replace(
        join_parts(recipe, part.means, [part], sigma), ringing_hz=tuple(r.frequency_hz for r in ringings), edges=edges
    )


def ringing_edges(ringings: Sequence[Ringing], dwell_s: float) -> Floats:
    """Ends of the sub-blocks that follow what rings, the fastest wave as long as the longest, as shares of a dwell."""
    step = 1 / (WAVE_BLOCKS * max(r.frequency_hz for r in ringings) * dwell_s)
    last = min(RINGS_FOR * max(r.time_constant_s for r in ringings) / dwell_s, MOST_OF_DWELL)
    fine = step * np.arange(1, 1 + min(MOST_BLOCKS, int(last / step)))
    coarse, end = BLOCK_EDGES[:-1], fine.max(initial=0.0)
    longer = (coarse > NEXT_BLOCK * end) & (coarse - end >= min(step, coarse[0]))
    return np.asarray(np.r_[fine, coarse[longer], 1.0])


def reduce_part(table: SampleTable, visit: NDArray[np.intp], sigma: Floats, edges: Floats = BLOCK_EDGES) -> ReducedPart:
    """Some units of a table whose samples have the noise sigma (3); visit (n) of each row; edges (B) of the blocks."""
    visits = int(visit.max()) + 1
    first, length = _first_and_length(table.time_s, visit, visits)
    since = table.time_s - first[visit]
    block = np.searchsorted(edges, np.minimum(since / length[visit], 1.0), side="left").astype(np.intp)
    cell = visit * len(edges) + block
    count = np.bincount(cell, minlength=visits * len(edges)).astype(float)
    reading = clip_outliers(table.reading, visit, sigma, count[cell] < MIN_HUBER_SAMPLES)
    found = huber_means(reading, table.time_s, cell, count, np.where(sigma > 0, sigma, np.inf))
    means = visit_means(table, visit)
    late, spread = _times_of_blocks(table.time_s - means.time_s[visit], cell, count)
    shape = visits, len(edges)
    return ReducedPart(
        sigma,
        means,
        np.bincount(visit, since, visits) / np.bincount(visit, minlength=visits),
        count.reshape(shape),
        found.reshape(*shape, 3),
        late.reshape(shape),
        spread.reshape(shape),
        visit_differences(table.reading, visit, sigma),
        _warming(table, visit, visits),
        pieces_of_dwells(table.reading, visit),
    )


def _warming(table: SampleTable, visit: NDArray[np.intp], visits: int) -> Floats:
    warm = table.values.get("temperature_degC")
    return np.full((visits, 2), np.nan) if warm is None else own_rates(warm, table.time_s, visit, visits)


def join_parts(recipe: Recipe, means: SampleTable, parts: Sequence[ReducedPart], sigma: Floats) -> ReducedScene:
    """The visits of all parts, whose means stand in one table in their order; sigma (3): noise of a sample of all."""
    count = np.concatenate([p.count for p in parts])
    block = with_noise_on_missing(np.concatenate([p.block for p in parts]), count, sigma)
    mean, contrast = mean_and_contrasts(block, count)
    since = np.concatenate([p.since_s for p in parts]) + recipe.settle.time_s
    scene, rate_error, degC_error = _scene(recipe, means, np.concatenate([p.warming for p in parts]))
    scene = replace(scene, since_arrival_s=since)
    one, axes = np.where(sigma > 0, sigma, 1.0), axis_noise(sigma, int(count.sum()) - len(count))
    differences = VisitDifferences.join(
        [p.differences.beside(np.where(p.sigma > 0, p.sigma, 1.0) / one) for p in parts], known=bool(np.any(sigma > 0))
    )
    late, spread = (np.concatenate([getattr(p, name) for p in parts]) for name in ("late", "spread"))
    return ReducedScene(
        scene,
        _fine(scene, late, spread),
        mean,
        without_bumps(contrast, sigma),
        count,
        noise_of_all(sigma),
        rate_error,
        degC_error,
        axes,
        differences.excess_variance(means.unit.code),
        sample_axes=axes,
        axis_correlation=differences.correlation(),
        read_degC=means.values.get("temperature_degC"),
        early_chance=chance_of_early(np.concatenate([p.pieces for p in parts]), mean, scene),
    )


def _scene(recipe: Recipe, means: SampleTable, warming: Floats) -> tuple[Scene, Floats | None, Floats | None]:
    """The scene of visits (v), one row each, and what is not known there of the rate of temperature (v, modes) and of
    the temperature (v, modes); warming (v, 2): this rate as the samples of each show it.

    Temperatures are as a smooth course has them: as it was read, one that scarcely changes bears more of its
    thermometer's noise than of what it was, and nothing would follow it.
    """
    warm = means.values.get("temperature_degC")
    others = {name: values for name, values in means.values.items() if name != "temperature_degC"}
    scene = scene_of_table(recipe, replace(means, values=others))
    if warm is None:
        return scene, None, None
    courses = fit_temperature_courses(scene, scene.time_s, warm, scene.since_power_s)
    value, rate, modes, blur = (
        np.concatenate([getattr(c, part) for c in courses]) for part in TemperatureCourse._fields
    )
    scene = replace(scene, temperature_degC=value, temperature_rate=with_own_rates(rate, warming))
    return scene, modes, blur if blur.any() else None


def clip_outliers(values: Floats, visit: NDArray[np.intp], sigma: Floats, few: NDArray[np.bool_]) -> Floats:
    """The readings (n, k) without the outliers among `few` (n): far off their neighbours in the visit, which agree.

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
    outlier = np.abs(off) > 5 * sigma + 3 * motion
    winsorised = np.array(values)
    winsorised[rows] = np.where(outlier, centre + np.clip(off, -HUBER_K * sigma, HUBER_K * sigma), values[rows])
    return winsorised


def huber_means(values: Floats, time_s: Floats, cell: NDArray[np.intp], count: Floats, scale: Floats) -> Floats:
    """Huber's location (cells, k) of values (n, k) in each cell (n), of `count` (cells) rows, at the mean time of its
    samples; 0 where there is none.

    A straight line in time is taken off first, and a cell that spreads wider than scale (k) is clipped wider: what
    moves within a block is not an outlier.
    """
    mean = np.zeros((len(count), values.shape[1]))
    if np.any(np.diff(cell) < 0):
        order = np.argsort(cell, kind="stable")
        values, time_s, cell = values[order], time_s[order], cell[order]
    begin = np.flatnonzero(np.diff(cell, prepend=-1))
    filled = cell[begin]
    for rows, cells in _portions(begin, len(cell)):
        first = begin[cells] - rows.start
        number = np.diff(np.append(first, rows.stop - rows.start))
        late = time_s[rows] - np.repeat(np.add.reduceat(time_s[rows], first) / number, number)
        for axis, column in enumerate(values[rows].T):
            found = _huber_mean(np.ascontiguousarray(column), late, (first, number), float(scale[axis]))
            mean[filled[cells], axis] = found
    return mean


def _huber_mean(values: Floats, late: Floats, cells: tuple[NDArray[np.intp], NDArray[np.intp]], scale: float) -> Floats:
    """The same (c) of one axis (n) of a portion; cells: first row of each (c), and how many it has (c).

    As many rounds for all cells, so that none depends on which others are looked at."""
    first, number = cells
    room = np.maximum(np.add.reduceat(late**2, first), 1e-300)
    mean, slope = np.add.reduceat(values, first) / number, np.zeros(len(first))
    for _ in range(HUBER_ROUNDS):
        off = values - np.repeat(mean, number) - np.repeat(slope, number) * late
        spread = np.add.reduceat(np.abs(off), first) / number
        widest = np.repeat(HUBER_K * np.maximum(scale, 1.2533 * spread), number)
        off = np.minimum(np.maximum(off, -widest), widest)
        mean = mean + np.add.reduceat(off, first) / number
        slope = slope + np.add.reduceat(off * late, first) / room
    return mean


def _portions(begin: NDArray[np.intp], rows: int) -> list[tuple[slice, slice]]:
    """Rows and cells of whole cells, which begin (c) at these of so many rows, small enough for a processor's cache."""
    first = np.flatnonzero(np.diff(begin // SAMPLES_AT_ONCE, prepend=-1))
    ends = zip(pairwise([*begin[first].tolist(), rows]), pairwise([*first.tolist(), len(begin)]), strict=True)
    return [(slice(*r), slice(*c)) for r, c in ends]


def _first_and_length(time_s: Floats, visit: NDArray[np.intp], visits: int) -> tuple[Floats, Floats]:
    """Time of the first sample of each visit (v), and how long it was measured (v)."""
    first = np.full(visits, np.inf)
    last = np.full(visits, -np.inf)
    np.minimum.at(first, visit, time_s)
    np.maximum.at(last, visit, time_s)
    return first, np.maximum(last - first, 1e-9)


def _times_of_blocks(late: Floats, cell: NDArray[np.intp], count: Floats) -> tuple[Floats, Floats]:
    """Mean and deviation (cells) of the samples' times about the mean of their visit (n) in each cell."""
    filled = np.maximum(count, 1.0)
    mean = np.bincount(cell, late, len(count)) / filled
    return mean, np.sqrt(np.maximum(np.bincount(cell, late**2, len(count)) / filled - mean**2, 0.0))


def _fine(scene: Scene, late: Floats, spread: Floats) -> Scene:
    """The scene at the nodes of every block, whose times are late (v, B) about the visit's mean and spread (v, B); what
    is a clock runs on, the temperature at its rate, this as it changes from visit to visit, and the rest stays as at
    the visit's mean."""
    later = (late[..., None] + spread[..., None] * NODES).ravel()
    visit = np.repeat(scene.visit, late.shape[1] * len(NODES))
    clocks = ("time_s", "since_arrival_s", "since_power_s", "since_clamp_s")
    rows = {k: getattr(scene, k) for k in ("time_s", *COVARIATES)}
    moved: dict[str, Any] = {k: x[visit] + (later if k in clocks else 0.0) for k, x in rows.items() if x is not None}
    if "since_arrival_s" in moved:
        # Of a block of two readings the first node lies before them; nothing that fades on arrival was larger before.
        moved["since_arrival_s"] = np.maximum(moved["since_arrival_s"], 0.0)
    if scene.temperature_degC is not None and scene.temperature_rate is not None:
        moved["temperature_degC"] = moved["temperature_degC"] + scene.temperature_rate[visit] * later
        moved["temperature_rate"] = moved["temperature_rate"] + _rate_change(scene)[visit] * later
    return replace(scene, visit=visit, **moved)


def _rate_change(scene: Scene) -> Floats:
    """How fast the rate of temperature changes (v), degC/s², at each visit of a scene; 0 in runs of one or two."""
    change, rate = np.zeros(len(scene)), scene.require("temperature_rate")
    for rows in scene.visits.run_slices():
        if rows.stop - rows.start > 2:
            change[rows] = np.gradient(rate[rows], scene.time_s[rows])
    return change
