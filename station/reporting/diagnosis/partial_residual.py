"""The picture of a cause in its own terms: what is left without it, against what it depends on."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from station.domain.core.types import Floats
from station.model.effect import DrawnOver
from station.reporting.diagnosis import cause_axis
from station.reporting.diagnosis.cause_axis import AffectedVisits, CauseAxis
from station.reporting.diagnosis.data import CauseSignature, ReportData
from station.reporting.diagnosis.point_groups import group_points
from station.reporting.diagnosis.quantity_format import display_unit
from station.reporting.diagnosis.sentences import report_text
from station.reporting.drawing.figure import Figure, Series, panels, svg

#: Groups that the points of a numeric axis are averaged in, steps of the curve, and single points drawn.
GROUPS, CURVE_STEPS, MAX_POINTS = 12, 80, 300
#: A curve is a polynomial of at most this degree where it misses it by less than this share of its range.
MOST_DEGREE, SAME_COURSE = 3, 0.02
#: Causes whose like in a calibration is left out of the picture: only their bend is anything new.
_BENDS = ("input", "input-product", "temperature-input")
#: Axes beside which the cause has another: points are its mean course there, and what is left.
_OF_SEVERAL = ("other-axis", "input-product")
#: The same where lengths are all that is known.
_ALONG_ONE = ("input", "step", "temperature-input")
#: Axes on which each visit stands for itself.
_ONE_BY_ONE = ("visits", "order")


class Course(NamedTuple):
    """Points of one sensor axis: where (n), measured without the cause taken off (n), and what the cause says (n)."""

    at: Floats
    measured: Floats
    cause: Floats
    single: bool = False


def draw(data: ReportData, cause: Mapping[str, Any], over: DrawnOver, signature: CauseSignature) -> str | None:
    """The strongest axis of the sensor alone; None where these data have no such axis."""
    chosen = cause_axis.affected_visits(data, cause, signature.values, over)
    i = strongest_axis(signature, chosen)
    axis = cause_axis.cause_axis(data, cause, over, signature, i)
    if axis is None:
        return None
    return svg(_figure(data, cause, axis, _course(data, signature, axis, chosen, over, i), chosen, i, height=360))


def draw_all(data: ReportData, cause: Mapping[str, Any], over: DrawnOver, signature: CauseSignature) -> str | None:
    """Every axis of the sensor, one panel each."""
    chosen = cause_axis.affected_visits(data, cause, signature.values, over)
    figures = []
    for i in range(len(data.axes)):
        axis = cause_axis.cause_axis(data, cause, over, signature, i)
        if axis is not None:
            course = _course(data, signature, axis, chosen, over, i)
            figures.append(_figure(data, cause, axis, course, chosen, i, height=230 + (26 if axis.places else 0)))
    return panels(report_text("figure-cause", effect=cause["effect"]), figures) if figures else None


def strongest_axis(signature: CauseSignature, chosen: AffectedVisits) -> int:
    """Number of the sensor axis that a cause moves most."""
    return int(np.argmax(np.nansum(signature.values[chosen.rows] ** 2, axis=0)))


def _course(
    data: ReportData, signature: CauseSignature, axis: CauseAxis, chosen: AffectedVisits, over: DrawnOver, i: int
) -> Course:
    rows = chosen.rows & np.isfinite(axis.at) & np.isfinite(data.after[:, i])
    predicted = (signature.values if over in _BENDS or signature.whole is None else signature.whole)[rows, i]
    # An offset belongs to the calibration: only what changes along the axis is the cause's.
    if not axis.places and over not in _ONE_BY_ONE:
        predicted = predicted - predicted.mean()
    if over in _ALONG_ONE and data.told is not None:
        # A length follows all axes: of what the cause does, the course along this one.
        predicted = cause_axis.bend(axis.at[rows], predicted)
    elif over in _OF_SEVERAL and data.told is not None:
        # Hardly two visits agree: of what the cause does, its share in proportion to this product.
        predicted = np.polyval(np.polyfit(axis.at[rows], predicted, 1), axis.at[rows])
    elif over in _OF_SEVERAL:
        places, code = np.unique(np.round(axis.at[rows], 2), return_inverse=True)
        predicted = (np.bincount(code, predicted) / np.bincount(code, minlength=len(places)))[code]
    return Course(axis.at[rows], data.after[rows, i] + predicted, predicted, over in _ONE_BY_ONE)


def _figure(
    data: ReportData, cause: Mapping[str, Any], axis: CauseAxis, c: Course, chosen: AffectedVisits, i: int, height: int
) -> Figure:
    factor, unit = display_unit([float(np.abs(c.measured).max(initial=0.0))], data.unit_of_readings)
    whose = f", {chosen.whose}" if chosen.whose else ""
    scaled = c._replace(measured=c.measured * factor, cause=c.cause * factor)
    title = "figure-cause" if data.told is not None else "figure-cause-axis"
    return Figure(
        report_text(title, effect=cause["effect"], axis=data.axes[i]) + whose,
        axis.label,
        report_text("axis-residual", unit=unit),
        (
            _noise_band(axis, scaled, 1.96 * data.noise_rms * factor),
            _single_points(axis, scaled),
            *_curve(axis, scaled),
            _grouped(axis, scaled, data.noise_rms * factor),
        ),
        axis.places,
        width=760,
        height=height,
    )


def _noise_band(axis: CauseAxis, c: Course, wide: float) -> Series:
    ends = [-0.5, len(axis.places) - 0.5] if axis.places else [float(c.at.min()), float(c.at.max())]
    return Series(
        ends, [0.0, 0.0], report_text("legend-noise"), kind="line", low=[-wide] * 2, high=[wide] * 2, colour=5
    )


def _single_points(axis: CauseAxis, c: Course) -> Series:
    rows = np.arange(len(c.at))
    if len(rows) > MAX_POINTS:
        rows = np.linspace(0, len(rows) - 1, MAX_POINTS).astype(np.intp)
    at = c.at[rows] + (0.3 * (((rows * 0.6180339887) % 1.0) - 0.5) if axis.places else 0.0)
    return Series(at.tolist(), c.measured[rows].tolist(), kind="faint")


def _curve(axis: CauseAxis, c: Course) -> list[Series]:
    """What the cause says along the axis: dashes at places, a line over numbers. A course that is no polynomial is not
    drawn over a gap, where the points say nothing of it."""
    groups = group_points(c.at, len(c.at) if c.single else len(axis.places) or CURVE_STEPS)
    at, predicted = groups.mean(c.at), groups.mean(c.cause)
    kind: Literal["dashes", "line"] = "dashes" if axis.places or c.single else "line"
    if kind == "line":
        fine, course = _between(at, predicted)
        # Of few points the gaps are no gaps in what was measured.
        broken = fine is at and len(at) > 2 * GROUPS
        ends = np.flatnonzero((np.diff(at) > np.ptp(at) / (2 * GROUPS)) & broken) + 1
        pieces = list(zip(np.split(fine, ends), np.split(course, ends), strict=True))
    else:
        pieces = [(at, predicted)]
    names = [report_text("legend-cause"), *[""] * len(pieces)]
    return [
        Series(x.tolist(), y.tolist(), name, kind=kind, colour=1) for name, (x, y) in zip(names, pieces, strict=False)
    ]


def _between(at: Floats, value: Floats) -> tuple[Floats, Floats]:
    """A course known at rising places (n), drawn between few of them as the polynomial that it is; as it came where it
    is none, as that of |a|, which breaks at 0."""
    middle, half, size = float(at.mean()), float(np.ptp(at)) / 2, float(np.ptp(value))
    fine = np.linspace(at[0], at[-1], CURVE_STEPS)
    for degree in range(2, min(MOST_DEGREE, len(at) - 2) + 1):
        course = np.polynomial.Polynomial.fit(at, value, degree, domain=[middle - half, middle + half])
        if np.abs(course(at) - value).max() < SAME_COURSE * size:
            return fine, np.asarray(course(fine))
    return at, value


def _grouped(axis: CauseAxis, c: Course, noise: float) -> Series:
    """Means of groups of visits with 95 % bars, from their scatter about the cause or the floor's where that is
    larger."""
    groups = group_points(c.at, len(c.at) if c.single else len(axis.places) or GROUPS, even=not axis.places)
    at, mean = groups.mean(c.at), groups.mean(c.measured)
    wide = 1.96 * np.maximum(groups.scatter(c.measured - c.cause), noise) / np.sqrt(groups.size)
    name = report_text("legend-measured")
    return Series(at.tolist(), mean.tolist(), name, low=(mean - wide).tolist(), high=(mean + wide).tolist())
