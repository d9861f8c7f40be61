"""What one attempt's page shows first: the value that decided, residuals by position, the neighbours of its day."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from station.domain.methods import coefficients
from station.messages import Message
from station.reporting.drawing import limit_bar
from station.reporting.drawing.drawing import Drawing
from station.reporting.drawing.figure import Figure, Series, plot
from station.reporting.drawing.limit_bar import LimitBar
from station.reporting.line.statistics import AttemptValues
from station.reporting.words import Words

#: A decision as the log keeps it, and an attempt as the audit reads it.
Document = Mapping[str, Any]
#: A time of the log → the time of day on an axis.
Clock = Callable[[int], str]
_MARKS = ("circle", "triangle", "square")
_HOUR_NS = 3_600 * 10**9
#: Of so many other units at least the nest is judged; it is suspected where this share of them missed the limit, and
#: twice the share of other nests.
_MIN_UNITS, _SUSPECT_SHARE = 5, 0.2


@dataclass(frozen=True, slots=True)
class Deciding:
    """The coefficient that decided: its name, the bar, and in words how far it is from its limit."""

    what: str
    chart: Drawing
    margin: str


def deciding(fit: Document | None, reasons: Sequence[Document], words: Words) -> Deciding | None:
    """The coefficient that failed, or the one nearest to its limit; None where none was judged."""
    judged = [d for d in (fit or {}).get("decisions") or () if d["what"] in coefficients.NAMES]
    if not judged:
        return None
    named = next((str(r["message"].get("coefficient", "")) for r in reasons if r.get("message")), "")
    chosen = next((d for d in judged if d["what"] == named), min(judged, key=lambda d: d["margin"] / d["limit"]))
    bar = _bar(chosen, words)
    name = words.term(chosen["what"])
    return Deciding(
        chosen["what"], limit_bar.draw(bar, f"{name},{_unit(chosen['unit'])}".rstrip(", ")), _margin(chosen, words)
    )


def rest(fit: Document | None, first: str, words: Words) -> list[tuple[str, str]]:
    """Every other judged coefficient, nearest to its limit first: its name, and the share of its limit that it uses."""
    judged = [d for d in (fit or {}).get("decisions") or () if d["what"] in coefficients.NAMES and d["what"] != first]
    judged.sort(key=lambda d: d["margin"] / d["limit"])
    return [(words.term(d["what"]), f"{100 * abs(d['value']) / d['limit']:.0f} %") for d in judged]


def residual_figure(fit: Document | None, words: Words) -> Drawing | None:
    """What is left of each position's reading, with twice the standard deviation of its mean; None without a fit."""
    positions = (fit or {}).get("positions") or ()
    unit = str((fit or {}).get("budget", [{}])[0].get("unit", ""))
    points = [(str(p["name"]), p["residual"], p.get("std_of_mean", (0.0,) * 3)) for p in positions]
    title = Message("residuals-by-position")
    limit = next((d["limit"] for d in (fit or {}).get("decisions") or () if d["what"] == "residual"), None)
    if limit:
        factor, shown = _readable(unit, limit)
        title = Message("residuals-within", limit=f"{limit * factor:.3g}", unit=shown)
    return _by_position(points, unit, words.render(title))


def reading_figure(visits: Sequence[Document], unit: str, words: Words) -> Drawing | None:
    """The mean reading at each stop, with twice the standard deviation of a reading: what is known of a unit
    that came to no calibration; None where nothing was read."""
    read = [(v, v["statistics"]) for v in visits if v["statistics"].get("mean")]
    points = [(str(v["position"]), s["mean"], s.get("std") or (0.0,) * len(s["mean"])) for v, s in read]
    return _by_position(points, unit, words.render(Message("readings-by-position")))


def _by_position(
    points: Sequence[tuple[str, Sequence[float], Sequence[float]]], unit: str, title: str
) -> Drawing | None:
    """points: of each stop its name, and of each axis the value and its standard deviation."""
    if not points:
        return None
    largest = max(
        (abs(float(v)) + 2 * abs(float(s)) for _, vs, ss in points for v, s in zip(vs, ss, strict=True)), default=0
    )
    factor, unit = _readable(unit, largest)
    points = [(name, [factor * float(v) for v in vs], [factor * float(s) for s in ss]) for name, vs, ss in points]
    series = []
    for axis in range(len(points[0][1])):
        x = [i + 0.18 * (axis - 1) for i in range(len(points))]
        y = [float(values[axis]) for _, values, _ in points]
        spread = [2 * float(std[axis]) for _, _, std in points]
        low, high = [a - s for a, s in zip(y, spread, strict=True)], [a + s for a, s in zip(y, spread, strict=True)]
        series.append(Series(x, y, "xyz"[axis], "dots", low, high, axis, _MARKS[axis]))  # type: ignore[arg-type]
    return plot(Figure(title, "", unit, tuple(series), tuple(name for name, _, _ in points), ((0.0, ""),)))


