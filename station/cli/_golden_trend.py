"""`station golden trend`: Eₙ of a golden unit over every attempt in the log."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from station.cli import _output
from station.cli._layout import TextTable
from station.domain.line_quality.golden import EnTrend, RegisteredUnit
from station.errors import UsageError
from station.files.replace import replace_text
from station.messages import Message, render, system_reason
from station.ports.log_reader import LogReader
from station.reporting.line.golden_chart import draw_trends
from station.reporting.number_text import format_number
from station.reporting.words import words_of
from station.service import golden_register

SCHEMA = "station.golden-trend/1"


def show_trend(log: LogReader, unit: RegisteredUnit, svg: Path | None, *, as_json: bool) -> int:
    """Prints and draws. Errors: UsageError, LogError."""
    found = golden_register.trends(log, unit)
    if svg is not None:
        _write(svg, draw_trends(f"Eₙ {unit.serial}", found, words_of("en")))
    if as_json:
        _output.print_json({"schema": SCHEMA, "serial": unit.serial, "trends": [_document(t) for t in found]})
        return 0
    _output.print_table("", _table(found))
    for trend in found:
        if trend.days_to_limit is not None:
            figures = {"drift": trend.drift_per_day, "half": trend.drift_half, "days": trend.days_to_limit}
            _output.print_line(render(Message("golden-drifts", name=trend.name, **figures)))
    if svg is not None:
        _output.print_line(str(svg))
    return 0


def _document(trend: EnTrend) -> dict[str, object]:
    """A drift that cannot be told has no half-width."""
    known = trend.drift_half != float("inf")
    return asdict(trend) | {"drift_half": trend.drift_half if known else None}


def _table(trends: Sequence[EnTrend]) -> TextTable:
    rows = []
    for t in trends:
        scores = [p.score for p in t.points]
        if t.points:
            last = t.points[-1]
            figures = (format_number(last.value, 6), format_number(last.expanded, 2))
            scored = (f"{score:+.2f}" for score in (last.score, min(scores), max(scores)))
            rows.append((t.name, str(len(scores)), *figures, *scored))
    heads = ("coefficient", "attempts", "newest", "± U", "Eₙ", "least", "most")
    return TextTable(heads, rows, right=frozenset(range(1, len(heads))))


def _write(path: Path, text: str) -> None:
    try:
        replace_text(path, text, durable=False)
    except OSError as exc:
        raise UsageError("file-not-written", file=str(path), why=system_reason(exc)) from exc
