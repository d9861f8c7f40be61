"""The preflight's single checks: what is refused, and what a person should know."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.visit_motion import VisitMotion
from station.domain.capture.rest_segments import orientations
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe import sensor
from station.domain.recipe.recipe import Recipe
from station.domain.recognition import usual_rates
from station.domain.recognition.quantities import QUANTITIES, sphere
from station.domain.recognition.sheet import InferredSheet
from station.errors import SamplesError
from station.messages import Message

#: Most visits of a unit move by this share of the stimulus: it was not turned from rest to rest.
UNREST = 0.1
#: No calibration makes magnitudes this far apart, in the median over visits.
MAGNITUDE = 0.05
#: Single readings have their noise, too.
MAGNITUDE_OF_ONE = 0.1
#: The rate is another one beyond this.
RATE = 0.05
#: Readings whose step is so many times the sheet's are of another sensor, or of another range.
SAME_STEP = 1.5
#: A rate further off than by such a factor is no clock's error.
FAR_RATE = 1.5
#: Readings are this many times the stimulus, within SAME_RATIO, when they are in another unit.
SAME_RATIO = 0.05
#: No range or gain of a unit makes its readings so many times the stimulus, or so small a part of it.
FAR_OFF = 5.0
#: An axis that ranges so many times as far as the others, and also rests in the middle third of its range while they do
#: not show what it leaves to them, is in another unit.
APART = 5.0
#: White noise above this share of the mean readings leaves no stimulus to see.
DROWNED = 1.0
#: Temperatures that range over more than this are a reason to stay in one pose.
HEATED_DEGC = 2.0
#: Units of one pose each, at least so many and in so many orientations, are one unit's files.
LEAST_TURNED = 3
#: Steps of the mean that are said one by one.
MOST_SAID = 5
#: An axis that no pose moves by this share of the stimulus is not stimulated.
STIMULATED = 0.3

Ints = NDArray[np.int32]


def stimulus_size(recipe: Recipe, mean: Floats) -> float:
    """Size of the stimulus as the readings of visits (v, 3) show it; for a turn rate the greatest."""
    size = np.linalg.norm(mean, axis=1)
    return float(size.max() if recipe.reference.source == "rate" else np.median(size))


def check_positions(table: SampleTable, begin: NDArray[np.int64], end: NDArray[np.int64]) -> None:
    """Errors: SamplesError where a visit is at two positions or in two seatings: numbers of visits are wrong, not the
    unit."""
    inside = np.flatnonzero(table.position.code != np.repeat(table.position.code[begin], end - begin))
    if len(inside):
        row = int(inside[0])
        one, two = (table.position.names[table.position.code[r]] for r in (row - 1, row))
        raise SamplesError(
            "visit-at-two-positions", serial=table.unit.names[table.unit.code[row]], run=int(table.run[row]),
            visit=int(table.visit[row]), one=one, two=two,
        )  # fmt: skip
    if "seating" in table.labels:
        _check_seated_once(table, begin, end)


def _check_seated_once(table: SampleTable, begin: NDArray[np.int64], end: NDArray[np.int64]) -> None:
    """Errors: SamplesError where a visit is in two seatings."""
    seating = table.labels["seating"]
    inside = np.flatnonzero(seating.code != np.repeat(seating.code[begin], end - begin))
    if len(inside):
        row = int(inside[0])
        one, two = (seating.names[seating.code[r]] for r in (row - 1, row))
        raise SamplesError(
            "visit-seated-twice", serial=table.unit.names[table.unit.code[row]], run=int(table.run[row]),
            visit=int(table.visit[row]), one=one, two=two,
        )  # fmt: skip


def check_rest(motion: VisitMotion, unit: Ints, size: float) -> None:
    """Errors: SamplesError where most visits of all units move."""
    unrest = motion.range > UNREST * size
    if len(unit) >= 2 and size > 0 and np.mean(unrest) > 0.5:
        raise SamplesError(
            "most-visits-move",
            moving=int(unrest.sum()),
            visits=len(unit),
            percent=100 * float(np.median(motion.range)) / size,
        )


def check_signal(recipe: Recipe, found: InferredSheet, size: float) -> None:
    """Errors: SamplesError where readings scatter more than any stimulus at rest shows."""
    noise = float(np.linalg.norm(found.noise))
    if recipe.reference.source != "rate" and noise > DROWNED * size:
        raise SamplesError("noise-above-stimulus", noise=noise, size=size, unit=recipe.unit)


def check_axes_agree(recipe: Recipe, table: SampleTable, mean: Floats, unit: Ints) -> None:
    """Errors: SamplesError where one axis of a unit is so much larger than the others that all its poses look like two.
    mean (v, 3), unit (v): of the visits."""
    if recipe.pose_known or recipe.reference.source == "rate":
        return
    for u in np.unique(unit):
        own = mean[unit == u]
        reach = np.ptp(own, axis=0)
        odd, others = int(np.argmax(reach)), np.delete(np.arange(3), np.argmax(reach))
        ratio = float(reach[odd] / max(np.median(reach), 1e-300))
        half = np.abs(own[:, odd] - (own[:, odd].max() + own[:, odd].min()) / 2)
        # Where it is level, gravity lies in the other two.
        level = own[half < reach[odd] / 6][:, others]
        shown = np.linalg.norm(level, axis=1).min(initial=np.inf) > reach[odd] / 4
        turned = reach[odd] > np.abs(own[:, odd]).max()
        if turned and APART < ratio < 1e6 and len(level) and not shown:
            serial = table.unit.names[int(u)]
            raise SamplesError("axis-responds-apart", serial=serial, axis="xyz"[odd], ratio=ratio)


def check_poses(recipe: Recipe, poses: int, turned: Message | None) -> None:
    """Errors: SamplesError where only the magnitude is known, in one pose: gains of axes follow whatever changes there,
    the temperature's effect too; turned: what was remarked of units with a pose each."""
    if not recipe.pose_known and poses < 2 and recipe.reference.source != "rate":
        raise SamplesError("one-unknown-pose") if turned is None else SamplesError(turned)


