"""Draws growth: processor time and memory against size, both axes of time logarithmic."""

import math
from collections.abc import Sequence
from typing import Any

from station.reporting.drawing.figure import Figure, Series, panels

#: What stands at the powers of ten along the bottom.
POWERS = ("1", "10", "100", "1 000", "10 000", "100 000", "1 million", "10 million")
WIDTH, HEIGHT = 860, 300


def drawn(found: Sequence[Any]) -> str:
    """One SVG: paths against units, paths against what else grows, and the memory of those that stream."""
    fleets = [g for g in found if g.path.over == "units"]
    others = [g for g in found if g.path.over != "units"]
    streams = [g for g in found if g.path.streams]
    figures = [
        _time("Time against units", "units", fleets, lambda g: g.path.name),
        _time("Time against other things", "samples, stops, nests, effects", others, _whole_name),
        _memory("Memory of the paths that stream", streams),
    ]
    return panels("Growth: a slope of one decade up for one decade across is a straight line", figures)


def _time(title: str, over: str, found: Sequence[Any], name: Any) -> Figure:
    series = [
        Series([math.log10(n) for n in g.sizes], [math.log10(s) for s in g.seconds], name(g), kind="line", colour=i)
        for i, g in enumerate(found)
    ]
    low, high = _decades([s for g in found for s in g.seconds])
    return Figure(
        *(title, over, "processor time, powers of ten", tuple(series)),
        x_names=POWERS[: _columns(found)],
        levels=tuple((float(p), f"{10.0**p:g} s") for p in range(low, high + 1)),
        width=WIDTH,
        height=HEIGHT,
        zero=False,
    )


def _memory(title: str, found: Sequence[Any]) -> Figure:
    series = [
        Series([math.log10(n) for n in g.sizes], g.mib, g.path.name, kind="line", colour=i) for i, g in enumerate(found)
    ]
    names = POWERS[: _columns(found)]
    return Figure(
        *(title, "units", "peak above the start, MiB", tuple(series)), x_names=names, width=WIDTH, height=HEIGHT
    )


def _whole_name(g: Any) -> str:
    return f"{g.path.name}, {g.path.over}"


def _columns(found: Sequence[Any]) -> int:
    return math.ceil(math.log10(max((n for g in found for n in g.sizes), default=10))) + 1


def _decades(seconds: Sequence[float]) -> tuple[int, int]:
    return math.floor(math.log10(min(seconds, default=0.1))), math.ceil(math.log10(max(seconds, default=1.0)))
