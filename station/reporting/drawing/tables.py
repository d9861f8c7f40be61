"""Figures that are tables at heart: horizontal bars (budgets, Pareto) and a heat map (unit × position)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import COLOURS, svg_document, svg_text
from station.reporting.drawing.scale import text_width as width_of
from station.reporting.drawing.scale import tick_label


def bar_drawing(title: str, rows: Sequence[tuple[str, float]], unit: str = "") -> Drawing:
    """The bars for any width."""
    return Drawing(lambda width: bar_chart(title, rows, unit, width), 640)


def bar_chart(title: str, rows: Sequence[tuple[str, float]], unit: str = "", width: float = 640) -> str:
    """One horizontal bar a row (name, value ≥ 0), the number at its end."""
    height, names = 44 + 24 * len(rows), 8 + max((width_of(n) for n, _ in rows), default=0.0)
    most = max((v for _, v in rows), default=0) or 1.0
    room = width - names - 110
    parts = []
    for i, (name, value) in enumerate(rows):
        y = 34 + 24 * i
        parts.append(svg_text(names, y + 14, name, "end"))
        long = room * value / most
        parts.append(f'<rect x="{names + 6}" y="{y + 2}" width="{long:.1f}" height="16" fill="{COLOURS[0]}"/>')
        parts.append(svg_text(names + 12 + long, y + 14, f"{tick_label(float(f'{value:.3g}'))} {unit}".strip()))
    return svg_document(width, height, title, parts)


#: The longest bar has at least this room beside its name, px.
_LEAST_BAR_PX = 100.0


@dataclass(frozen=True, slots=True)
class Count:
    """How often something happened; address: where the single cases stand, '' for nowhere."""

    name: str
    count: int
    address: str = ""


def pareto(title: str, rows: Sequence[Count], running: str) -> Drawing:
    """Bars from the most frequent on, each with its count and the running sum in per cent; a bar leads to its cases."""
    return Drawing(lambda width: _pareto(title, rows, running, width), 480)


def _pareto(title: str, rows: Sequence[Count], running: str, width: float) -> str:
    ordered = sorted(rows, key=lambda row: -row.count)
    whole = sum(row.count for row in ordered)
    names = 12 + max((width_of(row.name) for row in ordered), default=0.0)
    above = 18 if width - names < _LEAST_BAR_PX + 130 else 0  # names stand above their bars where paper is narrow
    names, tall = (4.0 if above else names), 32 + above
    room, parts, so_far = width - names - 130, [svg_text(width - 12, 42, running, "end")], 0
    for i, row in enumerate(ordered):
        y, so_far = 52 + above + tall * i, so_far + row.count
        long = room * row.count / ordered[0].count
        left, label_y = names + 8, (y - 6 if above else y + 16)
        drawn = (
            f'{svg_text(12, label_y, row.name)}<rect x="{left:.0f}" y="{y}" width="{room:.1f}" height="24" '
            f'fill="#e4e9ed"/><rect x="{left:.0f}" y="{y}" width="{long:.1f}" height="24" fill="#0a5aa8"/>'
        )
        parts.append(f'<a href="{escape(row.address)}">{drawn}</a>' if row.address else drawn)
        parts.append(svg_text(names + 16 + room, y + 16, str(row.count), weight=600))
        parts.append(svg_text(width - 12, y + 16, f"{100 * so_far / whole:.0f} %", "end"))
    return svg_document(width, 64 + tall * len(ordered), title, parts)


def heat_map(
    title: str, values: Sequence[Sequence[float]], rows: Sequence[str], columns: Sequence[str], unit: str = ""
) -> str:
    """Cells coloured from orange (−) over white to blue (+), the scale said in words; NaN stays grey."""
    finite = [abs(v) for row in values for v in row if math.isfinite(v)]
    most = max(finite, default=0.0) or 1.0
    left = 12 + 7 * min(16, max((len(r) for r in rows), default=0))
    cell = max(6.0, min(34.0, 760 / max(len(columns), 1)))
    tall = max(6.0, min(22.0, 480 / max(len(rows), 1)))
    width, height = left + cell * len(columns) + 14, 96 + tall * len(rows)
    parts = [svg_text(12, 36, f"blue +{tick_label(float(f'{most:.2g}'))} {unit}, orange the same below zero", size=11)]
    for i, row in enumerate(values):
        parts += [
            f'<rect x="{left + j * cell:.1f}" y="{44 + i * tall:.1f}" width="{cell:.1f}" height="{tall:.1f}" '
            f'fill="{_cell_colour(v / most)}"/>'
            for j, v in enumerate(row)
        ]
    skip_rows, skip_columns = (max(1, round(12 / size)) for size in (tall, cell))
    parts += [
        svg_text(left - 5, 44 + (i + 0.5) * tall + 4, rows[i][:16], "end", size=11)
        for i in range(0, len(rows), skip_rows)
    ]
    under = 52 + tall * len(rows)
    parts += [
        svg_text(left + (j + 0.5) * cell + 3, under, columns[j][:10], "end", turn=-45, size=10)
        for j in range(0, len(columns), skip_columns)
    ]
    return svg_document(max(width, 420), height, title, parts)


def _cell_colour(share: float) -> str:
    if math.isnan(share):
        return "#ccc"
    full = (0, 114, 178) if share > 0 else (213, 94, 0)
    mix = [round(255 + (c - 255) * min(abs(share), 1.0)) for c in full]
    return "#{:02x}{:02x}{:02x}".format(*mix)
