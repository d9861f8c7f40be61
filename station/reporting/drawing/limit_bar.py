"""One value on the bar of its limits, with its uncertainty, and a closer look where that is small beside the limits."""

import math
from dataclasses import dataclass

from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import mark, svg_document, svg_text
from station.reporting.drawing.scale import Scale, text_width, tick_label

_WIDTH, _BAR_Y, _ZOOM_Y = 640.0, 74.0, 150.0
_GREEN, _RED, _INK = "#bcd8c9", "#ae131f", "#14212c"
#: A closer look is worth its place where the uncertainty is less than this share of the limits' width.
_CLOSE = 0.08
#: Letters of a label, and the least room between two, in the drawing's own pixels.
_LABEL_PX, _GAP = 13, 8.0
_Span = tuple[float, float]
#: And where value and limit lie within this share of that width.
_NEAR = 0.25


@dataclass(frozen=True, slots=True)
class LimitBar:
    """A value with its expanded uncertainty (None: not stated), its target and its limits, all in one unit.

    words: what stands at the lower limit, the target and the upper limit, and in the zone that is allowed.
    """

    value: float
    expanded: float | None
    low: float
    high: float
    target: float
    words: tuple[str, str, str, str]

    @property
    def inside(self) -> bool:
        """Whether the value lies within its limits."""
        return self.low <= self.value <= self.high


def draw(bar: LimitBar, title: str) -> Drawing:
    """The whole bar, and below it the surroundings of the value."""
    return Drawing(lambda width: _svg(bar, title, width), _WIDTH)


def _svg(bar: LimitBar, title: str, width: float) -> str:
    low, high = min(bar.low, bar.value - (bar.expanded or 0.0)), max(bar.high, bar.value + (bar.expanded or 0.0))
    whole = Scale(low - 0.06 * (high - low), high + 0.06 * (high - low), 20.0, width - 20.0)
    parts = _bar(bar, whole, _BAR_Y, named=True)
    edge = min((bar.low, bar.high), key=lambda limit: abs(limit - bar.value))
    reach = max(1.6 * abs(edge - bar.value), 3.0 * (bar.expanded or 0.0))
    wide = bar.high - bar.low
    close = bar.expanded is not None and 0 < bar.expanded < _CLOSE * wide and reach < _NEAR * wide
    if close:
        near = Scale(bar.value - reach, bar.value + reach, 20.0, width - 20.0)
        parts += _lens(bar, whole, near)
    return svg_document(width, 216 if close else 112, title, parts)


def _lens(bar: LimitBar, whole: Scale, near: Scale) -> list[str]:
    left, right = whole(near.low), whole(near.high)
    lines = [
        f'<path d="M{a:.1f} {_BAR_Y + 16:g}L{b:.1f} {_ZOOM_Y - 22:g}" stroke="#677683" fill="none"/>'
        for a, b in ((left, near.start), (right, near.end))
    ]
    return [*lines, *_bar(bar, near, _ZOOM_Y, named=False), *_stated(bar, near)]


def _stated(bar: LimitBar, near: Scale) -> list[str]:
    """The value with its uncertainty in figures above the closer look, on white where the lines cross it."""
    expanded = bar.expanded or 1.0  # a closer look is drawn only where it is stated
    digits = max(1 - math.floor(math.log10(expanded)), 0)
    words, y = f"{bar.value:.{digits}f} ± {expanded:.{digits}f}".replace("-", "−"), _ZOOM_Y - 32
    half, middle = text_width(words, 12) / 2 + 4, (near.start + near.end) / 2
    white = f'<rect x="{middle - half:.1f}" y="{y - 12:g}" width="{2 * half:.1f}" height="16" fill="#fff"/>'
    return [white, svg_text(middle, y, words, "middle", weight=600)]


def _bar(bar: LimitBar, across: Scale, y: float, *, named: bool) -> list[str]:
    low, high = (min(max(across(v), across.start), across.end) for v in (bar.low, bar.high))
    at, half = across(bar.value), 13 if named else 20
    parts = [
        f'<rect x="20" y="{y - half:g}" width="{across.end - across.start:g}" height="{2 * half:g}" fill="#f1f4f6"/>',
        f'<rect x="{low:.1f}" y="{y - half:g}" width="{high - low:.1f}" height="{2 * half:g}" fill="{_GREEN}"/>',
    ]
    parts += _levels(bar, across, y, half, named=named)
    if bar.expanded is not None:
        parts += _whiskers(across(bar.value - bar.expanded), across(bar.value + bar.expanded), y)
    colour = "#0b6a3d" if bar.inside else _RED
    return [*parts, mark("diamond", at, y, colour, 2.0)]


def _levels(bar: LimitBar, across: Scale, y: float, half: float, *, named: bool) -> list[str]:
    """Limits and target with their labels, those of narrow limits above and below the bar; where even that is too
    narrow, the target goes without."""
    parts, rows = [], [(y - half - 8, list[_Span]()), (y + half + 18, list[_Span]())]
    for value, words, dash in ((bar.low, 0, ""), (bar.high, 2, ""), (bar.target, 1, "3 3")):
        if not across.low <= value <= across.high:
            continue
        x = across(value)
        parts.append(_level(x, y, half, dash))
        label = f"{bar.words[words]} {tick_label(value)}" if named else tick_label(value)
        anchor = "start" if x < across.start + 40 else "end" if x > across.end - 40 else "middle"
        own = _span(x, text_width(label, _LABEL_PX), anchor)
        for at, taken in rows if named else rows[1:]:
            if all(own[1] + _GAP < left or right + _GAP < own[0] for left, right in taken):
                taken.append(own)
                parts.append(svg_text(x, at, label, anchor, weight=600))
                break
    return parts


def _span(x: float, width: float, anchor: str) -> _Span:
    """From where to where a label reaches."""
    left = x - {"start": 0.0, "middle": width / 2, "end": width}[anchor]
    return left, left + width


def _level(x: float, y: float, half: float, dash: str) -> str:
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<path d="M{x:.1f} {y - half - 4:g}v{2 * half + 8:g}" stroke="{_INK}" stroke-width="2"{dashed}/>'


def _whiskers(left: float, right: float, y: float) -> list[str]:
    return [
        f'<path d="M{left:.1f} {y:g}H{right:.1f}M{left:.1f} {y - 7:g}v14M{right:.1f} {y - 7:g}v14" '
        f'stroke="{_INK}" stroke-width="2.5" fill="none"/>'
    ]