def one_turned_unit(recipe: Recipe, mean: Floats, unit: Ints) -> Message | None:
    """That units, visits' means (v, 3) with one pose each, are rather one unit's files; None where they are not."""
    if recipe.reference.source == "rate":
        return None
    units, pose = np.unique(unit), orientations(mean)
    together = len(np.unique(pose))
    pairs = len(np.unique(np.stack([unit, pose]), axis=1).T)
    if len(units) < LEAST_TURNED or together < LEAST_TURNED or pairs > len(units):
        return None
    return Message("units-of-one-pose", units=len(units), poses=together)


def check_magnitude(recipe: Recipe, mean: Floats, unit: Ints, found: InferredSheet) -> None:
    """Errors: SamplesError where the magnitude at rest is not constant, whatever offset and matrix a unit may have."""
    if recipe.pose_known or found.full_scale is not None or recipe.reference.source == "rate":
        return
    spreads = [s for u in np.unique(unit) if (s := _magnitude_spread(mean[unit == u])) is not None]
    if spreads and min(spreads) > (MAGNITUDE if found.rate_hz else MAGNITUDE_OF_ONE):
        what = "field-not-constant" if recipe.unit == "uT" else "magnitude-not-constant"
        raise SamplesError(what, percent=100 * min(spreads))


def _magnitude_spread(mean: Floats) -> float | None:
    """Relative spread of the magnitudes of visits (v, 3) about the ellipsoid that fits them best; None for few."""
    if len(mean) < 14:
        return None
    # About their own middle: no offset, however large, lies outside the ellipsoid then.
    y = mean - mean.mean(axis=0)
    y = y / np.median(np.linalg.norm(y, axis=1))
    i, j = np.triu_indices(3)
    found = np.linalg.lstsq(np.c_[y[:, i] * y[:, j], y], np.ones(len(y)), rcond=None)[0]
    form = np.zeros((3, 3))
    form[i, j] = found[:6]
    form = (form + form.T) / 2
    slope = np.linalg.norm(2 * y @ form + found[6:], axis=1)
    off = np.abs(((y @ form + found[6:]) * y).sum(axis=1) - 1) / np.maximum(slope, 1e-300)
    return float(np.median(off) * 1.4826)


def remarks(
    recipe: Recipe,
    table: SampleTable,
    visits: tuple[NDArray[np.int64], Floats, NDArray[np.bool_]],
    found: InferredSheet,
    turned: Message | None,
) -> Iterator[Message]:
    """What a person should know; visits: first rows (v), means (v, 3) and which are left out (v); turned: what was
    remarked of units with a pose each."""
    begin, mean, out = visits
    yield from _rate(recipe, table, begin, found)
    yield from _unit(recipe, mean[~out], table.unit.code[begin][~out])
    if found.full_scale is not None and recipe.device.full_scale is None:
        yield Message("readings-cut-off", full_scale=found.full_scale, unit=recipe.unit)
    if turned is not None:
        yield turned
    else:
        yield from _not_stimulated(recipe, mean[~out], table.unit.code[begin][~out], table.unit.names)
    yield from _restarts(table, begin)


def stepped(
    recipe: Recipe, table: SampleTable, begin: NDArray[np.int64], mean: Floats, steps: NDArray[np.intp]
) -> Iterator[Message]:
    """That visits were ended at rows (k) where their mean steps; begin (v), mean (v, 3): of all visits since."""
    for row in steps[:MOST_SAID].tolist():
        v = int(np.searchsorted(begin, row))
        yield Message(
            "mean-steps", serial=table.unit.names[table.unit.code[row]], run=int(table.run[row]),
            visit=int(table.visit[row]), time_s=float(table.time_s[row]),
            step=float(np.linalg.norm(mean[v] - mean[v - 1])), unit=recipe.unit,
        )  # fmt: skip
    if len(steps) > MOST_SAID:
        yield Message("mean-steps-more", count=len(steps) - MOST_SAID)


