"""The report: one line a figure, its goal and its seed."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, slots=True)
class Figure:
    """What was measured, with which seed, and whether it met its goal."""

    what: str
    seed: int
    value: float
    met: bool
    beside: bool = False


@dataclass(slots=True)
class Report:
    """Prints figures as they come. shift: added to the seed of every row; xsd: files of DCC schemas to validate by."""

    shift: int = 0
    xsd: tuple[str, ...] = ()
    figures: list[Figure] = field(default_factory=list)

    def generator(self, *seed: int) -> np.random.Generator:
        """Of a row's seed and what it is shifted by."""
        return np.random.default_rng([*seed, self.shift] if self.shift else list(seed))

    def show(
        self, what: str, seed: int, value: float, goal: tuple[float, float], spread: float, more: str = ""
    ) -> None:
        """One row; `more` may say that something beside the figure was missed."""
        low, high = goal
        met = low <= value <= high
        beside = "MISSED" in more
        self.figures.append(Figure(what, seed + self.shift, value, met and not beside, beside))
        limits = f"{low:g}–{high:g}" if high < np.inf else f"≥ {low:g}"
        print(
            f"  {what:<58} {value:9.4f} ± {spread:.4f}   goal {limits:<10} {'met' if met else 'MISSED':<7} "
            f"seed {seed + self.shift} {more}",
            flush=True,
        )

    def summary(self, left_out: tuple[str, ...]) -> None:
        """How many met their goal, which did not, and what was not run."""
        missed = [one for one in self.figures if not one.met]
        print(f"\nCONCLUSION: {len(self.figures) - len(missed)} of {len(self.figures)} figures met their goal.")
        if missed:
            print("Not met (why: docs/uncertainty.md, How far it is true):")
        for one in missed:
            why = "; too many accepted at the limit" if one.beside else ""
            print(f"  {one.what}, seed {one.seed}: {one.value:.4f}{why}")
        if left_out:
            print(f"Not run, so not validated by this report: {', '.join(left_out)}")
        print("Validated by: ____________________   Date: ____________")
