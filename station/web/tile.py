"""A unit's verdict as its tile shows it: the value, how far off it is, and where it lies between its limits."""

from collections.abc import Mapping
from typing import Any

from station.messages import Message, render, term

#: Room that the bar leaves beyond its ends, as a share of what it shows.
_MARGIN = 0.08
_MINUS = "−"


def tile_of(figure: Mapping[str, Any] | None, code: str) -> dict[str, Any] | None:
    """Lines and bar of a headline (station.domain.run.headline) in that language: `head`, `line`, and on the bar
    `ticks` (place 0…1, text), `low`, `high`, `target`, `value` as places. None where no number decided."""
    if not figure:
        return None
    value, low, high, target = (float(figure[k]) for k in ("value", "low", "high", "target"))
    factor, unit = _readable(str(figure["unit"]), max(abs(high), abs(low)) if target == 0 else 0.0)
    begin, end = min(low, value), max(high, value)
    span = (end - begin) * (1 + 2 * _MARGIN) or 1.0
    start = begin - (end - begin) * _MARGIN
    ticks = [low, target, high] if low < target else [low, high]
    return {
        "head": _head(figure, value * factor, unit, code),
        "line": render(_line(value, target, high, factor, unit), code),
        "bar": {
            **{k: round((v - start) / span, 4) for k, v in
               {"low": low, "high": high, "target": target, "value": value}.items()},
            "ticks": [[round((t - start) / span, 4), _tick(t * factor, unit)] for t in ticks],
            "inside": low <= value <= high,
        },
    }  # fmt: skip


def _head(figure: Mapping[str, Any], value: float, unit: str, code: str) -> str:
    name = term(str(figure["what"]), code)
    text = f"{value:.4f}" if figure["target"] == 1 else f"{value:.3g}"
    return f"{name} {text.replace('-', _MINUS)}{unit}"


def _line(value: float, target: float, high: float, factor: float, unit: str) -> Message:
    """How far off it is, in words: a gain in percent, everything else in its unit."""
    limit = high - target
    if target:
        share, allowed = (value / target - 1) * 100, limit / target * 100
        id_ = "tile-gain-low" if share < 0 else "tile-gain-high"
        return Message(id_, share=abs(share), limit=allowed)
    return Message("tile-limit", limit=limit * factor, unit=unit)


def _readable(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit in which small figures are read without zeros."""
    if unit in ("1", ""):
        return 1.0, ""
    if unit == "g" and 0 < largest < 0.1:
        return 1e3, " mg"
    return 1.0, f" {unit}"


def _tick(value: float, unit: str) -> str:
    return f"{value:.4g}{unit if value else ''}".replace("-", _MINUS)
