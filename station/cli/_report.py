"""The face of the report: a self-contained page, a JSON document, or tables."""

from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from station.cli import _output
from station.cli._layout import TextTable
from station.cli._pages import environment
from station.errors import UsageError
from station.files.replace import replace_text
from station.messages import Message, render, system_reason
from station.ports.log_reader import Query
from station.reporting.line import charts
from station.reporting.line.statistics import LineStatistics
from station.reporting.words import words_of
from station.service.line_statistics import gather_statistics

if TYPE_CHECKING:
    from station.ports.log_reader import LogReader


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """What is asked; out: the page's file, or None."""

    query: Query
    value: str
    size: int
    most: int
    out: Path | None


def run_report(log: "LogReader", request: ReportRequest, *, as_json: bool) -> int:
    """Writes and prints the report. Errors: LogError, UsageError."""
    with _output.activity(Message("activity-log", log=log.location)):
        line = gather_statistics(log, request.query, request.most)
    drawn = charts.draw(line, request.value, request.size, words_of("en"))
    if request.out is not None:
        _write(request.out, _page(log, drawn, line))
    if as_json:
        _output.print_json(charts.document(line, drawn))
        return 0
    if line.simulated:
        _output.print_message(_mark(line))
    for table in drawn.tables:
        _output.print_table(f"\n{table.title}", _text_table(table))
    if drawn.problem:
        _output.print_remark(drawn.problem)
    if request.out is not None:
        _output.print_line(f"\nreport: {request.out}")
    return 0


def _mark(line: LineStatistics) -> Message:
    return Message("attempts-simulated", count=line.simulated)


def _page(log: "LogReader", drawn: charts.Charts, line: LineStatistics) -> str:
    head = log.head()
    title = f"Line report: {PurePath(log.location).name}"
    summary = render(Message("line-report-summary", count=len(line.attempts)))
    mark = render(_mark(line)) if line.simulated else ""
    template = environment().get_template("report.html")
    return template.render(title=title, summary=summary, charts=drawn, mark=mark, head=f"{head.number}:{head.hash}")


def _write(path: Path, text: str) -> None:
    try:
        replace_text(path, text)
    except OSError as exc:
        raise UsageError("file-not-written", file=str(path), why=system_reason(exc)) from exc


def _text_table(table: charts.ChartTable) -> TextTable:
    """Figures to the right; words may be broken."""
    others = frozenset(range(1, len(table.columns)))
    if table.words:
        return TextTable(table.columns, table.rows, words=others)
    return TextTable(table.columns, table.rows, right=others)
