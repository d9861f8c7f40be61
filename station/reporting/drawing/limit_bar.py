"""One value on the bar of its limits, with its uncertainty, and a closer look where that is small beside the limits."""

from dataclasses import dataclass

from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import mark, svg_document, svg_text
from station.reporting.drawing.scale import Scale, text_width, tick_label
from station.reporting.number_text import format_to_uncertainty

_WIDTH, _BAR_Y, _ZOOM_Y = 640.0, 66.0, 150.0
_GREEN, _AMBER, _RED, _INK = "#bcd8c9", "#ffe3ad", "#ae131f", "#14212c"
#: A closer look is worth its place where the uncertainty is less than this share of the limits' width.
_CLOSE = 0.08
#: Letters of a label, and the least room between two, in the drawing's own pixels.
_LABEL_PX, _GAP = 13, 8.0
_Span = tuple[float, float]
#: Half the height of the closer look.
_ZOOM_HALF = 30
#: And where value and limit lie within this share of that width.
_NEAR = 0.25


@dataclass(frozen=True, slots=True)
class LimitBar:
    """A value with its expanded uncertainty (None: not stated), its target and its limits, all in one unit.

    words: what stands at the lower limit, the target and the upper limit, and in the zone that is allowed.
    guard: so far within its limits a value has to lie.
    """

    value: float
    expanded: float | None
    low: float
    high: float
    target: float
    words: tuple[str, str, str, str]
    guard: float = 0.0

    @property
    def accepted(self) -> bool:
        """Whether the value lies within its limits by the guard band."""
        return self.low + self.guard <= self.value <= self.high - self.guard


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
    left, right = (min(max(whole(v), whole.start), whole.end) for v in (near.low, near.high))
    lines = [
        f'<path d="M{a:.1f} {_BAR_Y + 14:g}v6L{b:.1f} {_ZOOM_Y - _ZOOM_HALF:g}" stroke="#677683" fill="none"/>'
        for a, b in ((left, near.start), (right, near.end))
    ]
    return [*lines, *_bar(bar, near, _ZOOM_Y, named=False), *_stated(bar, near)]


def _stated(bar: LimitBar, near: Scale) -> list[str]:
    """The value with its uncertainty in figures above its mark, and what is allowed."""
    expanded = bar.expanded or 1.0  # a closer look is drawn only where it is stated
    value, wide = (format_to_uncertainty(figure, expanded) for figure in (bar.value, expanded))
    words, middle = f"{value} ± {wide}", (near.start + near.end) / 2
    parts = [svg_text(middle, _ZOOM_Y - 14, words, "middle", weight=600, size=_LABEL_PX)]
    zone = [min(max(near(v), near.start), near.end) for v in (bar.low + bar.guard, bar.high - bar.guard)]
    reach = text_width(words, _LABEL_PX) / 2 + _GAP
    room = text_width(bar.words[3], _LABEL_PX) + 2 * _GAP
    # In the free part of the zone that is allowed, beside the figures of the value.
    for left, right in ((zone[0], min(zone[1], middle - reach)), (max(zone[0], middle + reach), zone[1])):
        if right - left >= room:
            return [*parts, svg_text((left + right) / 2, _ZOOM_Y - 14, bar.words[3], "middle", size=_LABEL_PX)]
    return parts


def _bar(bar: LimitBar, across: Scale, y: float, *, named: bool) -> list[str]:
    low, high, begin, end = (
        min(max(across(v), across.start), across.end)
        for v in (bar.low, bar.high, bar.low + bar.guard, max(bar.high - bar.guard, bar.low + bar.guard))
    )
    at, half = across(bar.value), 13 if named else _ZOOM_HALF
    mark_y = y if named else y + 10
    parts = [
        f'<rect x="20" y="{y - half:g}" width="{across.end - across.start:g}" height="{2 * half:g}" fill="#f1f4f6"/>',
        f'<rect x="{low:.1f}" y="{y - half:g}" width="{high - low:.1f}" height="{2 * half:g}" fill="{_AMBER}"/>',
        f'<rect x="{begin:.1f}" y="{y - half:g}" width="{end - begin:.1f}" height="{2 * half:g}" fill="{_GREEN}"/>',
    ]
    parts += _levels(bar, across, y, half, named=named)
    if bar.expanded is not None:
        parts += _whiskers(across(bar.value - bar.expanded), across(bar.value + bar.expanded), mark_y)
    colour = "#0b6a3d" if bar.accepted else _RED
    return [*parts, mark("diamond", at, mark_y, colour, 2.0)]


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
                parts.append(svg_text(x, at, label, anchor, weight=600, size=_LABEL_PX))
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
