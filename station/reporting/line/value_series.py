"""One value of one recipe's units in their order, with its limits, and the rules that they break."""

from dataclasses import dataclass

import numpy as np

from station.domain.line_quality import spc
from station.domain.recipe.blocks import Limits
from station.reporting.drawing.levels import Level
from station.reporting.line.statistics import AttemptValues, LineStatistics, limits_of
from station.reporting.number_text import format_number
from station.reporting.words import Words

#: Shape of a mark that breaks a rule: a single point, a trend, and every other run.
RULE_SHAPES = {"beyond 3σ": "triangle", "six in a trend": "diamond"}
OTHER_RULE = "square"


@dataclass(frozen=True, slots=True)
class ValueSeries:
    """attempts: those with the value, oldest first; values of them; limits and target: None where there is none."""

    name: str
    attempts: tuple[AttemptValues, ...]
    values: tuple[float, ...]
    lower: float | None
    upper: float | None
    target: float | None

    @staticmethod
    def of(line: LineStatistics, value: str) -> "ValueSeries":
        """That of the attempts which a limit judged."""
        attempts = tuple(a for a in line.attempts if value in a.values and a.outcome in ("PASS", "FAIL"))
        lower, upper = limits_of(value, line.recipe.limits if line.recipe else Limits())
        target = None if lower is None or upper is None else (lower + upper) / 2
        return ValueSeries(value, attempts, tuple(a.values[value] for a in attempts), lower, upper, target)

    def inside(self, value: float) -> bool:
        """Whether a value lies within the specification."""
        return (self.lower is None or value >= self.lower) and (self.upper is None or value <= self.upper)

    def specification(self, words: Words) -> list[Level]:
        """Limits and target as lines."""
        named = ((self.upper, "USL"), (self.lower, "LSL"))
        levels = [Level(v, f"{name} {format_number(v, 4)}", "limit") for v, name in named if v is not None]
        if self.target is not None:
            levels.append(Level(self.target, f"{words.term('target')} {format_number(self.target, 4)}", "target"))
        return levels


@dataclass(frozen=True, slots=True)
class Control:
    """Control limits from the units within specification; rules: what each of them breaks, by its index."""

    centre: float
    sigma: float
    rules: dict[int, str]

    @staticmethod
    def of(process: ValueSeries) -> "Control | None":
        """None where there is no spread to judge by."""
        good = np.array([v for v in process.values if process.inside(v)])
        if len(good) < 2 or (sigma := spc.sigma_within(good[:, None])) == 0:
            return None
        centre, rules = float(good.mean()), dict[int, str]()
        for i, rule in spc.nelson(np.array(process.values), centre, sigma):
            if process.inside(process.values[i]) and (i not in rules or rule in RULE_SHAPES):
                rules[i] = rule
        return Control(centre, sigma, rules)

    def levels(self, words: Words) -> list[Level]:
        """Control limits and mean as lines."""
        reach = 3 * self.sigma
        return [
            Level(self.centre + reach, f"UCL {format_number(self.centre + reach, 4)}", "control"),
            Level(self.centre, f"{words.term('mean')} {format_number(self.centre, 4)}", "centre"),
            Level(self.centre - reach, f"LCL {format_number(self.centre - reach, 4)}", "control"),
        ]
