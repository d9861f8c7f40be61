"""The report as a value: what stands on the page, in order. `build_page` makes it; a template only lays it out."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from station.reporting.diagnosis import hypothesis_section, lead_figure, partial_residual, plots, tables
from station.reporting.diagnosis.cause_text import cause_text, drawn_over
from station.reporting.diagnosis.data import ReportData
from station.reporting.diagnosis.finding_text import (
    BADGES,
    describe_dependence,
    first_screen,
    next_run_sentence,
    upper_first,
)
from station.reporting.diagnosis.plot_axis import plot_axis
from station.reporting.diagnosis.quantity_format import format_significant, format_size
from station.reporting.diagnosis.sentences import report_text
from station.reporting.diagnosis.tables import ReportTable


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure (SVG text) with its name, which is also its file's, and one sentence that says how to read it."""

    name: str
    svg: str
    caption: str = ""


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A heading, sentences, formulas (MathML), pictures and tables; folded ones open on a click."""

    name: str
    title: str
    text: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    folded: bool = False
    math: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ReportPage:
    """The whole report. cards: (what, figure) pairs of the first screen."""

    title: str
    verdict: str
    symbol: str
    badge: str
    sentence: str
    do: str
    cards: tuple[tuple[str, str], ...]
    lead: Picture | None
    sections: tuple[ReportSection, ...]

    def pictures(self) -> dict[str, str]:
        """Every figure by name, SVG."""
        found = [*([self.lead] if self.lead else []), *(p for s in self.sections for p in s.pictures)]
        return {p.name: p.svg for p in found}


def build_page(data: ReportData) -> ReportPage:
    """The page of a report."""
    verdict = str(data.document["verdict"])
    symbol, badge = BADGES[verdict]
    first = first_screen(data)
    drawn = lead_figure.draw(data)
    return ReportPage(
        title=report_text("page-title", recipe=data.recipe),
        verdict=verdict,
        symbol=symbol,
        badge=report_text(badge),
        sentence=first.sentence,
        do=first.do,
        cards=tuple(_cards(data)),
        lead=Picture("first", *drawn) if drawn else None,
        sections=tuple(s for s in _sections(data) if s.text or s.pictures or s.tables),
    )


def _cards(data: ReportData) -> Iterator[tuple[str, str]]:
    d, unit = data.document, data.unit_of_readings
    counts, alarm = d["data"], d["alarm"]
    yield (
        report_text("card-data"),
        report_text("card-counts", units=counts["units"], runs=counts["runs"], visits=counts["visits"]),
    )
    yield report_text("card-residual"), f"{format_size(d['baseline']['residual_rms'], unit)} rms"
    yield report_text("card-noise"), f"{format_size(data.noise_rms, unit)} rms"
    statistic, threshold = (format_significant(alarm[key]) for key in ("statistic", "threshold"))
    yield report_text("card-alarm"), report_text("card-threshold", statistic=statistic, threshold=threshold)
    if data.causes:
        yield report_text("card-probability"), tables.percent(data.causes[0]["probability"])
    if (v := data.judged) is not None:
        yield (
            report_text("card-yield"),
            report_text("card-passed", before=v["passed_before"], after=v["passed_after"], units=len(v["units"])),
        )


def _sections(data: ReportData) -> Iterator[ReportSection]:
    yield _formula_section(data)
    yield _indistinguishable_section(data)
    next_run = next_run_sentence(data)
    yield ReportSection("next-run", report_text("section-next-run"), (next_run,) if next_run else ())
    for i, cause in enumerate(data.causes):
        yield _cause(data, cause, i)
    yield _gain(data)
    yield _ranking(data)
    yield _residuals(data)
    yield _means_section(data)
    yield _limits_section(data)


def _formula_section(data: ReportData) -> ReportSection:
    """The formula proposed for what no cause explains."""
    drawn = [hypothesis_section.draw_curve(c, data.unit_of_readings) for c in data.curves]
    caption = report_text("report-formula-caption")
    pictures = tuple(Picture(f"formula-{i + 1}", svg, caption) for i, svg in enumerate(drawn))
    table = hypothesis_section.formula_table(data)
    return ReportSection(
        "formula",
        report_text("report-formula-title"),
        hypothesis_section.formula_sentences(data),
        pictures,
        (table,) if table else (),
        math=hypothesis_section.formula_math(data.document),
    )


def _indistinguishable_section(data: ReportData) -> ReportSection:
    """Which causes these data cannot separate, and why."""
    text = []
    for cause in data.causes:
        others = cause["indistinguishable_from"]
        if others:
            share = tables.percent(cause["probability"])
            text.append(report_text("section-tied", effect=cause["effect"], others=others, probability=share))
            text += [f"{name}: {cause_text(name).physics}." for name in (cause["effect"], *others)]
    if data.document["verdict"] in ("incomplete", "unknown"):
        text.append(report_text("section-rest", what=describe_dependence(data)))
    return ReportSection("not-told-apart", report_text("section-limits"), tuple(text))


def _cause(data: ReportData, cause: Mapping[str, Any], i: int) -> ReportSection:
    """One cause: its signature on top of the residual, and its parameters."""
    name = cause["effect"]
    words = cause_text(name)
    remedy = (report_text("section-remedy", remedy=upper_first(words.do)),) if words.do else ()
    signature, over, pictures = data.signature(name), drawn_over(name), []
    if signature is not None and over is not None:
        svg = partial_residual.draw_all(data, cause, over, signature)
        if svg is not None:
            pictures.append(Picture(f"signature-{i + 1}-{name}", svg, report_text("caption-cause")))
    forest = tables.intervals_chart(cause)
    if forest:
        pictures.append(Picture(f"parameters-{i + 1}-{name}", forest, report_text("caption-intervals")))
    title = report_text("section-cause", number=i + 1, effect=name)
    return ReportSection(
        f"cause-{i + 1}", title, (f"{words.physics}.", *remedy), tuple(pictures), (tables.parameters(cause),)
    )


def _gain(data: ReportData) -> ReportSection:
    """Before and after on data that were not fitted, and what that is for the line."""
    if not data.causes:
        return ReportSection("gain", "")
    bars = tables.before_after_chart(data)
    found = [Picture("before-after", bars, report_text("caption-before-after"))] if bars else []
    text = [tables.gain_sentence(cause, data.unit_of_readings) for cause in data.causes]
    if (v := data.judged) is not None:
        passed = {"before": v["passed_before"], "after": v["passed_after"], "units": len(v["units"])}
        text.append(report_text("gain-line", changed=v["verdicts_changed"], **passed))
    moved = tables.shifts_chart(data)
    if moved:
        found.append(Picture("calibration-shift", moved, report_text("caption-shift")))
    shifts = tables.shifts(data)
    return ReportSection("gain", report_text("section-gain"), tuple(text), tuple(found), (shifts,) if shifts else ())


def _ranking(data: ReportData) -> ReportSection:
    rows = data.document["considered"]
    if not rows:
        return ReportSection("ranking", "")
    bars = tables.evidence_chart(rows)
    pictures = (Picture("ranking", bars, report_text("caption-ranking")),) if bars else ()
    text = (report_text("ranking-text"),)
    return ReportSection("ranking", report_text("section-ranking"), text, pictures, (tables.ranking(data),))


def _residuals(data: ReportData) -> ReportSection:
    """The residual over everything that was recorded."""
    titles = {
        "position": report_text("residual-position"),
        "order": report_text("residual-order"),
        "time_s": report_text("residual-time"),
        "temperature_degC": report_text("residual-temperature"),
        "previous": report_text("residual-previous"),
    }
    found = [(name, plots.residual(data, name, title)) for name, title in titles.items()]
    pictures = [Picture(f"residual-{name.split('_')[0]}", svg) for name, svg in found if svg]
    for i, word in enumerate(data.axes):
        svg = plots.heat(data, data.before, report_text("residual-map"), i)
        if svg:
            pictures.append(Picture(f"heat-map-{word.replace(' ', '-')}", svg))
    missing = [titles[name] for name, svg in found if not svg and plot_axis(data, name) is None]
    text = [report_text("residual-text")]
    if missing:
        text.append(report_text("residual-missing", names=missing))
    return ReportSection("residuals", report_text("section-residual"), tuple(text), tuple(pictures))


def _means_section(data: ReportData) -> ReportSection:
    svg = plots.means(data)
    pictures = (Picture("means", svg, report_text("caption-means")),) if svg else ()
    table = tables.means(data)
    title = report_text("section-means-extended" if data.causes else "section-means")
    return ReportSection("means", title, (), pictures, (table,) if table else (), folded=True)


def _limits_section(data: ReportData) -> ReportSection:
    """How small an effect would have been seen, and what could not be tested."""
    found: Sequence[ReportTable] = [t for t in (tables.not_testable(data), tables.smallest(data)) if t is not None]
    return ReportSection("limits", report_text("section-checked"), (), (), tuple(found))
