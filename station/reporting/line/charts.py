"""Figures and tables of the line, for the page and for `station report`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np

from station.domain.cell.effectiveness import Effectiveness
from station.domain.core.types import Floats
from station.domain.line_quality import capability, spc
from station.domain.records.stored_attempt import utc
from station.errors import UsageError
from station.messages import Message
from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import Figure, Series, plot
from station.reporting.drawing.tables import Count, bar_drawing, pareto
from station.reporting.line import process_view
from station.reporting.line.statistics import CYCLE_PARTS, VALUE_NAMES, YIELD_SPLITS, LineStatistics, limits_of
from station.reporting.number_text import format_number
from station.reporting.words import Words


@dataclass(frozen=True, slots=True)
class ChartTable:
    """A titled table of text. words: its cells are words of the station, not names."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: bool = False


@dataclass(frozen=True, slots=True)
class Charts:
    """What is shown, in its order. problem: why a control chart could not be drawn, or ''; headline: the counts."""

    figures: tuple[Drawing, ...]
    tables: tuple[ChartTable, ...]
    problem: str = ""
    headline: str = ""


#: English words → those of the reader's language.
Translate = Callable[[str], str]


def draw(line: LineStatistics, value: str, size: int, words: Words, *, overview: bool = True) -> Charts:
    """All figures. value: what the control chart follows, in subgroups of `size` attempts; overview: with the figures
    of process_view and the Pareto chart, which the page draws by themselves."""

    say = words.term
    control, capability, problem = _control(line, value, size, say)
    figures = [
        _yield(line, say),
        _effectiveness(line, say),
        *(_overview(line, value, words) if overview else ()),
        _cycle(line, say),
        *control,
        *_tilts(line, say),
    ]
    shifts = [_shift_table(line)] if line.shifts else []
    tables = [*(_yields(by, line) for by in YIELD_SPLITS), *shifts, *capability, _tilt_table(line)]
    sentence = words.render(problem) if problem else ""
    return Charts(
        tuple(f for f in figures if f),
        tuple(_translated(table, say) for table in tables),
        sentence,
        _headline(line, value, size, words),
    )


def _headline(line: LineStatistics, value: str, size: int, words: Words) -> str:
    """Units, yields, and the capability of the value where it has limits."""
    days = line.yields["day"]
    units, first = sum(d.units for d in days), sum(d.first_pass for d in days)
    final, passed = sum(d.final for d in days), sum(d.final_pass for d in days)
    if not units or not final:
        return ""
    shares = {"final": f"{100 * passed / final:.1f}", "first": f"{100 * first / units:.1f}"}
    headline = words.render(Message("charts-headline", units=final, **shares))
    groups = _groups(line, value, size)
    lower, upper = limits_of(value, line.recipe.limits) if line.recipe else (None, None)
    if groups is None or (lower is None and upper is None):
        return headline
    try:
        cpk = capability.capability(groups, lower, upper).cpk
    except UsageError:
        return headline
    return f"{headline} · Cpk {format_number(cpk[0], 3)}"


def _translated(table: ChartTable, say: Translate) -> ChartTable:
    """The table in the reader's language; names of stations, recipes and positions are nobody's words to translate."""
    rows = tuple(tuple(say(cell) for cell in row) for row in table.rows) if table.words else table.rows
    title = ": ".join(say(part) for part in table.title.split(": "))
    return ChartTable(title, tuple(say(c) for c in table.columns), rows, table.words)


def _yield(line: LineStatistics, say: Translate) -> Drawing | None:
    days = list(line.yields["day"])[-31:]
    x = [float(i) for i in range(len(days))]
    first = _shares(x, [d.first_pass_yield for d in days], say("first pass"), 0)
    final = _shares(x, [d.final_yield for d in days], say("final"), 1)
    names = tuple(d.group for d in days)
    return (
        plot(Figure(say("Yield by day"), "", say("yield, %"), (first, final), names, ((100.0, ""),))) if days else None
    )


def _effectiveness(line: LineStatistics, say: Translate) -> Drawing | None:
    """Availability, performance and quality of the newest shifts."""
    shifts = list(line.shifts)[-31:]
    x = [float(i) for i in range(len(shifts))]
    series = (
        _shares(x, [s.availability for s in shifts], say("availability"), 0),
        _shares(x, [s.performance if s.ideal_s > 0 else float("nan") for s in shifts], say("performance"), 1),
        _shares(x, [s.quality for s in shifts], say("quality"), 2),
    )
    names = tuple(_shift_name(s) for s in shifts)
    return plot(Figure(say("Effectiveness by shift"), "", "%", series, names, ((100.0, ""),))) if shifts else None


