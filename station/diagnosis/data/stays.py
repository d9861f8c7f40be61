"""Visits that are pieces of one stay: a recording of one pose may be cut in any way, and means the same.

Visits of a unit that follow each other without a gap at one position are one stay. It is cut anew, into stretches of
one length that depends on how long the stay was and not on how it came, so that the same recording in visits of 5,
10, 30 or 60 s becomes the same table. A visit that the fixture left and came to again is untouched. Short stays of a
unit that was turned from one to the next are a visit each: pieces of one rest repeat its pose and say nothing new of
it, nor do visits of a known pose that the unit did not leave between them, pauses or not. A stay ends where the mean of
the readings steps, and a long one in the only position of a recipe may come in one piece.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data import dwell_steps
from station.domain.capture import mean_steps
from station.domain.core.types import Array, Floats, SampleTable
from station.domain.evaluation.unit_dwells import sort_table
from station.domain.recipe.recipe import Recipe

#: Stretches of the longest stay at the most; the shortest stretch, s, and the fewest samples in one.
MAX_STRETCHES, MIN_STRETCH_S, MIN_STRETCH_SAMPLES = 96, 5.0, 20
#: Share of the stimulus by which the mean of one pose steps at most; two poses of one visit are farther apart.
MAX_STEP = 0.03
#: A stay in the only position of a recipe is cut from so many of the shortest stretches on.
LEAST_STRETCHES = 4
#: So many stays of a unit, half of them no longer than this and none than that (s), are rests of a tumble: it often
#: begins with a long one, for the gyroscope.
LEAST_RESTS, USUAL_REST_S, LONGEST_REST_S = 7, 60.0, 300.0
#: Sample periods that may lie between two visits of one stay.
MAX_GAP_PERIODS = 3.0
#: A dwell that is interrupted for so long (s), in this share of the visits, is a piece of a recording.
PAUSE_S, PAUSED_SHARE = 1.0, 0.02
#: Share of the stimulus by which two visits of one stay may differ where nobody knows the pose.
MAX_LENGTH_STEP = 0.02


Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Recut:
    """The table cut anew; visits: how many came; stretches: into how many of them, of `length_s` each, those of stays
    were cut; 0 where none were; steps: at which visits were ended."""

    table: SampleTable
    visits: int
    stretches: int
    length_s: float
    steps: int = 0

    @property
    def as_it_came(self) -> bool:
        """Whether no visit was cut or joined."""
        return not (self.stretches or self.steps)


def recut(recipe: Recipe, table: SampleTable, *, steps_looked_for: bool = False) -> Recut:
    """The table, its rows sorted by unit, run and visit, with its stays in stretches of one length. steps_looked_for:
    whether no visit as it came has a step of its mean (`split_at_steps`)."""
    table = sort_table(table)
    first = _first_rows(table)
    period = _period(table, first)
    joined = _joined(recipe, table, first, period)
    known = steps_looked_for and not joined.any()
    steps = np.zeros(0, np.intp) if known else _steps(recipe, table, first[np.r_[True, ~joined]], period)
    return _recut(recipe, table, first[np.r_[True, ~joined]], steps, period)


def stretches(recipe: Recipe, table: SampleTable) -> SampleTable:
    """A sorted table in the same stretches, its steps left in them: what moves is judged, too, however it was cut."""
    first = _first_rows(table)
    period = _period(table, first)
    begins = first[np.r_[True, ~_joined(recipe, table, first, period)]]
    return _recut(recipe, table, begins, np.zeros(0, np.intp), period).table


def whole_rests(recipe: Recipe, table: SampleTable) -> SampleTable:
    """A sorted table in which the pieces of each rest of a tumble are one visit, as they are for a diagnosis: their
    errors are one error. As it came where no rest was cut, or the unit was not turned from one to the next."""
    first = _first_rows(table)
    joined = _joined(recipe, table, first, _period(table, first))
    begins = first[np.r_[True, ~joined]]
    if not joined.any() or not _are_rests(table, begins):
        return table
    stay = np.searchsorted(begins, np.arange(len(table)), side="right") - 1
    return replace(table, visit=_renumbered(table, stay, np.zeros(len(table), np.int64), np.ones(len(begins), bool)))


def _are_rests(table: SampleTable, begins: Rows) -> bool:
    """Whether stays that begin at rows (k) are rests of units that were turned from one to the next."""
    last = np.append(begins[1:], len(table)) - 1
    rests, lasts_s = np.bincount(table.unit.code[begins]), table.time_s[last] - table.time_s[begins]
    short = float(np.median(lasts_s)) <= USUAL_REST_S and float(lasts_s.max()) <= LONGEST_REST_S
    return short and int(rests[rests > 0].min()) >= LEAST_RESTS


def _recut(recipe: Recipe, table: SampleTable, stays: Rows, steps: Rows, period: float) -> Recut:
    """A sorted table whose stays begin at rows (k) and also end at the rows of steps."""
    first = _first_rows(table)
    begins = np.union1d(stays, steps)
    row_stay = np.searchsorted(begins, np.arange(len(table)), side="right") - 1
    since = table.time_s - table.time_s[begins][row_stay]
    span = np.zeros(len(begins))
    np.maximum.at(span, row_stay, since)
    many = np.bincount(row_stay[first], minlength=len(begins)) > 1
    many |= len(recipe.positions) == 1 and span >= LEAST_STRETCHES * MIN_STRETCH_S
    if not (many.any() or len(steps)):
        return Recut(table, len(first), 0, 0.0)
    longest = float(span[many].max(initial=0.0))
    length = max(longest / MAX_STRETCHES, MIN_STRETCH_S, MIN_STRETCH_SAMPLES * period)
    if _are_rests(table, begins):
        length = longest + period
    stretch = _stretch(since, row_stay, span, many, length)
    visit = _renumbered(table, row_stay, stretch, many | np.isin(begins, steps))
    count = int(np.sum(np.maximum(np.round(span[many] / length), 1)))
    return Recut(replace(table, visit=visit), len(first), count, length, len(steps))


def split_at_steps(recipe: Recipe, table: SampleTable) -> tuple[SampleTable, Rows]:
    """A sorted table whose visits end where their mean steps, later ones of the run counted on, and the rows (k) at
    which they do."""
    first = _first_rows(table)
    steps = _steps(recipe, table, first, _period(table, first))
    if not len(steps):
        return table, steps
    begins = np.union1d(first, steps)
    stay = np.searchsorted(begins, np.arange(len(table)), side="right") - 1
    visit = _renumbered(table, stay, np.zeros(len(table), np.int64), np.isin(begins, steps))
    return replace(table, visit=visit), steps


def _steps(recipe: Recipe, table: SampleTable, begins: Rows, period: float) -> Rows:
    """Rows at which the mean steps within stays that begin at rows (k), less than another pose makes it unless the
    recipe has one."""
    end = np.append(begins[1:], len(table))
    size = np.linalg.norm(np.add.reduceat(table.reading, begins, axis=0), axis=1) / (end - begins)
    most = MAX_STEP * float(size.max()) if len(recipe.positions) != 1 else np.inf
    found, long = list[int](), end - begins >= mean_steps.least_rows(period)
    for first, last in zip(begins[long].tolist(), end[long].tolist(), strict=True):
        own = table.reading[first:last]
        rows = mean_steps.find(own, period)
        ends = zip([0, *rows], [*rows, len(own)], strict=True)
        change = np.linalg.norm(np.diff([own[a:b].mean(axis=0) for a, b in ends], axis=0), axis=1) if rows else []
        found += [first + row for row, step in zip(rows, change, strict=True) if step < most]
    found += dwell_steps.find(recipe, table, begins, end, ~long)
    return np.array(sorted(found), np.intp)


def _stretch(since: Floats, stay: Array, span: Floats, many: NDArray[np.bool_], length: float) -> NDArray[np.int64]:
    """Number of each row's stretch in its stay (n); the last one takes what is left of less than half a length."""
    last = np.maximum(np.round(span / length) - 1, 0)
    place = np.minimum(np.floor(since / length + 1e-9), last[stay])
    return np.where(many[stay], place, 0).astype(np.int64)


