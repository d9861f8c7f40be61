"""Whether samples are such that anything can be told from them: one sentence where they are not."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data import stays
from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Floats, SampleTable
from station.domain.evaluation import pipeline
from station.domain.evaluation.pipeline import CalibrationResult
from station.domain.recipe.recipe import Recipe
from station.domain.recognition import visits
from station.errors import SamplesError, StationError
from station.model.forward import resting_stimulus
from station.model.scene import visits_scene_of_table

#: Columns of which one moves so many times as much as another, beside what the poses make them move, differ in unit.
MAX_RESPONSE_RATIO = 3.0
#: Single readings that lie on one ellipsoid to a smaller share of its size were computed.
COMPUTED = 3e-6
#: An axis that moves by less than this share of its readings' size does not move.
SAME_DIGITS = 1e-9
#: Times that cannot be negative.
ELAPSED_COLUMNS = ("since_power_s", "since_clamp_s")
#: Runs of one table do not start further apart: s.
CENTURY_S = 3.2e9


def check(recipe: Recipe, table: SampleTable) -> None:
    """Errors: SamplesError where no calibration and no cause can be told from the samples, or they are no samples."""
    first = _first_rows(table)
    _check_visit_count(recipe, table, first)
    _check_one_position_per_visit(table, first)
    _check_time_advances(table, first)
    _check_starts(table)
    _check_axes_vary(recipe, table)
    if recipe.pose_known and recipe.reference.source != "gold":
        _check_same_unit_of_measure(recipe, table)


def check_unclipped(table: SampleTable, rest: SampleTable) -> None:
    """Errors: SamplesError where no unit has two visits left beside those that are clipped: of one visit everything is
    the unit's own offset."""
    first = _first_rows(rest) if len(rest) else np.zeros(0, np.intp)
    every, whole = len(_first_rows(table)), len(first)
    if np.bincount(rest.unit.code[first]).max(initial=0) < 2:
        raise SamplesError("samples-mostly-clipped", clipped=every - whole, visits=every)


def check_calibrated(view: ResidualView) -> None:
    """Errors: SamplesError where poses are unknown and the readings lie round no ellipsoid that offset and gain of a
    sensor make: what is left of them then says nothing."""
    if view.grid.k == 3:
        return
    of = view.scene.visits
    if int(view.reduced.count.sum(axis=1).max()) == 1:
        for code, serial in enumerate(of.unit.names):
            off = visits.off_ellipsoid(view.reduced.mean[of.unit.code == code])
            if off < COMPUTED:
                raise SamplesError("readings-computed", serial=serial, ppm=1e6 * off)
    for serial, gain in zip(view.scene.visits.unit.names, np.diagonal(view.base.matrix, axis1=1, axis2=2), strict=True):
        check_gain(serial, gain)


def check_settles(recipe: Recipe, table: SampleTable, today: str) -> None:
    """Errors: SamplesError where only the magnitudes of single readings are known, and their calibration does not
    settle: many an ellipsoid is as near, and what is left of any of them says nothing."""
    if recipe.pose_known or len(_first_rows(table)) < len(table):
        return
    try:
        results = list(pipeline.calibrate(recipe, table, today))
    except StationError:
        # What the recipe's method cannot calibrate may be diagnosed all the same.
        return
    for result in results:
        check_fit(result)


def check_fit(result: CalibrationResult) -> None:
    """Errors: SamplesError where no offset and gain of one sensor make the magnitudes of a unit of unknown poses
    alike."""
    found = result.calibration
    if found is None:
        return
    if any(note.id == "norm-not-settled" for note in found.notes):
        raise SamplesError("readings-on-no-ellipsoid", serial=result.serial)
    check_gain(result.serial, np.diagonal(found.matrix))


def check_gain(serial: str, gain: Floats) -> None:
    """Errors: SamplesError where the axes of a unit of unknown poses respond (3) as those of one sensor never do."""
    size = np.abs(gain)
    if not gain.min() > 0:
        raise SamplesError("readings-on-no-ellipsoid", serial=serial)
    if size.max() > MAX_RESPONSE_RATIO * size.min():
        odd = int(np.argmax(np.abs(np.log(size / np.median(size)))))
        ratio = float(size[odd] / np.median(size))
        raise SamplesError("axis-responds-apart", serial=serial, axis="xyz"[odd], ratio=ratio)


def _first_rows(table: SampleTable) -> NDArray[np.intp]:
    """Row at which each visit begins."""
    where = (table.unit.code, table.run, table.visit)
    return np.flatnonzero(np.any([np.diff(codes, prepend=-1) != 0 for codes in where], axis=0))


def _location(table: SampleTable, row: int) -> dict[str, str | int]:
    """The visit that a row is of, as parameters of a message."""
    return {
        "serial": table.unit.names[table.unit.code[row]],
        "run": int(table.run[row]),
        "visit": int(table.visit[row]),
    }


