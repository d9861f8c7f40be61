"""Tables of a report, and the bars that say the same at a glance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from station.reporting.diagnosis.cause_text import cause_text, makes_testable, unit_of
from station.reporting.diagnosis.data import ReportData
from station.reporting.diagnosis.finding_text import main_parameters
from station.reporting.diagnosis.quantity_format import (
    display_unit,
    format_aligned,
    format_interval,
    format_significant,
    format_size,
)
from station.reporting.diagnosis.sentences import report_text
from station.reporting.drawing import tables as drawing
from station.reporting.drawing.figure import Figure, Series, svg

#: Pairs of axes.
_PAIRS = ((0, 1), (0, 2), (1, 2))
#: Rows that a table or a bar chart of units shows, the largest first.
MAX_ROWS = 30
#: So much of the largest entry of a matrix is what computing it leaves: the entry is 0.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class ReportTable:
    """head, rows of text, and a caption that also says what was left out; a folded one opens on a click."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    folded: bool = False


def parameters(cause: Mapping[str, Any]) -> ReportTable:
    """Sizes with their 95 % intervals."""
    rows: Sequence[Mapping[str, Any]] = cause["parameters"]
    shown = sorted(rows, key=_largest)[:MAX_ROWS] if len(rows) > MAX_ROWS else rows
    omitted = f"; the {MAX_ROWS} largest of {len(rows)}, the JSON document has all" if len(rows) > MAX_ROWS else ""
    body = tuple((str(r["of"]), str(r["name"]), str(r["axis"] or "–"), _value(r)) for r in shown)
    return ReportTable(
        report_text("table-parameters", effect=cause["effect"]) + omitted, ("of", "name", "axis", "value"), body
    )


def _largest(row: Mapping[str, Any]) -> float:
    return 0.0 if isinstance(row["value"], str) else -abs(float(row["value"]))


def _value(row: Mapping[str, Any]) -> str:
    if isinstance(row["value"], str):
        return row["value"]
    return format_interval(float(row["value"]), float(row["std"] or 0.0), str(row["unit"]))


def intervals_chart(cause: Mapping[str, Any]) -> str | None:
    """The coefficients with their intervals as dots and bars; None where they are text or only one."""
    rows = [r for r in main_parameters(cause) if not isinstance(r["value"], str)] if cause["parameters"] else []
    if len(rows) < 2:
        return None
    rows = sorted(rows, key=_largest)[:MAX_ROWS]
    factor, unit = display_unit([r["value"] for r in rows], str(rows[0]["unit"]))
    names = tuple(" ".join(filter(None, (str(r["of"]).split(":", 1)[-1], r["axis"]))) for r in rows)
    y = [float(r["value"]) * factor for r in rows]
    wide = [1.96 * float(r["std"] or 0.0) * factor for r in rows]
    low, high = ([a + s * b for a, b in zip(y, wide, strict=True)] for s in (-1, 1))
    series = Series(list(map(float, range(len(y)))), y, low=low, high=high)
    name = str(rows[0]["name"]).replace("_", " ")
    title = report_text("figure-intervals", effect=cause["effect"], name=name)
    return svg(Figure(title, "", f"{name}, {unit}" if unit else name, (series,), names, width=760, height=320))


def before_after_chart(data: ReportData) -> str | None:
    """Rms on held-out data before and after each cause, and the noise floor; None where no gain is one of means."""
    gains = [(c["effect"], c["gain"]) for c in data.causes if c["gain"]["rms_after"] is not None]
    if not gains:
        return None
    floor = float(data.document["baseline"]["floor_rms"])
    factor, unit = display_unit([g["rms_before"] for _, g in gains], data.unit_of_readings)
    rows = []
    for name, gain in gains:
        rows.append((report_text("bar-without", effect=name), gain["rms_before"]))
        rows.append((report_text("bar-with", effect=name), gain["rms_after"]))
    rows.append((report_text("bar-floor"), floor))
    bars = [(name, float(f"{value * factor:.3g}")) for name, value in rows]
    return drawing.bar_chart(report_text("figure-before-after"), bars, unit, width=760)


def gain_sentence(cause: Mapping[str, Any], unit: str) -> str:
    """The gain of a cause in words."""
    g, parts = cause["gain"], []
    held_out = report_text("held-out", what=str(g["held_out_by"]))
    if g["rms_before"] is not None and g["rms_after"] is not None:
        factor, words = display_unit([g["rms_before"], g["rms_after"]], unit)
        before, after = (format_significant(g[key] * factor) for key in ("rms_before", "rms_after"))
        parts.append(report_text("gain-rms", held_out=held_out, before=before, after=after, unit=words))
    if g["explained"] is not None:
        parts.append(report_text("gain-explained", percent=round(100 * g["explained"])))
    if g["log_score"] is not None and g["std_error"] is not None:
        score, error = format_significant(g["log_score"]), format_significant(g["std_error"])
        parts.append(report_text("gain-score", held_out=held_out, score=score, error=error))
    parts.append(report_text("gain-accepted" if g["accepted"] else "gain-refused"))
    return f"{cause['effect']}: {' '.join(parts)}"


