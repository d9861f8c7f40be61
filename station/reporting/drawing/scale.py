"""Axes: where a value falls on the paper, and which round numbers stand beside it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Scale:
    """A linear map of values [low, high] to paper [start, end] (px)."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)


def axis_range(values: Sequence[float], zero: bool = False) -> tuple[float, float]:
    """Range of the finite values with 5 % of air; `zero` keeps 0 in sight; (0, 1) when there are none."""
    finite = [v for v in values if math.isfinite(v)]
    if zero:
        finite.append(0.0)
    if not finite:
        return 0.0, 1.0
    low, high = min(finite), max(finite)
    if low == high == 0.0:
        return 0.0, 1.0
    air = (high - low) * 0.05 or abs(high) * 0.05
    return (low if zero and low == 0 else low - air), (high if zero and high == 0 else high + air)


def ticks(low: float, high: float, wanted: int = 5) -> list[float]:
    """About `wanted` round numbers (1, 2 or 5 times a power of ten) within [low, high]."""
    raw = (high - low) / max(wanted, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    count = math.floor(high / step + 1e-9) - first + 1
    return [(first + i) * step for i in range(count)]


def text_width(words: str, size: int = 12) -> float:
    """About how wide a line of text is, px; Chinese characters fill a square."""
    return sum(size if ord(c) > 0x2E7F else 0.6 * size for c in words)


def tick_label(value: float) -> str:
    """A tick's text: short, with a real minus sign."""
    return f"{value:.6g}".replace("-", "−")