def _check_visit_count(recipe: Recipe, table: SampleTable, first: NDArray[np.intp]) -> None:
    if len(first) < 2 and not stays.recut(recipe, table).stretches > 1:
        raise SamplesError("samples-of-one-visit", rows=len(table))
    units = len(np.unique(table.unit.code))
    if len(first) == units and not stays.recut(recipe, table).stretches > units:
        raise SamplesError("units-of-one-visit", units=units)


def _check_one_position_per_visit(table: SampleTable, first: NDArray[np.intp]) -> None:
    turned = np.flatnonzero(np.diff(table.position.code, prepend=table.position.code[0]))
    inside = np.setdiff1d(turned, first)
    if len(inside):
        row = int(inside[0])
        one, two = (table.position.names[table.position.code[r]] for r in (row - 1, row))
        raise SamplesError("visit-at-two-positions", **_location(table, row), one=one, two=two)


def _check_time_advances(table: SampleTable, first: NDArray[np.intp]) -> None:
    last = np.append(first[1:], len(table)) - 1
    long = last > first
    if long.any() and not np.any(table.time_s[last] - table.time_s[first]):
        raise SamplesError("samples-time-stuck", time_s=float(table.time_s[first[0]]))
    for name in ELAPSED_COLUMNS:
        early = table.values[name] < 0 if name in table.values else np.zeros(0, bool)
        if early.any():
            row = int(early.argmax())
            raise SamplesError(
                "samples-time-negative", **_location(table, row), column=name, value=float(table.values[name][row])
            )


def _check_starts(table: SampleTable) -> None:
    started = table.values.get("started_s")
    if started is not None and (span := float(np.nanmax(started) - np.nanmin(started))) > CENTURY_S:
        raise SamplesError("samples-starts-far-apart", **_location(table, int(np.nanargmax(started))), span_s=span)


def _check_axes_vary(recipe: Recipe, table: SampleTable) -> None:
    """Every axis of every unit must read more than one value, to SAME_DIGITS of its size."""
    units, begins = np.unique(table.unit.code, return_index=True)
    place = np.zeros(len(table.unit.names), np.intp)
    place[units] = begins
    for i, axis in enumerate("xyz"[: recipe.axes]):
        off = np.abs(table.reading[:, i] - table.reading[place[table.unit.code], i])
        moved, size = (np.bincount(table.unit.code, x, len(place))[units] for x in (off, np.abs(table.reading[:, i])))
        dead = np.flatnonzero(moved <= SAME_DIGITS * size)
        if len(dead) == len(units):
            raise SamplesError("samples-axis-constant", axis=axis)
        if len(dead):
            name = table.unit.names[units[dead[0]]]
            raise SamplesError("unit-axis-constant", serial=name, axis=axis)


def _check_same_unit_of_measure(recipe: Recipe, table: SampleTable) -> None:
    for serial, moves in _response_ratios(recipe, table):
        turned = np.isfinite(moves)
        if not turned.any() or moves[turned].max() <= MAX_RESPONSE_RATIO * moves[turned].min():
            continue
        worst = int(np.nanargmax(np.abs(np.log(moves / np.nanmedian(moves)))))
        factors = tuple(f"{a} {m:.3g}" for a, m in zip("xyz", moves, strict=True) if np.isfinite(m))
        raise SamplesError(
            "samples-axis-in-other-unit", serial=serial, column="xyz"[worst], factors=factors, unit=recipe.unit
        )


def _response_ratios(recipe: Recipe, table: SampleTable) -> Iterator[tuple[str, Floats]]:
    """Of each unit how much each axis' visits spread (3), beside what an ideal unit's would; NaN where hardly
    turned."""
    scene = visits_scene_of_table(recipe, table)
    code, visits = scene.visits.unit.code, len(scene.visits)
    count = np.bincount(scene.visit, minlength=visits)
    mean = np.stack([np.bincount(scene.visit, column, visits) / count for column in table.reading.T], axis=1)
    true = resting_stimulus(scene)
    units = len(scene.visits.unit.names)
    read, felt = (_visit_std(values, code, units) for values in (mean, true))
    far = felt > 0.3 * recipe.reference.strength()
    ratio = np.where(far, read / np.where(far, felt, 1.0), np.nan)
    return zip(scene.visits.unit.names, ratio, strict=True)


def _visit_std(values: Floats, code: NDArray[np.int32], units: int) -> Floats:
    """Standard deviation (U, 3) of the visits' values (v, 3) of each unit."""
    count = np.maximum(np.bincount(code, minlength=units), 1)[:, None]
    middle = np.stack([np.bincount(code, column, units) for column in values.T], axis=1) / count
    off = (values - middle[code]) ** 2
    return np.asarray(np.sqrt(np.stack([np.bincount(code, column, units) for column in off.T], axis=1) / count))
