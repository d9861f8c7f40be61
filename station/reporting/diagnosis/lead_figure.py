"""The one picture of the first screen: the leading cause in its own terms."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from station.reporting.diagnosis import clock_course, partial_residual, plots, scatter_figure, tables
from station.reporting.diagnosis.cause_text import drawn_over
from station.reporting.diagnosis.data import DwellCourse, DwellSamples, ReportData, ToneSpectrum
from station.reporting.diagnosis.finding_text import leading_cause
from station.reporting.diagnosis.plot_axis import best_axis
from station.reporting.diagnosis.quantity_format import display_unit
from station.reporting.diagnosis.sentences import report_text
from station.reporting.drawing.figure import Figure, Series, svg

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

CaptionedFigure = tuple[str, str]


def draw(data: ReportData) -> CaptionedFigure | None:
    """The picture and how to read it; None where there is nothing to draw."""
    verdict = data.document["verdict"]
    if verdict == "none":
        return _floor(data)
    if verdict == "unknown":
        return _unknown(data)
    cause = leading_cause(data)
    return _of_samples(data, cause) or cause_figure(data, cause) or _numbers(cause) or _floor(data)


def cause_figure(data: ReportData, cause: Mapping[str, Any]) -> CaptionedFigure | None:
    """The residual against what the cause depends on; None of a cause that moves no means."""
    if scatter := scatter_figure.draw(data, cause):
        return scatter, report_text("caption-scatter")
    signature, over = data.signature(cause["effect"]), drawn_over(cause["effect"])
    if over == "dwell" and data.dwell is not None:
        return dwell_figure(data.dwell, data.unit_of_readings, cause["effect"]), report_text("caption-dwell")
    if signature is None:
        return None
    drawn = None if over is None else partial_residual.draw(data, cause, over, signature)
    return (drawn, report_text("caption-cause")) if drawn else _over_best_axis(data, cause)


def _over_best_axis(data: ReportData, cause: Mapping[str, Any]) -> CaptionedFigure | None:
    """Over whatever orders the signature best, where the cause's own axis was not recorded."""
    signature = data.signature(cause["effect"])
    if signature is None:
        return None
    rows = np.ones(len(signature.values), bool)
    axis = best_axis(data, signature.values, rows, ())
    if axis is None:
        return None
    strongest = int(np.argmax(np.nansum(signature.values**2, axis=0)))
    title = report_text("figure-cause", effect=cause["effect"])
    return plots.overlay(data, signature.values, axis, rows, title, strongest), report_text("caption-overlay")


def _of_samples(data: ReportData, cause: Mapping[str, Any]) -> CaptionedFigure | None:
    """A cause that shows in single samples: its spectrum, its readings, or read against expected."""
    over = drawn_over(cause["effect"])
    if over == "spectrum" and data.spectrum is not None:
        caption = report_text("caption-spectrum" if data.spectrum.off is not None else "caption-spectrum-on")
        return spectrum_figure(data.spectrum, cause, data.unit_of_readings), caption
    if over == "clock" and data.clock is not None:
        return clock_course.figure(data.clock, cause["effect"]), report_text("caption-clock")
    if over == "samples" and cause["effect"] in data.samples:
        return samples_figure(data.samples[cause["effect"]], cause, data.unit_of_readings), report_text(
            "caption-samples"
        )
    if over == "expected":
        return _scatter_figure(data, cause["effect"])
    return None


def dwell_figure(course: DwellCourse, unit: str, effect: str) -> str:
    """The mean course within a dwell."""
    factor, words = display_unit([float(np.abs(course.residual).max())], unit)
    at = course.time_s.tolist()
    wide = 1.96 * factor * (np.zeros(len(at)) if course.std is None else course.std)
    measured = course.residual * factor
    low, high = (measured - wide).tolist(), (measured + wide).tolist()
    noise = 1.96 * factor * (np.zeros(len(at)) if course.noise is None else course.noise)
    series = (
        Series(
            *(at, [0.0] * len(at), report_text("legend-noise")),
            kind="line",
            low=(-noise).tolist(),
            high=noise.tolist(),
            colour=5,
        ),
        Series(at, (course.signature * factor).tolist(), report_text("legend-cause"), kind="line", colour=1),
        Series(at, measured.tolist(), report_text("legend-measured"), low=low, high=high),
    )
    title, along = report_text("figure-dwell", effect=effect), report_text("axis-within-dwell")
    return svg(Figure(title, along, report_text("axis-residual", unit=words), series, width=760, height=330))