def shifts(data: ReportData) -> ReportTable | None:
    """What the causes do to each unit's calibration, and to its verdict."""
    if data.line is None:
        return None
    units = sorted(data.line["units"], key=lambda u: -u["moves"])
    shown, word = units[:MAX_ROWS], data.line["unit"]
    entries = [x for u in shown for row in u["matrix"] for x in row]
    matrix, part = display_unit(entries, "1")
    rounding = _ROUNDING * max(map(abs, entries))

    def entry(unit: Mapping[str, Any], i: int, j: int) -> float:
        value = float(unit["matrix"][i][j])
        return value * matrix if abs(value) > rounding else 0.0

    judged = data.judged is not None
    rows = tuple(
        (
            u["serial"],
            *format_aligned([u["moves"], *u["offset"]]),
            *format_aligned([entry(u, i, i) for i in range(3)]),
            *format_aligned([max(abs(entry(u, i, j)), abs(entry(u, j, i))) for i, j in _PAIRS]),
            *((f"{u['before']} → {u['after']}" if u["before"] != u["after"] else u["before"],) if judged else ()),
        )
        for u in shown
    )
    omitted = f"; the {MAX_ROWS} largest of {len(units)}" if len(units) > MAX_ROWS else ""
    coefficients = [f"offset {a}, {word}" for a in "xyz"] + [f"gain {a}, {part}" for a in "xyz"]
    coefficients += [f"cross {'xyz'[i]}{'xyz'[j]}, {part}" for i, j in _PAIRS]
    head = ("unit", f"a reading, {word}", *coefficients, *(("verdict",) if judged else ()))
    return ReportTable(report_text("table-shifts") + omitted, head, rows)


def shifts_chart(data: ReportData) -> str | None:
    """By how much the causes move a calibrated reading of each unit, as bars."""
    units = sorted(data.line["units"], key=lambda u: -u["moves"])[:12] if data.line else []
    if data.line is None or not units or units[0]["moves"] <= 0:
        return None
    factor, word = display_unit([units[0]["moves"] / 1e3], data.unit_of_readings)
    title = report_text("figure-shifts")
    title += ", the 12 largest" if len(data.line["units"]) > 12 else ""
    return drawing.bar_chart(title, [(u["serial"][:24], u["moves"] / 1e3 * factor) for u in units], word, width=760)


def evidence_chart(rows: Sequence[Mapping[str, Any]]) -> str | None:
    """Evidence of the likeliest causes; None where nothing speaks for any."""
    top = [(str(r["effect"]), max(0.0, float(r["log_evidence"]))) for r in rows[:12]]
    if not any(value for _, value in top):
        return None
    return drawing.bar_chart(report_text("figure-evidence"), top, "nats", width=760)


def ranking(data: ReportData) -> ReportTable:
    """Every cause looked at."""
    rows = tuple(
        (
            str(r["effect"]),
            format_significant(r["log_evidence"]),
            percent(r["probability"]),
            cause_text(r["effect"]).physics,
        )
        for r in data.document["considered"]
    )
    return ReportTable(report_text("table-ranking"),
                 ("cause", "evidence, nats", "probability", "what it is"), rows, folded=True)  # fmt: skip


def percent(p: float) -> str:
    if p < 0.001:
        return "< 0.1 %"
    return "> 99.9 %" if p > 0.999 else f"{100 * p:.1f} %"


def means(data: ReportData) -> ReportTable | None:
    """Measured, simulated and extended mean of each position."""
    n = len(data.position.names)
    count = np.maximum(np.bincount(data.position.code, minlength=n), 1)

    def of(values: Any) -> Any:
        return np.stack([np.bincount(data.position.code, column, n) for column in values.T], 1) / count[:, None]

    sides = {"measured": data.measured, "simulated": data.measured - data.before}
    if data.causes:
        sides["extended"] = data.measured - data.after
    found = {name: of(values) for name, values in sides.items()}
    shown = [(i, name) for i in range(len(data.axes)) for name in sides]
    head = ("position", *(f"{name} {data.axes[i]}" for i, name in shown))
    rows = tuple((data.position.names[p], *(_reading(found[name][p, i]) for i, name in shown)) for p in range(n))
    return ReportTable(report_text("table-means", unit=data.unit_of_readings), head, rows)


def _reading(value: float) -> str:
    return f"{value:+.5f}".replace("-", "−")


def not_testable(data: ReportData) -> ReportTable | None:
    """Causes that these data cannot show, and what would change that."""
    rows = tuple(
        (str(e), cause_text(e).physics, makes_testable(e, data.recorded)) for e in data.document["not_testable"]
    )
    return (
        ReportTable(report_text("table-not-testable"), ("cause", "what it is", "what would show it"), rows)
        if rows
        else None
    )


def smallest(data: ReportData) -> ReportTable | None:
    """How small an effect of each kind would have been seen."""
    unit = data.unit_of_readings
    rows = tuple(
        (effect, format_size(rms, unit_of(effect, unit), 2), cause_text(effect).physics)
        for effect, rms in sorted(data.smallest.items())
    )
    if not rows:
        return None
    head = ("cause", "detected from", "what it is")
    return ReportTable(report_text("table-smallest"), head, rows, folded=bool(data.causes))