def _rate(recipe: Recipe, table: SampleTable, begin: NDArray[np.int64], found: InferredSheet) -> Iterator[Message]:
    """Another rate than the sheet's: grossly, by the counts and by the usual step, or exactly one that sensors are set
    to. A sheet that states another step of the readings, too, is another device's."""
    if found.rate_hz is None or "rate_hz" not in recipe.device.model_fields_set:
        return
    sheet = recipe.device.rate_hz
    steps = np.diff(table.time_s)
    steps = np.delete(steps, begin[1:] - 1)
    steps = steps[steps > 0]
    usual = 1 / float(np.median(steps)) if len(steps) else sheet
    # Lost frames change the counts, rounded stamps the usual step: a rate shows in both.
    grossly = all(abs(rate / sheet - 1) > RATE for rate in (found.rate_hz, usual))
    another = abs(usual / found.rate_hz - 1) < RATE and usual_rates.is_another(found.rate_hz, sheet)
    lsb = float(found.lsb.max()) if "lsb" in recipe.device.model_fields_set else 0.0
    # No clock is off by so much: loggers that poll keep no rate that sensors are set to.
    polled = all(not 1 / FAR_RATE < rate / sheet < FAR_RATE for rate in (found.rate_hz, usual))
    if (another or polled) and lsb > SAME_STEP * recipe.device.lsb:
        yield Message(
            "sheet-of-another-device", rate_hz=found.rate_hz, sheet_hz=sheet, lsb=lsb, sheet_lsb=recipe.device.lsb,
            unit=recipe.unit,
        )  # fmt: skip
    elif another or grossly:
        yield Message("rate-differs", rate_hz=found.rate_hz, sheet_hz=sheet)


def _unit(recipe: Recipe, mean: Floats, unit: Ints) -> Iterator[Message]:
    quantity = QUANTITIES.get(recipe.unit)
    if quantity is None or quantity.sizes is None or not len(mean):
        return
    strength, about = recipe.reference.strength(), mean
    if sensor.of(recipe).large_offset:
        # A compass turned all round shows its field about the middle of its readings, however large its iron is.
        about = np.concatenate([(own := mean[unit == u]) - sphere(own)[0] for u in np.unique(unit)])
    ratio = float(np.median(np.linalg.norm(about, axis=1))) / strength if strength > 0 else 1.0
    if 1 / 1.5 < ratio < 1.5:
        return
    names = [name for name, factor in quantity.factors.items() if abs(ratio * factor - 1) < SAME_RATIO]
    if names and names[0] != recipe.unit:
        yield Message("readings-in-other-unit", ratio=ratio, unit=names[0], wanted=recipe.unit)
    elif not 1 / FAR_OFF < ratio < FAR_OFF and not sensor.of(recipe).large_offset:
        yield Message("readings-wrong-scale", ratio=ratio)


def _not_stimulated(recipe: Recipe, mean: Floats, unit: Ints, names: tuple[str, ...]) -> Iterator[Message]:
    """Axes that the recipe's own poses stimulate, or any would, but these visits do not."""
    planned = np.ones(3)
    if recipe.pose_known:
        true = np.array([recipe.true_vector(p) for p in recipe.positions])
        planned = np.ptp(true, axis=0) if len(true) > 1 else np.zeros(3)
    size = float(np.median(np.linalg.norm(mean, axis=1))) if len(mean) else 0.0
    for u in np.unique(unit):
        own = mean[unit == u]
        reach = np.ptp(own, axis=0) if len(own) else np.zeros(3)
        for i in np.flatnonzero((reach < STIMULATED * size) & (planned > STIMULATED * size)):
            yield Message(
                "axis-not-stimulated", serial=names[u], axis="xyz"[i], range=float(reach[i]), unit=recipe.unit
            )


def _restarts(table: SampleTable, begin: NDArray[np.int64]) -> Iterator[Message]:
    """A clock that starts again between visits of one run."""
    same = (np.diff(table.unit.code[begin]) == 0) & (np.diff(table.run[begin]) == 0)
    step_s = np.diff(table.time_s[begin])
    # Of single readings two may have one coarse stamp.
    several = np.diff(begin) > 1
    back = same & ((step_s < 0) | ((step_s == 0) & several))
    if back.any():
        row = int(begin[1:][back][0])
        yield Message(
            "clock-restarts", serial=table.unit.names[table.unit.code[row]], run=int(table.run[row]),
            visit=int(table.visit[row]), times=int(back.sum()),
        )  # fmt: skip
