"""The picture of a clock that is off: how far it gets ahead of the host's within the dwells."""

from collections.abc import Sequence

import numpy as np

from station.diagnosis.data.faults import clock
from station.diagnosis.data.faults.gross_fault import GrossFault
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.reporting.diagnosis.data import ClockCourse
from station.reporting.diagnosis.point_groups import group_points
from station.reporting.diagnosis.sentences import report_text
from station.reporting.drawing.figure import Figure, Series, svg

#: Groups that the points are averaged in, and single points drawn.
GROUPS, MOST_POINTS = 10, 400


def of(recipe: Recipe, table: SampleTable, faults: Sequence[GrossFault]) -> ClockCourse | None:
    """Of the unit whose clock is farthest off; None where no clock is."""
    numbers = [n for f in faults if f.effect == "clock-error" for n in f.numbers]
    if not numbers:
        return None
    worst = max(numbers, key=lambda n: abs(float(n.value)))
    name = worst.of.partition(":")[2]
    key = np.stack([table.unit.code, table.run, table.visit])
    stop = np.cumsum(np.any(np.diff(key, axis=1, prepend=key[:, :1]) != 0, axis=0))
    time_s, group, number = clock.frames_of(recipe, table, stop, table.unit.names.index(name))
    _, first, of_stop = np.unique(group, return_index=True, return_inverse=True)
    host = time_s - time_s[first][of_stop]
    device = (number - number[first][of_stop]) / recipe.device.rate_hz
    tolerance = recipe.device.clock_tolerance_ppm * 1e-6
    return ClockCourse(name, host, np.asarray(device - host), float(worst.value), tolerance)


def figure(found: ClockCourse, effect: str) -> str:
    """Ahead of the host's clock against time: single frames, groups with 95 % bars, the rate that was found, and what
    the data sheet allows behind."""
    end = float(found.host_s.max())
    factor, unit = (1e3, "ms") if abs(found.rate_error) * end >= 1e-3 else (1e6, "µs")
    at, mean, wide = _groups(found.host_s, found.ahead_s * factor)
    rows = np.linspace(0, len(found.host_s) - 1, min(MOST_POINTS, len(found.host_s))).astype(np.intp)
    allowed = [0.0, found.tolerance * end * factor]
    series = (
        Series([0.0, end], [0.0, 0.0], report_text("legend-tolerance"), kind="line", low=[-a for a in allowed],
               high=allowed, colour=5),
        Series(found.host_s[rows].tolist(), (found.ahead_s[rows] * factor).tolist(), kind="faint"),
        Series([0.0, end], [0.0, found.rate_error * end * factor], report_text("legend-cause"), kind="line", colour=1),
        Series(at.tolist(), mean.tolist(), report_text("legend-measured"), low=(mean - wide).tolist(),
               high=(mean + wide).tolist()),
    )  # fmt: skip
    title = report_text("figure-clock", effect=effect, name=found.unit)
    along, up = report_text("axis-clock"), report_text("axis-ahead", unit=unit)
    return svg(Figure(title, along, up, series, width=760, height=360))


def _groups(at: Floats, value: Floats) -> tuple[Floats, Floats, Floats]:
    """Means along the axis and of the values (g) of groups of equal steps, and half their 95 % intervals."""
    groups = group_points(at, GROUPS)
    middle, mean = groups.mean(at), groups.mean(value)
    # Within a group the values rise with time: only what is beside that slope is scatter.
    slope = np.polyfit(at, value, 1)[0] if len(at) > 1 and np.ptp(at) > 0 else 0.0
    wide = 1.96 * groups.scatter(value - slope * at) / np.sqrt(groups.size)
    return middle, mean, np.asarray(wide)
