"""Figures with their 95 % intervals, and how a row of them is told."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

Array = Any
Z95 = 1.96


@dataclass(frozen=True)
class Figure:
    """value with its 95 % interval low–high from so many runs; goal as text and whether it is met, None without one."""

    what: str
    value: float
    low: float
    high: float
    runs: int
    goal: str = ""
    met: bool | None = None
    note: str = ""

    def line(self) -> str:
        """The figure for a person."""
        shown = "" if self.met is None else "met" if self.met else "MISSED"
        goal = f"goal {self.goal}" if self.goal else ""
        spread = f"({self.low:.3g}–{self.high:.3g}, {self.runs} runs)"
        return f"  {self.what:<62} {self.value:>7.3g} {spread:<26} {goal:<12} {shown:<6} {self.note}".rstrip()

    def document(self) -> dict[str, Any]:
        """As plain numbers; what is not finite as null."""
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(self).items()}


def at_least(value: float, goal: float) -> tuple[str, bool]:
    """A goal from below."""
    return f">= {goal:g}", value >= goal


def at_most(value: float, goal: float) -> tuple[str, bool]:
    """A goal from above."""
    return f"<= {goal:g}", value <= goal


def between(value: float, low: float, high: float) -> tuple[str, bool]:
    """A goal from both sides."""
    return f"{low:g}–{high:g}", low <= value <= high


Judge = Callable[[float], tuple[str, bool]]


def share(what: str, hits: Sequence[bool], judge: Judge | None = None, note: str = "") -> Figure:
    """A share with Wilson's interval (J. Am. Stat. Assoc. 22 (1927) 209)."""
    n = len(hits)
    p = sum(hits) / n if n else float("nan")
    centre = (p + Z95**2 / (2 * n)) / (1 + Z95**2 / n) if n else float("nan")
    half = Z95 / (1 + Z95**2 / n) * np.sqrt(p * (1 - p) / n + Z95**2 / (4 * n**2)) if n else float("nan")
    goal, met = judge(p) if judge is not None else ("", None)
    low, high = (round(min(max(float(x), 0.0), 1.0), 6) for x in (centre - half, centre + half))
    return Figure(what, p, low, high, n, goal, met, note)


def bootstrapped(
    what: str, of: Callable[[Array], float], runs: int, judge: Judge | None = None, note: str = "", draws: int = 400
) -> Figure:
    """A figure of the rows with the numbers it is given; its interval from rows drawn with replacement."""
    rng = np.random.default_rng(1)
    value = of(np.arange(runs))
    spread = [of(rng.integers(runs, size=runs)) for _ in range(draws)]
    low, high = np.nanquantile(spread, [0.025, 0.975])
    goal, met = judge(value) if judge is not None else ("", None)
    return Figure(what, value, float(low), float(high), runs, goal, met, note)