def _shift_name(shift: Effectiveness) -> str:
    """When it began, UTC: day and hour."""
    return utc(round(shift.from_s * 1e9))[:16].replace("T", " ")


def _shift_table(line: LineStatistics) -> ChartTable:
    columns = (
        "shift",
        "availability",
        "performance",
        "quality",
        "OEE",
        "units",
        "held, s",
        "suspended, s",
        "aborted, s",
    )
    rows = tuple(
        (
            _shift_name(s),
            _percent(s.availability),
            _percent(s.performance) if s.ideal_s > 0 else "–",
            _percent(s.quality),
            _percent(s.oee) if s.ideal_s > 0 else "–",
            str(s.units),
            *(format_number(seconds, 4) for seconds in (s.held_s, s.suspended_s, s.aborted_s)),
        )
        for s in list(line.shifts)[-31:]
    )
    return ChartTable("Effectiveness by shift", columns, rows)


def _shares(x: Sequence[float], shares: Sequence[float], name: str, colour: int) -> Series:
    """Percentages; days without any stay out."""
    measured = [(a, 100 * b) for a, b in zip(x, shares, strict=True) if np.isfinite(b)]
    return Series([a for a, _ in measured], [b for _, b in measured], name, "dots", colour=colour)


def _overview(line: LineStatistics, value: str, words: Words) -> tuple[Drawing | None, ...]:
    view = process_view.view_process(
        line, value, process_view.Chosen(), lambda ns: utc(ns)[:16].replace("T", " "), words
    )
    return draw_pareto(line, words), view.chart, view.boxes, view.change


def draw_pareto(
    line: LineStatistics, words: Words, address: Callable[[str], str] = lambda _check: ""
) -> Drawing | None:
    """Reasons by their names in the reader's language; one that it has no name for, by its code. address: where the
    attempts that a check failed stand."""
    names = words.texts
    rows = [Count(names.get(f"check_{check}", check), n, address(check)) for check, n in line.reasons.items()]
    title = words.term("Reasons of attempts that did not pass")
    return pareto(title, rows, words.term("running sum")) if rows else None


def _cycle(line: LineStatistics, say: Translate) -> Drawing | None:
    passed = [m for m in line.attempts if m.outcome == "PASS"]
    rows = [(say(part), fmean(m.parts[part] for m in passed)) for part in CYCLE_PARTS] if passed else []
    return bar_drawing(say("Cycle time of a unit that passes, mean"), rows, "s") if rows else None


def _control(
    line: LineStatistics, value: str, size: int, say: Translate
) -> tuple[list[Drawing], list[ChartTable], Message | None]:
    if value not in VALUE_NAMES:
        raise UsageError("chart-value-unknown", value=value[:40], known=VALUE_NAMES)
    if not 1 <= size <= 25:
        raise UsageError("chart-subgroup-size", size=size)
    measured = _measured(line, value)
    groups = _groups(line, value, size)
    if groups is None:
        return [], [], Message("chart-too-few", value=value, size=size, count=len(measured))
    used = measured[-groups.size :]
    unit = line.recipe.unit if line.recipe and value.split(maxsplit=1)[0] in ("offset", "residual", "noise") else ""
    unit = "s" if value == "cycle time" else unit
    shown = spc.charts(groups)[1:] if size == 1 else spc.charts(groups)  # unit by unit: process_chart
    drawn = [_chart(chart, value, unit, size, say) for chart in shown]
    alarms = [(chart.name, utc(used[i * size][0]), rule) for chart in spc.charts(groups) for i, rule in chart.alarms]
    tables = (
        [ChartTable(f"Out of control: {value}", ("chart", "from", "rule"), tuple(alarms), words=True)] if alarms else []
    )
    indices, problem = _capability(line, value, groups)
    return drawn, [*tables, *indices], problem


def _measured(line: LineStatistics, value: str) -> list[tuple[int, float]]:
    """Time and value of every attempt that was judged by it."""
    return [
        (m.started_ns, m.values[value]) for m in line.attempts if value in m.values and m.outcome in ("PASS", "FAIL")
    ]


def _groups(line: LineStatistics, value: str, size: int) -> Floats | None:
    """The newest values in subgroups (count, size); None where there are fewer than two."""
    values = [v for _, v in _measured(line, value)]
    count = len(values) // size
    return np.array(values[-count * size :]).reshape(count, size) if count >= 2 else None


