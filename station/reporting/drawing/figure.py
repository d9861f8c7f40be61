"""A figure is a frozen value: series on two axes. `svg` draws it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import pairwise
from typing import Literal

from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.scale import Scale, axis_range, text_width, tick_label, ticks

#: Okabe & Ito: distinguishable with any colour vision, and on white at least 3 : 1 where lines are thin.
COLOURS = ("#0072b2", "#d55e00", "#007a5a", "#a8578a", "#8a6d00", "#444444", "#b00020", "#3f3fbf")

_LEFT, _RIGHT, _TOP, _BOTTOM = 62.0, 14.0, 34.0, 46.0


@dataclass(frozen=True, slots=True)
class Series:
    """One set of points. low and high draw a band (line) or error bars (dots); colour is an index.

    dots are marks a reader may count, each of a shape that tells its series without colour; links: (address, name) of
    each of them. a cloud is many small ones in one stroke, faint a paler one behind others; dashes
    are level strokes over them.
    """

    x: Sequence[float]
    y: Sequence[float]
    name: str = ""
    kind: Literal["dots", "cloud", "faint", "dashes", "line", "steps", "bars"] = "dots"
    low: Sequence[float] | None = None
    high: Sequence[float] | None = None
    colour: int = 0
    mark: Literal["circle", "square", "triangle", "diamond"] = "circle"
    links: Sequence[tuple[str, str]] = ()


@dataclass(frozen=True, slots=True)
class Figure:
    """Everything a figure shows. x_names replace numbers by words at 0, 1, 2 …; x_text writes
    any other number of that axis; levels are (y, name) lines."""

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    x_names: tuple[str, ...] = ()
    levels: tuple[tuple[float, str], ...] = ()
    width: float = 640
    height: int = 300
    zero: bool = True
    x_text: Callable[[float], str] | None = None


def svg(figure: Figure) -> str:
    """The figure as one SVG element with a title for screen readers."""
    return svg_document(figure.width, figure.height, figure.title, _parts(figure))


def plot(figure: Figure) -> Drawing:
    """The figure for any width."""
    return Drawing(lambda width: svg(replace(figure, width=width)), figure.width)


def panels(title: str, figures: Sequence[Figure]) -> str:
    """Figures one below the other in one SVG element, each with its own title."""
    parts, down = [], 28.0
    for figure in figures:
        parts.append(f'<g transform="translate(0 {down:g})">')
        parts += [svg_text(12, 20, figure.title, weight=600), *_parts(figure), "</g>"]
        down += figure.height
    return svg_document(max((f.width for f in figures), default=640), down + 4, title, parts)


def _parts(figure: Figure) -> list[str]:
    x, y = _scales(figure)
    return [*_frame(figure, x, y), *(p for s in figure.series for p in _series(s, x, y)), *_legend(figure)]


def svg_document(width: float, height: float, title: str, parts: Iterable[str]) -> str:
    """An SVG element around parts, with the title as text and for screen readers."""
    body = "\n".join(parts)
    role = "group" if "<a " in body else "img"  # what leads somewhere is no mere picture
    size = min(14, int((width - 24) / max(text_width(title, 1), 1.0)))  # a title longer than the paper is set smaller
    style = 'font-family="system-ui, sans-serif" font-size="12" fill="#222"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        f'height="{height:g}" role="{role}" {style}>\n<title>{escape(title)}</title>\n'
        f'<rect width="{width:g}" height="{height:g}" fill="#fff"/>\n{svg_text(12, 20, title, weight=600, size=size)}\n'
        f"{body}\n</svg>\n"
    )


def svg_text(
    x: float, y: float, words: str, anchor: str = "start", *, weight: int = 400, size: int = 12, turn: int = 0
) -> str:
    """One line of text at (x, y)."""
    turned = f' transform="rotate({turn} {x:.1f} {y:.1f})"' if turn else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-weight="{weight}" font-size="{size}"'
        f"{turned}>{escape(words)}</text>"
    )


def _scales(figure: Figure) -> tuple[Scale, Scale]:
    xs = [v for s in figure.series for v in s.x]
    ys = [v for s in figure.series for part in (s.y, s.low or (), s.high or ()) for v in part]
    ys += [v for v, _ in figure.levels]
    across = (-0.5, len(figure.x_names) - 0.5) if figure.x_names else axis_range(xs)
    up = axis_range(ys, zero=figure.zero)
    bottom = figure.height - _BOTTOM - (26 if _labels_slanted(figure) else 0)
    return Scale(*across, _LEFT, figure.width - _RIGHT), Scale(
        *up, bottom, _TOP + (20 * len(_legend_rows(figure)) if _legend_below_title(figure) else 0)
    )


def _labels_slanted(figure: Figure) -> bool:
    """Whether words under the axis would run into each other if they lay flat."""
    room = (figure.width - _LEFT - _RIGHT) / max(len(figure.x_names), 1)
    return max(map(text_width, figure.x_names), default=0) + 7 > room


def _legend_below_title(figure: Figure) -> bool:
    """Whether the legend would run into the title; then it stands under it."""
    names = sum(text_width(s.name) + 22 for s in figure.series if s.name)
    return bool(names) and 12 + text_width(figure.title, 15) + 8 + names > figure.width - _RIGHT


def _legend_rows(figure: Figure) -> list[list[Series]]:
    """The named series, as many in a row as it has room for."""
    rows: list[list[Series]] = []
    room = 0.0
    for s in figure.series:
        wide = text_width(s.name) + 22
        if s.name and (not rows or wide > room):
            rows.append([])
            room = figure.width - _RIGHT - 12
        if s.name:
            rows[-1].append(s)
            room -= wide
    return rows


def _frame(figure: Figure, x: Scale, y: Scale) -> list[str]:
    parts = [_line(x.start, y(v), x.end, y(v), "#ddd") for v in ticks(y.low, y.high)]
    parts += [svg_text(x.start - 6, y(v) + 4, tick_label(v), "end") for v in ticks(y.low, y.high)]
    parts += _x_labels(figure, x, y)
    for value, name in figure.levels:
        parts.append(_line(x.start, y(value), x.end, y(value), "#222", dash="5 3"))
        parts.append(svg_text(x.end - 4, y(value) - 4, name, "end"))
    parts.append(_line(x.start, y.start, x.end, y.start, "#222"))
    parts.append(svg_text((x.start + x.end) / 2, figure.height - 8, figure.x_label, "middle"))
    parts.append(svg_text(14, (y.start + y.end) / 2, figure.y_label, "middle", turn=-90))
    return parts


def _x_labels(figure: Figure, x: Scale, y: Scale) -> list[str]:
    if not figure.x_names:
        whole = all(float(v).is_integer() for s in figure.series for v in s.x)
        shown = [v for v in ticks(x.low, x.high, 8) if not whole or float(v).is_integer()]
        return [svg_text(x(v), y.start + 16, (figure.x_text or tick_label)(v), "middle") for v in shown]
    if _labels_slanted(figure):
        every = max(1, round(len(figure.x_names) * 15 / (x.end - x.start)))
        named = list(enumerate(figure.x_names))[::every]
        return [svg_text(x(i) + 4, y.start + 12, name[:12], "end", turn=-40, size=11) for i, name in named]
    return [svg_text(x(i), y.start + 16, name, "middle") for i, name in enumerate(figure.x_names)]


def _series(s: Series, x: Scale, y: Scale) -> list[str]:
    colour = COLOURS[s.colour % len(COLOURS)]
    points = [(x(a), y(b)) for a, b in zip(s.x, s.y, strict=True)]
    if s.kind == "bars":
        half = 0.35 * abs(x(1) - x(0))
        base = y(max(0.0, y.low))
        return [_rect(a - half, min(b, base), 2 * half, abs(b - base), colour) for a, b in points]
    if s.kind in ("cloud", "faint", "dashes"):
        return [_strokes(s.kind, points, colour)]
    parts = _band_or_bars(s, x, y, colour)
    if s.kind == "dots":
        marks = [mark(s.mark, a, b, colour) for a, b in points]
        return [*parts, *(_linked(m, *s.links[i]) if i < len(s.links) else m for i, m in enumerate(marks))]
    if s.kind == "steps":
        points = [p for (a, b), (c, _) in zip(points, [*points[1:], points[-1]], strict=True) for p in ((a, b), (c, b))]
    path = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
    return [*parts, f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.8"/>']


def mark(shape: str, x: float, y: float, colour: str, size: float = 1.0) -> str:
    """A mark centred at (x, y): each shape is told from the others without colour."""
    if shape == "circle":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{2.6 * size:g}" fill="{colour}"/>'
    h = 4.4 * size
    corners = {
        "square": ((-0.8, -0.8), (0.8, -0.8), (0.8, 0.8), (-0.8, 0.8)),
        "triangle": ((0.0, -1.1), (1.0, 0.8), (-1.0, 0.8)),
        "diamond": ((0.0, -1.3), (1.2, 0.0), (0.0, 1.3), (-1.2, 0.0)),
    }[shape]
    points = " ".join(f"{x + h * a:.1f},{y + h * b:.1f}" for a, b in corners)
    return f'<polygon points="{points}" fill="{colour}" stroke="#222" stroke-width="0.8"/>'


def _linked(drawn: str, address: str, name: str) -> str:
    return f'<a href="{escape(address)}" aria-label="{escape(name)}">{drawn}</a>'


def _strokes(kind: str, points: Sequence[tuple[float, float]], colour: str) -> str:
    """All points in one path: round dots, or dashes as wide as their distance leaves room for, 8 to 36 px."""
    at = sorted({round(a, 1) for a, _ in points})
    room = min((b - a for a, b in pairwise(at)), default=36.0)
    half, wide, cap = (min(max(0.35 * room, 4.0), 18.0), 3.0, "butt") if kind == "dashes" else (0.0, 4.6, "round")
    path = "".join(f"M{a - half:.1f} {b:.1f}h{2 * half:g}" for a, b in points)
    opacity = {"cloud": ' stroke-opacity="0.6"', "faint": ' stroke-opacity="0.25"'}.get(kind, "")
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{wide:g}" stroke-linecap="{cap}"{opacity}/>'


def _band_or_bars(s: Series, x: Scale, y: Scale, colour: str) -> list[str]:
    if s.low is None or s.high is None:
        return []
    if s.kind == "dots":
        rows = zip(s.x, s.low, s.high, strict=True)
        return [_line(x(a), y(lo), x(a), y(hi), colour) for a, lo, hi in rows]
    there = [f"{x(a):.1f},{y(b):.1f}" for a, b in zip(s.x, s.high, strict=True)]
    back = [f"{x(a):.1f},{y(b):.1f}" for a, b in zip(s.x, s.low, strict=True)][::-1]
    return [f'<polygon points="{" ".join(there + back)}" fill="{colour}" fill-opacity="0.18"/>']


def _legend(figure: Figure) -> list[str]:
    parts, down = [], 20.0 if _legend_below_title(figure) else 0.0
    for row in _legend_rows(figure):
        at = figure.width - _RIGHT
        for s in reversed(row):
            at -= text_width(s.name) + 22
            colour = COLOURS[s.colour % len(COLOURS)]
            parts.append(_legend_mark(s, at, 11 + down, colour))
            parts.append(svg_text(at + 14, 20 + down, s.name))
        down += 20
    return parts


def _legend_mark(s: Series, x: float, y: float, colour: str) -> str:
    """What stands for a series, as it is drawn: a mark, a band about its line, or a square of its colour."""
    if s.kind == "dots":
        return mark(s.mark, x + 5, y + 5, colour, 1.6 if s.mark == "circle" else 1.0)
    if s.kind == "line" and s.low is not None:
        band = f'<rect x="{x:.1f}" y="{y:.1f}" width="10.0" height="10.0" fill="{colour}" fill-opacity="0.18"/>'
        return band + _line(x, y + 5, x + 10, y + 5, colour)
    return _rect(x, y, 10, 10, colour)


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, *, dash: str = "") -> str:
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}"{dashed}/>'


def _rect(x: float, y: float, width: float, height: float, colour: str) -> str:
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{colour}"/>'
