"""The section of a report with a proposed formula: typeset, drawn over its covariate, with what else would fit."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from station.domain.core.types import Array, Floats
from station.reporting.diagnosis.data import FormulaCurve, ReportData
from station.reporting.diagnosis.point_groups import group_points
from station.reporting.diagnosis.quantity_format import display_unit, format_aligned, format_significant, unit_words
from station.reporting.diagnosis.sentences import report_text
from station.reporting.diagnosis.tables import ReportTable
from station.reporting.drawing.figure import Figure, Series, svg

#: Groups of visits along the covariate, and points of a drawn curve.
GROUPS = 8
#: What differs by less than this share of the largest is one level; of so few levels the lowest, the middle and the
#: highest are drawn, of more a third of the visits each.
SAME_LEVEL, FEW_LEVELS = 1e-3, 9


def formula_sentences(data: ReportData) -> tuple[str, ...]:
    """What was proposed, how sure, and what else would fit; that nothing was found."""
    found = data.document["unknown"].get("hypotheses")
    if found is None:
        return ()
    if not found:
        return (report_text("report-formula-none"),)
    (h,) = found
    gain, unit = h["gain"], data.unit_of_readings
    factor, words = display_unit([gain["rms_before"]], unit)
    before, after = (format_significant(gain[key] * factor) for key in ("rms_before", "rms_after"))
    text = [report_text("report-formula-whole" if h["complete"] else "report-formula-part")]
    falls = gain["rms_after"] < gain["rms_before"]
    said = "report-formula-gain" if falls else "report-formula-gain-without-fall"
    text.append(report_text(said, before=before, after=after, unit=words))
    if h["equivalent"]:
        text.append(report_text("report-formula-tied", formulas=tuple(h["equivalent"])))
    return tuple(text)


def formula_table(data: ReportData) -> ReportTable | None:
    """Parameters with their 95 % intervals."""
    found = data.document["unknown"].get("hypotheses")
    if not found:
        return None
    rows = []
    for p in found[0]["parameters"]:
        value, wide = format_aligned([p["value"], 1.96 * (p["std"] or 0)])
        rows.append((p["of"], p["axis"] or "", p["name"], value, wide, unit_words(p["unit"])))
    head = (
        report_text("report-formula-of"),
        report_text("report-formula-axis"),
        report_text("report-formula-parameter"),
        report_text("report-formula-value"),
        report_text("report-formula-interval"),
        report_text("report-formula-unit"),
    )
    return ReportTable(report_text("report-formula-parameters"), head, tuple(rows), folded=len(rows) > 12)


def draw_curve(curve: FormulaCurve, unit: str) -> str:
    """Measured means with 95 % bars and the formula's curve, at three levels of what the axis feels."""
    factor, words = display_unit([float(np.abs(curve.measured).max())], unit)
    series: list[Series] = []
    for level, (name, rows) in enumerate(_levels(curve)):
        x, y, wide, line = _grouped(curve, rows)
        drawn = np.stack([x, line])
        if curve.course is not None:
            # The visits as they would be at the level of the curve: by the formula, with what it leaves.
            drawn = curve.course * [[1.0], [float(np.median(curve.level[rows]))]]
            y += np.interp(x, *drawn) - line
        series.append(Series(drawn[0].tolist(), (drawn[1] * factor).tolist(), name, kind="line", colour=level))
        low, high = ((y + s * wide) * factor for s in (-1, 1))
        series.append(Series(x.tolist(), (y * factor).tolist(), "", low=low.tolist(), high=high.tolist(), colour=level))
    title = report_text("report-formula-figure", axis=curve.axis)
    if curve.group:
        title = report_text("report-formula-figure-of", axis=curve.axis, group=curve.group)
    return svg(Figure(title, curve.label, words, tuple(series), width=760, height=360))


def _levels(curve: FormulaCurve) -> Iterator[tuple[str, Array]]:
    """Visits of a low, a middle and a high level of what the axis feels, or all where it is the same everywhere."""
    step = SAME_LEVEL * max(float(np.abs(curve.level).max()), 1e-300)
    s = np.round(curve.level / step) * step
    levels, code = np.unique(s, return_inverse=True)
    if len(levels) == 1:
        yield report_text("report-formula-all"), np.ones(len(s), bool)
        return
    if len(levels) <= FEW_LEVELS:
        parts = [code == k for k in sorted({0, len(levels) // 2, len(levels) - 1})]
    else:
        # A level that a third of the visits have leaves no third beside it: then a third of the levels.
        split = [_thirds(s, np.quantile(of, (1 / 3, 2 / 3))) for of in (s, levels)]
        parts = next((some for some in split if all(rows.any() for rows in some)), split[-1])
    for rows in (rows for rows in parts if rows.any()):
        value = format_significant(float(np.median(s[rows])))
        yield report_text("report-formula-level", what=curve.what, value=value), rows


def _thirds(s: Floats, ends: Array) -> list[Array]:
    """Visits below, between and above two levels."""
    return [s < ends[0], (s >= ends[0]) & (s <= ends[1]), s > ends[1]]


def _grouped(curve: FormulaCurve, rows: Array) -> tuple[Floats, Floats, Floats, Floats]:
    """Covariate, mean measured, 1.96 standard errors and the formula's mean of each group along the covariate."""
    at, measured, formula = (v[rows] for v in (curve.at, curve.measured, curve.formula))
    groups = group_points(at, min(GROUPS, max(1, len(at) // 4)), even=True)
    wide = 1.96 * groups.scatter(measured - formula) / np.sqrt(groups.size)
    return groups.mean(at), groups.mean(measured), wide, groups.mean(formula)


def formula_math(document: Mapping[str, Any]) -> tuple[str, ...]:
    """The formulas as MathML, of each term."""
    found = document["unknown"].get("hypotheses") or ()
    return tuple(t["mathml"] for h in found for t in h["terms"])
