"""Eₙ of a golden unit over time, drawn."""

from collections.abc import Sequence
from typing import Literal

from station.domain.line_quality.golden import EnTrend
from station.reporting.drawing.figure import COLOURS, Figure, Series, panels
from station.reporting.words import Words

Mark = Literal["circle", "square", "triangle", "diamond"]
_MARKS: tuple[Mark, ...] = ("circle", "square", "triangle", "diamond")


def draw_trends(title: str, trends: Sequence[EnTrend], words: Words) -> str:
    """One figure a kind of coefficient, ± 1 as levels; days since the first attempt across."""
    first_s = min((p.at_s for t in trends for p in t.points), default=0.0)
    kinds = dict.fromkeys(t.name.partition(" ")[0] for t in trends if t.points)
    figures = [
        Figure(
            title=words.term(kind),
            x_label=words.term("days"),
            y_label="Eₙ",
            series=tuple(_series(words, i, t, first_s) for i, t in enumerate(_of_kind(trends, kind))),
            levels=((1.0, "1"), (-1.0, "−1")),
        )
        for kind in kinds
    ]
    return panels(title, figures)


def _of_kind(trends: Sequence[EnTrend], kind: str) -> list[EnTrend]:
    return [t for t in trends if t.points and t.name.startswith(kind)]


def _series(words: Words, number: int, trend: EnTrend, first_s: float) -> Series:
    days = [(p.at_s - first_s) / 86400 for p in trend.points]
    scores = [p.score for p in trend.points]
    return Series(days, scores, words.term(trend.name), colour=number % len(COLOURS), mark=_MARKS[number % len(_MARKS)])