def spectrum_figure(found: ToneSpectrum, cause: Mapping[str, Any], unit: str) -> str:
    """Amplitude against frequency with the motors on and off, and where the tone appears."""
    factor, words = display_unit([float(found.on.max())], unit)
    at = found.frequency_hz.tolist()
    series = [Series(at, (found.on * factor).tolist(), report_text("legend-motors-on"), kind="line")]
    if found.off is not None:
        series.insert(
            0, Series(at, (found.off * factor).tolist(), report_text("legend-motors-off"), kind="line", colour=5)
        )
    rows = cause["parameters"]
    tone = next((float(r["value"]) for r in rows if r["name"] == "frequency"), None)
    size = next((abs(float(r["value"])) for r in rows if r["axis"] == found.axis), None)
    if tone is not None and size is not None:
        rate = 2 * float(found.frequency_hz[-1])
        alias = abs(tone - rate * round(tone / rate))
        series.append(Series([alias], [size * factor], report_text("legend-cause"), kind="dashes", colour=1))
    title = report_text("figure-spectrum", effect=cause["effect"], axis=found.axis)
    along, up = report_text("axis-frequency"), report_text("axis-amplitude", unit=words)
    return svg(Figure(title, along, up, tuple(series), width=760, height=360))


def samples_figure(found: DwellSamples, cause: Mapping[str, Any], unit: str) -> str:
    """The readings of one dwell, one after the other."""
    middle = float(np.median(found.reading))
    factor, words = display_unit([float(np.abs(found.reading - middle).max())], unit)
    series = (
        Series(
            list(map(float, range(len(found.reading)))),
            ((found.reading - middle) * factor).tolist(),
            report_text("legend-readings"),
            kind="cloud",
        ),
    )
    title = report_text("figure-samples", effect=cause["effect"], axis=found.axis, name=found.unit)
    along, up = report_text("axis-samples"), report_text("axis-about-median", unit=words)
    return svg(Figure(title, along, up, series, width=760, height=360))


def _scatter_figure(data: ReportData, effect: str) -> CaptionedFigure | None:
    """What was read against what an ideal unit would read."""
    if data.read is None or data.expected is None:
        return None
    series = [
        Series(data.expected[:, i].tolist(), data.read[:, i].tolist(), axis, kind="cloud", colour=i)
        for i, axis in enumerate("xyz")
    ]
    ends = [float(data.expected.min()), float(data.expected.max())]
    series.append(Series(ends, ends, report_text("legend-ideal"), kind="line", colour=5))
    unit = data.unit_of_readings
    title, across = report_text("figure-expected", effect=effect), report_text("axis-expected", unit=unit)
    figure = Figure(title, across, report_text("axis-read", unit=unit), tuple(series), width=760, height=380)
    return svg(figure), report_text("caption-expected")


def _unknown(data: ReportData) -> CaptionedFigure | None:
    words = [_AXES[w] for w in data.document["unknown"]["depends_on"] if w in _AXES]
    for name in (*words, "position", "time_s"):
        drawn = plots.residual(data, name, report_text("figure-unknown"))
        if drawn:
            return drawn, report_text("caption-unknown")
    return None


def _numbers(cause: Mapping[str, Any]) -> CaptionedFigure | None:
    drawn = tables.intervals_chart(cause)
    return (drawn, report_text("caption-intervals")) if drawn else None


def _floor(data: ReportData) -> CaptionedFigure | None:
    for name in ("position", "time_s"):
        drawn = plots.residual(data, name, report_text("figure-residual"))
        if drawn:
            return drawn, report_text("caption-floor")
    return None
