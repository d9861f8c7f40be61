"""Horizontal lines across a plot, each of a stroke of its own, with their names on the right."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from station.reporting.drawing.figure import svg_text
from station.reporting.drawing.scale import Scale, text_width, tick_label, ticks

Stroke = Literal["limit", "control", "target", "centre"]
#: Colour, width and dashes of each stroke: specification solid, control limits dashed, target dotted.
_STROKES: dict[Stroke, tuple[str, float, str]] = {
    "limit": ("#ae131f", 2.5, ""),
    "control": ("#465562", 1.5, "7 4"),
    "target": ("#14212c", 1.8, "2 4"),
    "centre": ("#0a5aa8", 1.2, ""),
}
#: Names stand at least so far apart, px.
_APART = 16.0


@dataclass(frozen=True, slots=True)
class Level:
    """A line at y."""

    y: float
    name: str
    stroke: Stroke


def grid(x: Scale, y: Scale) -> list[str]:
    """Faint lines at round values of y, with their numbers on the left."""
    parts = []
    for value in ticks(y.low, y.high):
        parts.append(f'<path d="M{x.start:.1f} {y(value):.1f}H{x.end:.1f}" stroke="#dde3e8"/>')
        parts.append(svg_text(x.start - 8, y(value) + 4, tick_label(value), "end"))
    return parts


def names_width(levels: Sequence[Level]) -> float:
    """The room right of a plot that the names of its lines need, px."""
    return 22 + max((text_width(level.name) for level in levels), default=0.0)


def draw_levels(levels: Sequence[Level], x: Scale, y: Scale) -> list[str]:
    """The lines, and their names right of the plot, moved apart where they would run into each other."""
    parts = []
    below = -1e9
    for level in sorted(levels, key=lambda level: -level.y):
        colour, width, dash = _STROKES[level.stroke]
        at = y(level.y)
        text_at = max(at, below + _APART)
        below = text_at
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        parts.append(
            f'<path d="M{x.start:.1f} {at:.1f}H{x.end:.1f}" stroke="{colour}" stroke-width="{width:g}"{dashed}/>'
        )
        parts.append(f'<path d="M{x.end:.1f} {at:.1f}L{x.end + 10:.1f} {text_at:.1f}" stroke="#677683" fill="none"/>')
        weight = 600 if level.stroke == "limit" else 400
        parts.append(svg_text(x.end + 14, text_at + 4, level.name, weight=weight))
    return parts