def _chart(chart: spc.Chart, value: str, unit: str, size: int, say: Translate) -> Drawing:
    x = [float(i + 1) for i in range(len(chart.points))]
    out = sorted({i for i, _ in chart.alarms})
    series = (
        Series(x, chart.points.tolist(), "", "line"),
        Series(x, chart.points.tolist(), "", "dots"),
        Series([x[i] for i in out], [float(chart.points[i]) for i in out], say("out of control"), "dots", colour=1),
    )
    levels = (
        (chart.upper, f"UCL {format_number(chart.upper, 4)}"),
        (chart.centre, ""),
        (chart.lower, f"LCL {format_number(chart.lower, 4)}"),
    )
    named = f"{say(chart.name)} (n = {size})" if size > 1 else say(chart.name)
    title = f"{say(value)}: {named}"
    return plot(Figure(title, say("subgroup"), f"{say(value)} {unit}".strip(), series, levels=levels, zero=False))


def _capability(line: LineStatistics, value: str, groups: Floats) -> tuple[list[ChartTable], Message | None]:
    lower, upper = limits_of(value, line.recipe.limits) if line.recipe else (None, None)
    if lower is None and upper is None:
        return [], None
    try:
        c = capability.capability(groups, lower, upper)
    except UsageError as exc:
        return [], exc.message
    rows = [
        ("limits", f"{format_number(lower)} … {format_number(upper)}"),
        ("n", str(c.n)),
        ("mean", format_number(c.mean)),
    ]
    rows += [("σ within", format_number(c.sigma_within, 4)), ("σ overall", format_number(c.sigma_overall, 4))]
    for name, index in (("Cp", c.cp), ("Cpk", c.cpk), ("Pp", c.pp), ("Ppk", c.ppk)):
        rows.append(
            (name, "–" if index is None else "{} ({} … {}, 95 %)".format(*(format_number(v, 4) for v in index)))
        )
    rows += [("normality, p", format_number(c.normality, 2)), ("ν of σ within", format_number(c.dof_within, 3))]
    if c.percentile is not None:
        rows.append(("Ppk by percentiles", format_number(c.percentile, 4)))
    return [ChartTable(f"Capability: {value}", ("quantity", "value"), tuple(rows), words=True)], None


def _tilts(line: LineStatistics, say: Translate) -> list[Drawing]:
    """One figure: the tilt found at each position, attempt by attempt; a fixture that wears shows here."""
    names = sorted({name for m in line.attempts for name in m.tilts})
    if len(line.attempts) < 2 or not names:
        return []
    shown = names[:: max(1, -(-len(names) // 6))]
    series = [_tilt_of(line, name, i) for i, name in enumerate(shown)]
    return [plot(Figure(say("Tilt of each position over time"), say("attempt"), say("tilt, degrees"), tuple(series)))]


def _tilt_of(line: LineStatistics, name: str, colour: int) -> Series:
    points = [(float(i + 1), m.tilts[name]) for i, m in enumerate(line.attempts) if name in m.tilts]
    return Series([x for x, _ in points], [y for _, y in points], name, "line", colour=colour)


def _yields(by: str, line: LineStatistics) -> ChartTable:
    columns = (by, "units", "first pass", "first-pass yield", "final yield", "FAIL", "ERROR", "mean time, s")
    rows = tuple(
        (
            y.group,
            str(y.units),
            str(y.first_pass),
            _percent(y.first_pass_yield),
            _percent(y.final_yield),
            str(y.failed),
            str(y.errors),
            format_number(y.mean_duration_s, 4),
        )
        for y in line.yields[by][-31:]
    )
    return ChartTable(f"Yield by {by}", columns, rows)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "–"


def _tilt_table(line: LineStatistics) -> ChartTable:
    """Mean tilt of every position, and how it moved from the first half of the attempts to the second."""
    rows = []
    names: Sequence[str] = sorted({name for m in line.attempts for name in m.tilts})
    for name in names:
        found = [m.tilts[name] for m in line.attempts if name in m.tilts]
        half = len(found) // 2
        moved = fmean(found[half:]) - fmean(found[:half]) if half else 0.0
        rows.append(
            (
                name,
                str(len(found)),
                format_number(fmean(found), 4),
                format_number(max(found), 4),
                format_number(moved, 3),
            )
        )
    return ChartTable(
        "Tilt of each position, degrees", ("position", "n", "mean", "largest", "second half − first"), tuple(rows)
    )


def document(line: LineStatistics, charts: Charts) -> Mapping[str, object]:
    """The same as JSON: schema station.report/1."""
    tables = [{"title": t.title, "columns": list(t.columns), "rows": [list(r) for r in t.rows]} for t in charts.tables]
    return {
        "schema": "station.report/1",
        "attempts": len(line.attempts),
        "simulated": line.simulated,
        "tables": tables,
        "reasons": dict(line.reasons),
        "problem": charts.problem,
    }