def neighbours(
    day: Sequence[AttemptValues],
    own: AttemptValues,
    what: str,
    limits: tuple[float, float] | None,
    words: Words,
    clock: Clock,
) -> Drawing | None:
    """One value of all attempts of the day: those of the same nest, those of others, and this one."""
    known = [a for a in day if what in a.values and a.started_ns != own.started_ns]
    if what not in own.values or len(known) < 2:
        return None
    begin = min(a.started_ns for a in [*known, own]) // _HOUR_NS * _HOUR_NS

    def hours(a: AttemptValues) -> float:
        return (a.started_ns - begin) / _HOUR_NS

    def at(hour: float) -> str:
        return clock(begin + round(hour * _HOUR_NS))

    nest, others = [a for a in known if a.nest == own.nest], [a for a in known if a.nest != own.nest]
    groups = (
        (others, "other-nests", "circle", 5),
        (nest, "same-nest", "square", 0),
        ([own], "this-unit", "diamond", 6),
    )
    series = tuple(
        Series([hours(a) for a in group], [a.values[what] for a in group], words.render(Message(f"neighbours-{name}")),
               "dots", colour=colour, mark=shape, links=[(f"/audit/unit?serial={a.serial}", a.serial) for a in group])  # type: ignore[arg-type]
        for group, name, shape, colour in groups if group
    )  # fmt: skip
    named = zip(("LSL", "USL"), limits, strict=True) if limits else ()
    levels = tuple((value, f"{name} {value:.5g}".replace("-", "−")) for name, value in named)
    title = words.render(Message("neighbours-title", coefficient=words.term(what), units=len(known) + 1))
    return plot(Figure(title, "", words.term(what), series, levels=levels, zero=False, x_text=at))


def nest_sentence(
    day: Sequence[AttemptValues], own: AttemptValues, what: str, limits: tuple[float, float] | None, words: Words
) -> str:
    """The unit or the nest? What other units showed in the same nest that day; '' where there were none.

    limits: of a value that decided against the unit; None where it did not.
    """
    others = [a for a in day if a.serial != own.serial and what in a.values]
    there = [a.values[what] for a in others if a.nest == own.nest]
    elsewhere = [a.values[what] for a in others if a.nest != own.nest]
    if not there:
        return ""
    known: dict[str, str | int] = {"nest": own.nest, "units": len(there)}
    known["median"] = f"{median(there):.5g}".replace("-", "−")
    if limits is None or len(there) < _MIN_UNITS:
        return words.render(Message("nest-of-the-day", **known))
    missed, missed_elsewhere = (sum(not limits[0] <= v <= limits[1] for v in values) for values in (there, elsewhere))
    if not missed:
        return words.render(Message("nest-is-well", **known))
    if missed >= _SUSPECT_SHARE * len(there) and missed * len(elsewhere) >= 2 * missed_elsewhere * len(there):
        return words.render(
            Message("nest-is-suspect", **known, missed=missed, others=len(elsewhere), missed_there=missed_elsewhere)
        )
    return words.render(Message("nest-missed", **known, missed=missed))


def limits_of_value(fit: Document | None, what: str) -> tuple[float, float] | None:
    """Lower and upper limit of a coefficient as it was judged."""
    for d in (fit or {}).get("decisions") or ():
        if d["what"] == what:
            target = float(coefficients.NOMINAL[coefficients.NAMES.index(what)])
            return target - d["limit"], target + d["limit"]
    return None


def _bar(d: Document, words: Words) -> LimitBar:
    target = float(coefficients.NOMINAL[coefficients.NAMES.index(d["what"])])
    names = tuple(words.render(Message(f"bar-{name}")) for name in ("lower", "target", "upper", "allowed"))
    expanded, guard = d["expanded"], float(d.get("guard") or 0.0)
    return LimitBar(target + d["value"], expanded, target - d["limit"], target + d["limit"], target, names, guard)  # type: ignore[arg-type]


def _margin(d: Document, words: Words) -> str:
    """How far beyond or within the limit, in units of U where U is known."""
    beyond, expanded = abs(d["value"]) - d["limit"], d["expanded"]
    ratio = f"{abs(beyond) / expanded:.1f}" if expanded else "–"
    distance, unit = f"{abs(beyond):.3g}", _unit(d["unit"])
    if beyond <= 0 and d["margin"] < 0:
        return words.render(Message("margin-in-guard", distance=distance, guard=f"{d['guard']:.3g}", unit=unit))
    id_ = "margin-beyond" if beyond > 0 else "margin-within"
    return words.render(Message(id_, distance=distance, unit=unit, ratio=ratio))


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _readable(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit in which small figures are read without zeros."""
    return (1e3, "mg") if unit == "g" and 0 < largest < 0.1 else (1.0, unit)
