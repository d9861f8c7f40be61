"""The pictures of a report: residuals over everything that was recorded, and the cause's signature on top."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.reporting.diagnosis.data import ReportData
from station.reporting.diagnosis.plot_axis import AXIS_LABELS, PlotAxis, plot_axis
from station.reporting.diagnosis.quantity_format import display_unit
from station.reporting.diagnosis.sentences import report_text
from station.reporting.drawing.figure import Figure, Series, panels
from station.reporting.drawing.tables import heat_map

#: Points drawn on one axis, and rows of a heat map: more say no more, and fill the file.
POINTS, ROWS = 400, 40
#: Level lines of a figure, (y, name).
Levels = tuple[tuple[float, str], ...]


def scale_of(data: ReportData) -> tuple[float, str]:
    """Factor and unit in which the residuals are easy to read."""
    both = np.abs(np.concatenate([data.before, data.after]))
    large = np.quantile(both[np.isfinite(both)], 0.98) if np.isfinite(both).any() else 0.0
    return display_unit([float(large)], data.unit_of_readings)


def residual(data: ReportData, name: str, title: str) -> str | None:
    """What is left before and after against one axis, a panel for each axis of the sensor."""
    axis = plot_axis(data, name)
    if axis is None:
        return None
    factor, unit = scale_of(data)
    wide = 1.96 * data.noise_rms * factor
    levels = () if data.causes else ((wide, "95 % of noise"), (-wide, ""))
    figures = []
    for i, word in enumerate(data.axes):
        series = [_cloud(axis, data.before[:, i] * factor, "the simulation leaves" if i == 0 else "", 0)]
        if data.causes:
            series.append(_cloud(axis, data.after[:, i] * factor, "with the causes" if i == 0 else "", 5))
        figures.append(_figure(word, axis, unit, series, last=i == len(data.axes) - 1, levels=levels))
    return panels(title, figures)


def overlay(
    data: ReportData, signature: Floats, axis: PlotAxis, rows: NDArray[np.bool_], title: str, only: int | None = None
) -> str:
    """A signature (v, k) of the chosen rows (v) on top of the residual: on one axis of the sensor, or on each."""
    factor, unit = scale_of(data)
    rest = (data.after + signature) * factor
    chosen = axis.only(rows)
    shown = range(len(data.axes)) if only is None else [only]
    figures = []
    for i in shown:
        first = i == shown[0]
        cloud = _cloud(chosen, rest[:, i], "measured − simulated" if first else "", 0)
        line = _mean(chosen, signature[:, i] * factor, named=first)
        height = 170 if len(shown) > 1 else 330
        figures.append(_figure(data.axes[i], axis, unit, [line, cloud], last=i == shown[-1], height=height))
    return panels(title, figures)


def heat(data: ReportData, values: Floats, title: str, i: int) -> str | None:
    """Unit × position, the units with the largest rms first."""
    if len(data.position.names) < 2:
        return None
    factor, unit = scale_of(data)
    U, P = len(data.unit.names), len(data.position.names)
    cell = data.unit.code.astype(np.intp) * P + data.position.code
    there = np.isfinite(values[:, i])
    count = np.bincount(cell[there], minlength=U * P).reshape(U, P)
    total = np.bincount(cell[there], values[there, i], U * P).reshape(U, P)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan) * factor
    size = np.sqrt(np.nanmean(np.where(count > 0, mean, 0.0) ** 2, axis=1))
    shown = np.sort(np.argsort(-size, kind="stable")[:ROWS])
    if len(shown) < U:
        title = f"{title}: the {ROWS} of {U} units with the largest"
    cells = [[round(float(v), 3) for v in mean[u]] for u in shown]
    return heat_map(f"{title}, {data.axes[i]}", cells, [data.unit.names[u] for u in shown], data.position.names, unit)


def means(data: ReportData) -> str | None:
    """How far simulation and extended simulation are from the measured mean at each position."""
    axis = plot_axis(data, "position")
    if axis is None:
        return None
    factor, unit = scale_of(data)
    figures = []
    for i, word in enumerate(data.axes):
        series = []
        for side, (values, name) in enumerate(_sides(data)):
            mean, wide = _position_means(data, values[:, i] * factor)
            at = np.arange(len(mean)) + (0.14 if side else -0.14)
            low, high = (mean - wide).tolist(), (mean + wide).tolist()
            label = name if i == 0 else ""
            series.append(Series(at.tolist(), mean.tolist(), label, low=low, high=high, colour=5 if side else 0))
        figures.append(_figure(word, axis, unit, series, last=i == len(data.axes) - 1))
    return panels("Measured mean of each position less the simulated one (bars ± 95 %)", figures)


def _sides(data: ReportData) -> Iterator[tuple[Floats, str]]:
    yield data.before, "the simulation"
    if data.causes:
        yield data.after, "extended by the causes"


def _position_means(data: ReportData, values: Floats) -> tuple[Floats, Floats]:
    """Mean and 1.96 standard errors at each position."""
    code, n = data.position.code, len(data.position.names)
    count = np.maximum(np.bincount(code, minlength=n), 1)
    mean = np.bincount(code, values, n) / count
    square = np.bincount(code, (values - mean[code]) ** 2, n)
    return mean, 1.96 * np.sqrt(square / np.maximum(count - 1, 1) / count)


def _figure(
    title: str,
    axis: PlotAxis,
    unit: str,
    series: Sequence[Series],
    *,
    last: bool,
    height: int = 170,
    levels: Levels = (),
) -> Figure:
    down = 70 if last and axis.places else 0
    names = axis.places if last else tuple("" for _ in axis.places)
    label = AXIS_LABELS.get(axis.name, axis.name) if last else ""
    up = report_text("axis-residual", unit=unit)
    return Figure(title, label, up, tuple(series), names, levels, width=760, height=height + down)


def _cloud(axis: PlotAxis, values: Floats, name: str, colour: int) -> Series:
    """Dots, thinned so that the extremes stay; words on the axis get a little room beside each other."""
    rows = np.flatnonzero(np.isfinite(axis.at) & np.isfinite(values))
    rows = rows[_thinned(values[rows])]
    at = axis.at[rows]
    if axis.places:
        at = at + 0.28 * (((rows * 0.6180339887) % 1.0) - 0.5)
    return Series(at.tolist(), values[rows].tolist(), name, kind="cloud", colour=colour)


def _thinned(values: Floats) -> NDArray[np.intp]:
    """Which of many values to draw: the ten at either end, and evenly spaced ones between."""
    if len(values) <= POINTS:
        return np.arange(len(values))
    order = np.argsort(values, kind="stable")
    even = np.linspace(0, len(values) - 1, POINTS - 20).astype(np.intp)
    return np.unique(np.concatenate([order[:10], order[-10:], even]))


def _mean(axis: PlotAxis, values: Floats, *, named: bool = True) -> Series:
    """A signature's mean over each step of the axis: dashes at words, a line over numbers."""
    bins = axis.bins()
    there = bins >= 0
    count = np.bincount(bins[there])
    used = count > 0
    x = np.bincount(bins[there], axis.at[there])[used] / count[used]
    y = np.bincount(bins[there], values[there])[used] / count[used]
    name = "what the cause predicts" if named else ""
    return Series(x.tolist(), y.tolist(), name, kind="dashes" if axis.places or axis.single else "line", colour=1)
