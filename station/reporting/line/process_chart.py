"""The chart of one value, unit by unit: specification solid, control limits dashed, target dotted. Marks tell by shape
and by text what is wrong with a unit, never by colour alone."""

from collections.abc import Callable
from html import escape
from itertools import groupby

from station.messages import Message
from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import mark, svg_document, svg_text
from station.reporting.drawing.levels import draw_levels, grid, names_width
from station.reporting.drawing.scale import Scale, axis_range, text_width
from station.reporting.line.value_series import OTHER_RULE, RULE_SHAPES, Control, ValueSeries
from station.reporting.number_text import format_number
from station.reporting.words import Words

_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM = 980.0, 400.0, 74.0, 66.0, 52.0
_BLUE, _RED, _AMBER, _INK = "#0a5aa8", "#ae131f", "#ffb938", "#14212c"
#: As many instants stand under the axis at most, and each takes so much room, px.
_INSTANTS, _INSTANT_PX = 6, 100.0


def draw_process(
    process: ValueSeries, chosen: tuple[int, int] | None, change_at: int, when: Callable[[int], str], words: Words
) -> Drawing:
    """chosen: first and last chosen unit, from 1, None for no choice; change_at: the first unit after a change;
    when: an instant, ns, as the reader's clock shows it."""
    return Drawing(lambda width: _svg(process, chosen, change_at, when, words, width), _WIDTH)


def _svg(
    process: ValueSeries,
    chosen: tuple[int, int] | None,
    change_at: int,
    when: Callable[[int], str],
    words: Words,
    width: float,
) -> str:
    control, count = Control.of(process), len(process.values)
    levels = [*process.specification(words), *(control.levels(words) if control else ())]
    x = Scale(0.5, count + 0.5, min(_LEFT, 0.14 * width), width - names_width(levels))
    rules = control.rules if control else {}
    legend = _legend(process, rules, words, width)
    y = Scale(
        *axis_range([*process.values, *(level.y for level in levels)]), _HEIGHT - _BOTTOM, _TOP + 20 * (len(legend) - 1)
    )
    parts = [
        *_picked(chosen, x, y),
        *grid(x, y),
        *draw_levels(levels, x, y),
        f'<path d="M{x(change_at - 0.5):.1f} {y.end:.1f}V{y.start:.1f}" stroke="{_INK}" stroke-dasharray="2 3"/>',
        *_points(process, rules, x, y, words),
        *_texts(process, rules, x, y, words),
        *_instants(process, x, y, when),
        *(part for row in legend for part in row),
    ]
    title = words.render(Message("chart-units-in-order", value=words.term(process.name), count=count))
    return svg_document(width, _HEIGHT, title, parts)


def _picked(chosen: tuple[int, int] | None, x: Scale, y: Scale) -> list[str]:
    """The zone of the chosen units, which a drag across the plot moves."""
    left, right = (x(chosen[0] - 0.5), x(chosen[1] + 0.5)) if chosen else (x.start, x.start)
    down = y.start - y.end
    whole = f'x="{x.start:.1f}" y="{y.end:.1f}" width="{x.end - x.start:.1f}" height="{down:.1f}"'
    return [
        f'<rect class="picked" x="{left:.1f}" y="{y.end:.1f}" width="{right - left:.1f}" height="{down:.1f}" '
        'fill="#e3eef9"/>',
        f'<rect class="brush" {whole} fill="#fff" fill-opacity="0"/>',
    ]


def _points(process: ValueSeries, rules: dict[int, str], x: Scale, y: Scale, words: Words) -> list[str]:
    path = " ".join(f"{x(i + 1):.1f},{y(v):.1f}" for i, v in enumerate(process.values))
    parts = [f'<polyline points="{path}" fill="none" stroke="{_BLUE}" stroke-opacity="0.5"/>']
    for i, v in enumerate(process.values):
        label = f"{process.attempts[i].serial}: {format_number(v, 5)}"
        if not process.inside(v):
            drawn, label = mark("diamond", x(i + 1), y(v), _RED, 1.9), f"{label}, {words.term('outside the limits')}"
        elif i in rules:
            drawn = mark(RULE_SHAPES.get(rules[i], OTHER_RULE), x(i + 1), y(v), _AMBER, 1.5)
            label = f"{label}, {words.term(rules[i])}"
        else:
            drawn = mark("circle", x(i + 1), y(v), _BLUE, 1.3)
        parts.append(f"<g>{drawn}<title>{escape(label)}</title></g>")
    return parts


def _texts(process: ValueSeries, rules: dict[int, str], x: Scale, y: Scale, words: Words) -> list[str]:
    """The name of each rule above the first of the units in a row that break it; the serial of what is outside."""
    parts = []
    rows = [(i, rules.get(i, "") if process.inside(v) else "outside") for i, v in enumerate(process.values)]
    end = -1e9
    for what, group in groupby(rows, key=lambda row: row[1]):
        i = next(group)[0]
        if not what:
            continue
        text = process.attempts[i].serial if what == "outside" else words.term(what)
        wide, at = text_width(text) / 2, min(max(x(i + 1), x.start + 60), x.end - 60)
        if at - wide < end + 6:
            continue  # its shape tells it
        end = at + wide
        above = y(process.values[i]) - 14 if y(process.values[i]) - 24 > y.end else y(process.values[i]) + 24
        colour = _RED if what == "outside" else "#7d4600"
        parts.append(f'<g fill="{colour}">{svg_text(at, above, text, "middle", weight=600)}</g>')
    return parts


def _instants(process: ValueSeries, x: Scale, y: Scale, when: Callable[[int], str]) -> list[str]:
    count = len(process.values)
    most = min(_INSTANTS, max(2, int((x.end - x.start) / _INSTANT_PX)))
    shown = sorted({round(i * (count - 1) / (most - 1)) for i in range(most)})
    parts = []
    for i in shown:
        parts.append(svg_text(x(i + 1), y.start + 18, str(i + 1), "middle"))
        parts.append(
            svg_text(max(x(i + 1), _INSTANT_PX / 2), y.start + 36, when(process.attempts[i].started_ns), "middle")
        )
    return parts


def _legend(process: ValueSeries, rules: dict[int, str], words: Words, width: float) -> list[list[str]]:
    """Rows of as many entries as there is room for."""
    entries = [("circle", _BLUE, "in control")]
    entries += [(RULE_SHAPES.get(rule, OTHER_RULE), _AMBER, rule) for rule in dict.fromkeys(rules.values())]
    if not all(map(process.inside, process.values)):
        entries.append(("diamond", _RED, "outside the limits"))
    rows: list[list[str]] = []
    at = width
    for shape, colour, name in entries:
        text = words.term(name)
        if at + 11 + text_width(text) > width:
            rows.append([])
            at = 20.0
        down = 42 + 20 * (len(rows) - 1)
        rows[-1] += [mark(shape, at, down, colour, 1.4), svg_text(at + 11, down + 4, text)]
        at += text_width(text) + 34
    return rows
