"""The picture of a cause that is scatter: how far visits lie apart, and how far its size lets them."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats
from station.reporting.diagnosis.data import ReportData
from station.reporting.diagnosis.quantity_format import display_unit
from station.reporting.diagnosis.sentences import report_text
from station.reporting.drawing.figure import Figure, Series, svg

#: Of the width of a place: how far visits at one position are drawn apart.
SPREAD = 0.4
#: Visits drawn: more say no more.
MAX_POINTS = 300


def draw(data: ReportData, cause: Mapping[str, Any]) -> str | None:
    """What is left of the axis that scatters most: of a walk along the run that walks farthest, of a turn of each stop
    at the positions. None of a cause that is no scatter, or where no pose is known."""
    floor = data.document.get("floor") or {}
    if cause["effect"] not in ("bias-walk", "repeatability") or data.felt is None or "noise" not in floor:
        return None
    i = int(np.argmax(np.nansum(data.after**2, axis=0)))
    size = next(float(row["value"]) for row in cause["parameters"])
    noise, rest = float(floor["noise"]), data.after[:, i]
    if cause["effect"] == "repeatability":
        # A small turn moves a reading by as much of the stimulus as stands across its axis.
        across = np.sqrt(np.maximum(np.sum(data.felt**2, axis=1) - data.felt[:, i] ** 2, 0.0))
        return _at_positions(data, cause, rest, size * across, noise, i)
    return _along_run(data, cause, rest, size, noise, i)


def _along_run(
    data: ReportData, cause: Mapping[str, Any], rest: Floats, step: float, noise: float, i: int
) -> str | None:
    rows = _farthest_run(data, rest)
    if np.count_nonzero(rows) < 2:
        return None
    at, y = data.visit[rows].astype(float), rest[rows] - rest[rows].mean()
    # Of steps that add up: the variance of each sum about the mean of all, which a calibration takes up.
    n, k = len(at), np.arange(len(at)) + 1.0
    with_all = k * (n - (k - 1) / 2) / n
    spread = np.sqrt(noise**2 + step**2 * (k - 2 * with_all + with_all.mean()))
    unit = data.unit.names[data.unit.code[rows][0]]
    whose = ", ".join((report_text("report-unit", name=unit), report_text("report-run", number=int(data.run[rows][0]))))
    shown = _Scatter(at, y, spread, noise)
    return _figure(data, cause, shown, i, report_text("axis-order"), (), f", {whose}")


def _farthest_run(data: ReportData, rest: Floats) -> NDArray[np.bool_]:
    """The visits (v) of the run of a unit that scatters most about its mean."""
    code = data.unit.code.astype(np.intp) * (int(data.run.max()) + 1) + data.run
    count = np.maximum(np.bincount(code), 1)
    off = rest - (np.bincount(code, rest) / count)[code]
    return np.asarray(code == int(np.argmax(np.bincount(code, off**2) / count)))


def _at_positions(
    data: ReportData, cause: Mapping[str, Any], rest: Floats, turned: Floats, noise: float, i: int
) -> str:
    rows = np.arange(len(rest))
    at = data.position.code + SPREAD * (((rows * 0.6180339887) % 1.0) - 0.5)
    shown = _Scatter(at, rest, np.sqrt(noise**2 + turned**2), noise)
    return _figure(data, cause, shown, i, "", data.position.names, "")


class _Scatter(NamedTuple):
    """Visits: where (n), what is left (n), how far 95 % of them lie by the cause and the noise, /1.96 (n), and by the
    noise alone."""

    at: Floats
    rest: Floats
    spread: Floats
    noise: float

    def series(self, factor: float, *, places: bool) -> tuple[Series, ...]:
        """Noise, the cause's spread and the visits, of many some."""
        ends = [float(np.round(self.at).min()) - 0.5, float(np.round(self.at).max()) + 0.5]
        wide, at, spread = 1.96 * factor * self.noise, self.at, 1.96 * factor * self.spread
        if places:
            at, first = np.unique(np.round(at), return_index=True)
            spread = spread[first]
        kind: Literal["dashes", "line"] = "dashes" if places else "line"
        chosen = np.linspace(0, len(self.at) - 1, min(len(self.at), MAX_POINTS)).astype(np.intp)
        x, y, noise = self.at[chosen].tolist(), factor * self.rest[chosen], report_text("legend-noise")
        bars = {"low": (y - wide).tolist(), "high": (y + wide).tolist()}
        return (
            Series(ends, [0.0, 0.0], noise, kind="line", low=[-wide] * 2, high=[wide] * 2, colour=5),
            Series(at.tolist(), spread.tolist(), report_text("legend-spread"), kind=kind, colour=1),
            Series(at.tolist(), (-spread).tolist(), kind=kind, colour=1),
            Series(x, y.tolist(), report_text("legend-visits"), **bars),
        )


def _figure(
    data: ReportData, cause: Mapping[str, Any], shown: _Scatter, i: int, label: str, places: tuple[str, ...], whose: str
) -> str:
    factor, unit = display_unit([float(np.abs(shown.rest).max(initial=0.0))], data.unit_of_readings)
    title = report_text("figure-cause-axis", effect=cause["effect"], axis=data.axes[i]) + whose
    series = shown.series(factor, places=bool(places))
    return svg(Figure(title, label, report_text("axis-residual", unit=unit), series, places, width=760, height=360))
