"""The report of `station diagnose`: one self-contained HTML file, and its figures as SVG files."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from station.cli._pages import environment
from station.diagnosis.results.diagnose import Diagnosis
from station.errors import UsageError
from station.messages import Message, render, system_reason
from station.reporting.diagnosis.gather import report_data
from station.reporting.diagnosis.page import ReportPage, build_page


def page_of_diagnosis(found: Diagnosis, findings: Mapping[str, Any]) -> ReportPage:
    """The report of a diagnosis and its document."""
    return build_page(report_data(found, findings))


def html(page: ReportPage, *, simulated: bool) -> str:
    """The page as HTML; simulated: it says so on top.

    Every text is escaped, only the figures, whose makers escape, go in as they are.
    """
    made = environment()
    made.filters["words"] = _mark_code
    return made.get_template("diagnosis.html").render(
        page=page, mark=render(Message("simulated-units")) if simulated else ""
    )


def _mark_code(text: str) -> Markup:
    """A text, escaped; what stands between backticks is a name of a column or key."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def write_figures(folder: Path, page: ReportPage) -> None:
    """Every figure as NAME.svg. UsageError where the folder cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, svg in page.pictures().items():
            safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
            (folder / f"{safe}.svg").write_text(svg, encoding="utf-8")
    except OSError as exc:
        raise UsageError("option-not-written", option="--figures", path=str(folder), why=system_reason(exc)) from exc
