"""The one picture of the first screen."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.reporting.diagnosis import plots, tables
from station.reporting.diagnosis.cause_text import needed_by
from station.reporting.diagnosis.data import DwellCourse, ReportData
from station.reporting.diagnosis.finding_text import leading_cause
from station.reporting.diagnosis.plot_axis import best_axis
from station.reporting.diagnosis.quantity_format import display_unit
from station.reporting.drawing.figure import Figure, Series, svg

HOW_TO_READ = (
    "Blue: what the simulation leaves. Orange: what the cause predicts. They agree where the cause is the right one."
)
#: Which axis shows what an unknown depends on.
_AXES = {
    "time": "time_s",
    "position": "position",
    "temperature": "temperature_degC",
    "input": "position",
    "dwell-phase": "previous",
    "order": "previous",
    "unit": "unit",
    "group": "unit",
}
#: Gross faults that a scatter of read against expected shows.
_SCATTER_FAULTS = ("axis-permutation", "wrong-scale", "clipping")

CaptionedFigure = tuple[str, str]


def draw(data: ReportData) -> CaptionedFigure | None:
    """The picture and how to read it; None where there is nothing to draw."""
    verdict = data.document["verdict"]
    if verdict == "none":
        return _floor(data)
    if verdict == "unknown":
        return _unknown(data)
    cause = leading_cause(data)
    return (
        _scatter_figure(data, cause)
        or _moving(data, cause)
        or _signature(data, cause)
        or _numbers(cause)
        or _floor(data)
    )


def visits_to_draw(data: ReportData, cause: Mapping[str, Any], signature: Floats) -> NDArray[np.bool_]:
    """The stops (v) to draw a signature over: of the most affected unit where each unit has its own, else all."""
    groups = {str(row["of"]).split(":", 1)[0] for row in cause["parameters"]}
    if "unit" not in groups or len(data.unit.names) == 1:
        return np.ones(len(signature), bool)
    square = np.bincount(data.unit.code, np.nansum(signature**2, axis=1), len(data.unit.names))
    count = np.maximum(np.bincount(data.unit.code, minlength=len(data.unit.names)), 1)
    return np.asarray(data.unit.code == int(np.argmax(square / count)))


def unit_suffix(data: ReportData, rows: NDArray[np.bool_]) -> str:
    """Of which unit, where it is one of several."""
    return "" if rows.all() else f", most affected unit {data.unit.names[int(data.unit.code[rows][0])]}"


def _signature(data: ReportData, cause: Mapping[str, Any]) -> CaptionedFigure | None:
    signature = data.signature(cause["effect"])
    if signature is None:
        return None
    rows = visits_to_draw(data, cause, signature)
    axis = best_axis(data, signature, rows, needed_by(cause["effect"]))
    if axis is None:
        return None
    strongest = int(np.argmax(np.nansum(signature[rows] ** 2, axis=0)))
    title = f"{cause['effect']} on top of the residual{unit_suffix(data, rows)}"
    return plots.overlay(data, signature, axis, rows, title, strongest), HOW_TO_READ


def _moving(data: ReportData, cause: Mapping[str, Any]) -> CaptionedFigure | None:
    """The course within the dwell, of a cause that lives there."""
    if data.dwell is None or "since_arrival_s" not in needed_by(cause["effect"]):
        return None
    return dwell_figure(
        data.dwell, data.unit_of_readings, cause["effect"]
    ), f"{HOW_TO_READ} All stops, each turned the same way up."


def dwell_figure(course: DwellCourse, unit: str, effect: str) -> str:
    """The mean course within a dwell."""
    factor, words = display_unit([float(np.abs(course.residual).max())], unit)
    at = np.arange(len(course.parts), dtype=float).tolist()
    series = (
        Series(at, (course.residual * factor).tolist(), "measured − simulated"),
        Series(at, (course.signature * factor).tolist(), "what the cause predicts", kind="line", colour=1),
    )
    title = f"{effect} within the dwell"
    return svg(Figure(title, "", words, series, course.parts, width=760, height=330))


def _scatter_figure(data: ReportData, cause: Mapping[str, Any]) -> CaptionedFigure | None:
    """What was read against what an ideal unit would read."""
    if data.read is None or data.expected is None or cause["effect"] not in _SCATTER_FAULTS:
        return None
    series = [
        Series(data.expected[:, i].tolist(), data.read[:, i].tolist(), axis, kind="cloud", colour=i)
        for i, axis in enumerate("xyz")
    ]
    ends = [float(data.expected.min()), float(data.expected.max())]
    series.append(Series(ends, ends, "as it should be", kind="line", colour=5))
    unit = data.unit_of_readings
    figure = Figure(
        f"{cause['effect']}: read against expected", f"expected, {unit}", f"read, {unit}", tuple(series),
        width=760, height=380,
    )  # fmt: skip
    return svg(figure), "Every mean of a stop should lie on the grey line."


def _unknown(data: ReportData) -> CaptionedFigure | None:
    words = [_AXES[w] for w in data.document["unknown"]["depends_on"] if w in _AXES]
    for name in (*words, "position", "time_s"):
        drawn = plots.residual(data, name, "What no cause explains")
        if drawn:
            return drawn, "Something that is all noise would lie evenly about nought everywhere."
    return None


def _numbers(cause: Mapping[str, Any]) -> CaptionedFigure | None:
    drawn = tables.intervals_chart(cause)
    return (drawn, "Bars hold the true value in 95 of 100 cases.") if drawn else None


def _floor(data: ReportData) -> CaptionedFigure | None:
    for name in ("position", "time_s"):
        drawn = plots.residual(data, name, "What the simulation leaves")
        if drawn:
            return drawn, "All of it is as large as the noise floor makes it, and evenly spread about nought."
    return None