def _renumbered(
    table: SampleTable, stay: Array, stretch: NDArray[np.int64], cut: NDArray[np.bool_]
) -> NDArray[np.int32]:
    """Numbers (n) of the visits from 0 in each run; those of runs without any stay that was cut as they were."""
    new = np.r_[True, (np.diff(stay) != 0) | (np.diff(stretch) != 0)]
    run = np.cumsum(np.r_[True, (np.diff(table.run) != 0) | (np.diff(table.unit.code) != 0)]) - 1
    count = np.cumsum(new) - 1
    begin = count[np.flatnonzero(np.diff(run, prepend=-1))]
    anew = np.bincount(run, cut[stay]) > 0
    return np.where(anew[run], count - begin[run], table.visit).astype(np.int32)


def _first_rows(table: SampleTable) -> NDArray[np.intp]:
    where = (table.unit.code, table.run, table.visit)
    return np.flatnonzero(np.any([np.diff(codes, prepend=-1) != 0 for codes in where], axis=0))


def _period(table: SampleTable, first: NDArray[np.intp]) -> float:
    """The usual time from sample to sample within a visit; 0 where each has one."""
    inside = np.ones(len(table), bool)
    inside[first] = False
    gaps = np.diff(table.time_s, prepend=table.time_s[:1])[inside]
    # Stamps coarser than the rate stand still from sample to sample.
    return float(np.median(gaps) or np.mean(gaps)) if len(gaps) else 0.0


def _joined(recipe: Recipe, table: SampleTable, first: NDArray[np.intp], period: float) -> NDArray[np.bool_]:
    """Whether each visit but the first (v − 1) goes on with the stay of the one before."""
    last = np.append(first[1:], len(table)) - 1
    labels = [table.position, table.unit, *table.labels.values()]
    same = np.all([x.code[first][1:] == x.code[first][:-1] for x in labels], axis=0)
    gap = table.time_s[first[1:]] - table.time_s[last[:-1]]
    same &= (table.run[first][1:] == table.run[first][:-1]) & (gap >= 0)
    if recipe.pose_known and len(recipe.positions) > 1 and _are_rests(table, first[np.r_[True, ~same]]):
        # What a hand left in its pose and turned about the vertical was not placed anew.
        return np.asarray(same)
    # Nor do pauses part the visits of one pose that hold such pauses themselves: they are no more than a cut.
    if not (len(recipe.positions) == 1 and _holds_pauses(table, first, period)):
        same &= gap <= MAX_GAP_PERIODS * period
    if not recipe.pose_known and same.any():
        count = np.diff(np.append(first, len(table)))[:, None]
        mean = np.add.reduceat(table.reading, first, axis=0) / count
        step = np.linalg.norm(np.diff(mean, axis=0), axis=1)
        same &= step < MAX_LENGTH_STEP * np.median(np.linalg.norm(mean, axis=1))
    return np.asarray(same)


def _holds_pauses(table: SampleTable, first: Rows, period: float) -> bool:
    """Whether visits are interrupted, as no dwell is, for longer than frames are lost."""
    apart = np.diff(table.time_s, prepend=table.time_s[:1])
    apart[first] = 0.0
    return bool(np.count_nonzero(apart > max(PAUSE_S, MAX_GAP_PERIODS * period)) > PAUSED_SHARE * len(first))
