"""The report as a value: what stands on the page, in order. `page_of` makes it; a template only lays it out."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from station.reporting.diagnosis import lead_figure, partial_residual, plots, tables
from station.reporting.diagnosis.cause_text import cause_text, drawn_over
from station.reporting.diagnosis.data import ReportData
from station.reporting.diagnosis.finding_text import (
    BADGES,
    count_noun,
    describe_dependence,
    first_screen,
    next_run_sentence,
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
    """A heading, sentences, pictures and tables; folded ones open on a click."""

    name: str
    title: str
    text: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    folded: bool = False


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
        title=f"What the simulation gets wrong: {data.recipe}",
        verdict=verdict,
        symbol=symbol,
        badge=badge,
        sentence=first.sentence,
        do=first.do,
        cards=tuple(_cards(data)),
        lead=Picture("first", *drawn) if drawn else None,
        sections=tuple(s for s in _sections(data) if s.text or s.pictures or s.tables),
    )


#: What the document counts, and its name here.
_COUNTED = (("unit", "unit"), ("run", "run"), ("visit", "stop"))


def _cards(data: ReportData) -> Iterator[tuple[str, str]]:
    d, unit = data.document, data.unit_of_readings
    counts = d["data"]
    yield "looked at", ", ".join(count_noun(counts[f"{counted}s"], name) for counted, name in _COUNTED)
    yield "the simulation leaves", f"{format_size(d['baseline']['residual_rms'], unit)} rms"
    yield "noise alone makes", f"{format_size(data.noise_rms, unit)} rms"
    alarm = d["alarm"]
    yield "alarm", f"{format_significant(alarm['statistic'])} (threshold {format_significant(alarm['threshold'])})"
    if data.causes:
        yield "probability", tables.percent(data.causes[0]["probability"])
    if (v := data.judged) is not None:
        yield "yield as measured → without it", f"{v['passed_before']} → {v['passed_after']} of {len(v['units'])} units"


def _sections(data: ReportData) -> Iterator[ReportSection]:
    yield _indistinguishable_section(data)
    yield ReportSection("next-run", "The next run", (next_run_sentence(data),) if next_run_sentence(data) else ())
    for i, cause in enumerate(data.causes):
        yield _cause(data, cause, i)
    yield _gain(data)
    yield _ranking(data)
    yield _residuals(data)
    yield _means_section(data)
    yield _limits_section(data)


def _indistinguishable_section(data: ReportData) -> ReportSection:
    """What cannot be told apart, and why."""
    text = []
    for cause in data.causes:
        others = cause["indistinguishable_from"]
        if others:
            them, share = ", ".join(others), tables.percent(cause["probability"])
            text.append(
                f"These data cannot tell {cause['effect']} from {them}: what one of them does to these stops, another "
                f"can imitate to within the noise (d·√κ < 3.3, so less than 95 % of such decisions would be right). "
                f"Together they have probability {share}; taken alone none of them is certain."
            )
            text += [f"{name}: {cause_text(name).physics}." for name in (cause["effect"], *others)]
    if data.document["verdict"] in ("incomplete", "unknown"):
        text.append(f"What is left depends on {describe_dependence(data)}; no cause of the library explains it.")
    return ReportSection("not-told-apart", "What these data cannot tell", tuple(text))


def _cause(data: ReportData, cause: Mapping[str, Any], i: int) -> ReportSection:
    """One cause: its signature on top of the residual, and its parameters."""
    name = cause["effect"]
    words = cause_text(name)
    text = (f"{words.physics}.", f"What to do: {words.do}.") if words.do else (f"{words.physics}.",)
    signature, over, pictures = data.signature(name), drawn_over(name), []
    if signature is not None and over is not None:
        svg = partial_residual.draw_all(data, cause, over, signature)
        if svg is not None:
            pictures.append(Picture(f"signature-{i + 1}-{name}", svg, report_text("caption-cause")))
    forest = tables.intervals_chart(cause)
    if forest:
        pictures.append(Picture(f"parameters-{i + 1}-{name}", forest, "Bars hold the true value in 95 of 100 cases."))
    return ReportSection(f"cause-{i + 1}", f"Cause {i + 1}: {name}", text, tuple(pictures), (tables.parameters(cause),))


def _gain(data: ReportData) -> ReportSection:
    """Before and after on data that were not fitted, and what that is for the line."""
    if not data.causes:
        return ReportSection("gain", "")
    drawn = tables.before_after_chart(data)
    bars = [Picture("before-after", drawn, "The shorter the second bar, the more it explains.")] if drawn else []
    text = [tables.gain_sentence(cause, data.unit_of_readings) for cause in data.causes]
    if (v := data.judged) is not None:
        text.append(
            f"Under the recipe's limits {v['passed_before']} of {len(v['units'])} units pass as measured, and "
            f"{v['passed_after']} with the causes taken off their readings; "
            f"{count_noun(v['verdicts_changed'], 'verdict')} would change."
        )
    found = bars
    moved = tables.shifts_chart(data)
    if moved:
        said = "How far the causes move what a calibrated unit reads, by the recipe's own method."
        found.append(Picture("calibration-shift", moved, said))
    shifts = tables.shifts(data)
    return ReportSection("gain", "What knowing it gains", tuple(text), tuple(found), (shifts,) if shifts else ())


def _ranking(data: ReportData) -> ReportSection:
    rows = data.document["considered"]
    if not rows:
        return ReportSection("ranking", "")
    bars = tables.evidence_chart(rows)
    said = "3 nats are 20 : 1, 7 nats are 1000 : 1; nought means that nothing speaks for it."
    pictures = (Picture("ranking", bars, said),) if bars else ()
    text = "Evidence is how much likelier the data are with the cause than without it, its size left open."
    return ReportSection("ranking", "All causes looked at", (text,), pictures, (tables.ranking(data),))


def _residuals(data: ReportData) -> ReportSection:
    """The residual over everything that was recorded."""
    titles = {
        "position": "Residual against position",
        "order": "Residual against the order of the stops",
        "time_s": "Residual against time",
        "temperature_degC": "Residual against temperature",
        "previous": "Residual against the previous position",
    }
    found = [(name, plots.residual(data, name, title)) for name, title in titles.items()]
    pictures = [Picture(f"residual-{name.split('_')[0]}", svg) for name, svg in found if svg]
    for i, word in enumerate(data.axes):
        svg = plots.heat(data, data.before, "Residual by unit and position", i)
        if svg:
            pictures.append(Picture(f"heat-map-{word.replace(' ', '-')}", svg))
    missing = [titles[name].split("against ")[1] for name, svg in found if not svg and plot_axis(data, name) is None]
    text = ["What is measured less what is simulated, after each unit's own calibration is taken off."]
    if missing:
        text.append(f"Not drawn, because it was not recorded or never changes: {', '.join(missing)}.")
    return ReportSection("residuals", "Where the residual lies", tuple(text), tuple(pictures))


def _means_section(data: ReportData) -> ReportSection:
    svg = plots.means(data)
    pictures = (Picture("means", svg, "Nought is agreement."),) if svg else ()
    table = tables.means(data)
    title = "Measured beside simulated" + (" beside extended" if data.causes else "")
    return ReportSection("means", title, (), pictures, (table,) if table else (), folded=True)


def _limits_section(data: ReportData) -> ReportSection:
    """How small an effect would have been seen, and what could not be tested."""
    found: Sequence[ReportTable] = [t for t in (tables.not_testable(data), tables.smallest(data)) if t is not None]
    return ReportSection("limits", "What was checked, and what these data cannot show", (), (), tuple(found))
