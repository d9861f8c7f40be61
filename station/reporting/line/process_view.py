"""One value of one recipe's units: in their order, by nest, and before and after a change."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from station.domain.line_quality.comparison import MeanChange, compare
from station.messages import Message
from station.reporting.drawing.box import Box, draw_boxes
from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import mark, svg_document, svg_text
from station.reporting.drawing.levels import grid
from station.reporting.drawing.scale import Scale, axis_range
from station.reporting.line.process_chart import draw_process
from station.reporting.line.statistics import AttemptValues, LineStatistics
from station.reporting.line.value_series import ValueSeries
from station.reporting.number_text import format_number
from station.reporting.words import Words

_WIDTH, _HEIGHT = 560.0, 330.0
_MARKS = (("square", "#465562"), ("circle", "#0a5aa8"))


@dataclass(frozen=True, slots=True)
class Chosen:
    """What a reader chose in the chart, as numbers of units from 1; 0: nothing. change: the first unit after it."""

    first: int = 0
    last: int = 0
    change: int = 0


@dataclass(frozen=True, slots=True)
class ProcessView:
    """Figures and what stands beside them; None, '' and () where there is nothing to show.

    selected: the chosen units with their numbers; change_sentence: the difference with its interval.
    """

    chart: Drawing | None = None
    boxes: Drawing | None = None
    change: Drawing | None = None
    change_sentence: str = ""
    change_at: int = 0
    selected: tuple[tuple[int, AttemptValues], ...] = ()
    count: int = 0


def view_process(
    line: LineStatistics, value: str, chosen: Chosen, when: Callable[[int], str], words: Words
) -> ProcessView:
    """The figures of a value. when: an instant (ns) as the reader's clock shows it."""
    process = ValueSeries.of(line, value)
    count = len(process.values)
    if count < 2:
        return ProcessView(count=count)
    numbered = tuple(enumerate(process.attempts, 1))
    first, last = (chosen.first or 1, min(chosen.last or count, count))
    change_at = min(max(chosen.change or count // 2 + 1, 2), count)
    change, sentence = _change(process, change_at, words)
    return ProcessView(
        chart=draw_process(process, (first, last) if chosen.first or chosen.last else None, change_at, when, words),
        boxes=_boxes(process, words),
        change=change,
        change_sentence=sentence,
        change_at=change_at,
        selected=tuple((n, a) for n, a in numbered if first <= n <= last),
        count=count,
    )


def _boxes(process: ValueSeries, words: Words) -> Drawing:
    """Median, quartiles and range of each nest; single units outside the limits by themselves."""
    stations = {a.nest.partition("/")[0] for a in process.attempts}
    by_nest: dict[str, list[float]] = {}
    for a, v in zip(process.attempts, process.values, strict=True):
        by_nest.setdefault(a.nest.partition("/")[2] if len(stations) == 1 else a.nest, []).append(v)
    boxes = []
    for name, values in sorted(by_nest.items()):
        good = [v for v in values if process.inside(v)] or values
        outside = tuple(v for v in values if not process.inside(v))
        quartiles = np.percentile(good, (0, 25, 50, 75, 100))
        boxes.append(Box(name, len(values), tuple(float(q) for q in quartiles), outside))
    title = words.render(Message("chart-by-nest", value=words.term(process.name)))
    return draw_boxes(title, boxes, process.specification(words))


def _change(process: ValueSeries, change_at: int, words: Words) -> tuple[Drawing | None, str]:
    """The units within specification before and after, and the change of their mean in words."""
    numbered = [(n, v) for n, v in enumerate(process.values, 1) if process.inside(v)]
    groups = [v for n, v in numbered if n < change_at], [v for n, v in numbered if n >= change_at]
    found = compare(np.array(groups[0]), np.array(groups[1]))
    if found is None:
        return None, ""
    title = words.render(Message("chart-before-and-after", value=words.term(process.name), number=change_at))
    sentence = words.render(
        Message("chart-change", difference=format_number(found.difference, 3), half=format_number(found.half_width, 2))
    )
    return Drawing(
        lambda width: svg_document(width, _HEIGHT, title, _groups(groups, found, process.target, words, width)), _WIDTH
    ), sentence


def _groups(
    groups: tuple[list[float], list[float]], found: MeanChange, target: float | None, words: Words, width: float
) -> list[str]:
    means = (found.before, found.after)
    ends = [m.mean + side * m.half_width for m in means for side in (-1, 1)]
    x, y = (
        Scale(0, 2, min(70.0, 0.14 * width), width - 20),
        Scale(*axis_range([*groups[0], *groups[1], *ends]), _HEIGHT - 62, 46.0),
    )
    parts = grid(x, y)
    if target is not None and y.low <= target <= y.high:
        parts.append(f'<path d="M{x.start} {y(target):.1f}H{x.end}" stroke="#14212c" stroke-dasharray="2 4"/>')
    for place, (values, group, (shape, colour)) in enumerate(zip(groups, means, _MARKS, strict=True)):
        step = 0.6 / max(len(values), 2)
        parts += [mark(shape, x(place + 0.08 + step * i), y(v), colour) for i, v in enumerate(values)]
        at, low, high = x(place + 0.78), y(group.mean - group.half_width), y(group.mean + group.half_width)
        parts.append(
            f'<path d="M{at:.1f} {low:.1f}V{high:.1f}M{at - 7:.1f} {low:.1f}h14M{at - 7:.1f} {high:.1f}h14" '
            'stroke="#14212c" stroke-width="2"/>'
        )
        parts.append(mark("diamond", at, y(group.mean), "#ffb938", 1.7))
        name = words.render(Message("chart-after" if place else "chart-before", count=group.n))
        mean = f"{words.term('mean')} {format_number(group.mean, 5)}"
        parts += [svg_text(x(place + 0.42), _HEIGHT - 36, name, "middle")]
        parts += [svg_text(x(place + 0.42), _HEIGHT - 16, mean, "middle")]
    return parts
