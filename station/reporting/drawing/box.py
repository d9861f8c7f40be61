"""Boxes side by side: median, quartiles and range of groups, with what lies outside its limits as marks."""

from collections.abc import Sequence
from dataclasses import dataclass

from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import mark, svg_document, svg_text
from station.reporting.drawing.levels import Level, draw_levels, grid, names_width
from station.reporting.drawing.scale import Scale, axis_range

_WIDTH, _HEIGHT = 560.0, 330.0
_BLUE, _RED, _INK = "#0a5aa8", "#ae131f", "#14212c"


@dataclass(frozen=True, slots=True)
class Box:
    """quartiles: smallest, first quartile, median, third quartile, largest; outside: values drawn one by one."""

    name: str
    n: int
    quartiles: tuple[float, ...]
    outside: tuple[float, ...] = ()


def draw_boxes(title: str, boxes: Sequence[Box], levels: Sequence[Level]) -> Drawing:
    """The boxes in their order."""
    return Drawing(lambda width: _svg(title, boxes, levels, width), _WIDTH)


def _svg(title: str, boxes: Sequence[Box], levels: Sequence[Level], width: float) -> str:
    values = [v for box in boxes for v in (*box.quartiles, *box.outside)]
    x = Scale(0, max(len(boxes), 1), min(70.0, 0.14 * width), width - names_width(levels))
    y = Scale(*axis_range([*values, *(level.y for level in levels)]), _HEIGHT - 52, 40.0)
    parts = [*grid(x, y), *draw_levels(levels, x, y)]
    half = min(34.0, 0.3 * (x(1) - x(0)))
    for place, box in enumerate(boxes):
        parts += _box(box, x(place + 0.5), half, y)
        parts.append(svg_text(x(place + 0.5), _HEIGHT - 30, box.name, "middle", weight=600))
        parts.append(svg_text(x(place + 0.5), _HEIGHT - 12, f"n = {box.n}", "middle"))
    return svg_document(width, _HEIGHT, title, parts)


def _box(box: Box, at: float, half: float, y: Scale) -> list[str]:
    low, first, middle, third, high = map(y, box.quartiles)
    whiskers = f"M{at:.1f} {low:.1f}V{first:.1f}M{at:.1f} {third:.1f}V{high:.1f}"
    ends = "".join(f"M{at - half / 2:.1f} {end:.1f}h{half:.1f}" for end in (low, high))
    return [
        f'<path d="{whiskers}{ends}" stroke="{_BLUE}" stroke-width="2"/>',
        f'<rect x="{at - half:.1f}" y="{third:.1f}" width="{2 * half:.1f}" height="{max(first - third, 1):.1f}" '
        f'fill="#e3eef9" stroke="{_BLUE}" stroke-width="2"/>',
        f'<path d="M{at - half:.1f} {middle:.1f}h{2 * half:.1f}" stroke="{_INK}" stroke-width="3"/>',
        *(mark("diamond", at, y(value), _RED, 1.8) for value in box.outside),
    ]
