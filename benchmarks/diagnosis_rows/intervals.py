"""Row 9: whether the stated 95 % intervals hold the true sizes, of the coefficients and of a time constant."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from diagnosis_rows.figures import Z95, Array, Figure, between, bootstrapped

from station.diagnosis.results.estimate import Estimate
from tests.blind.bench import World, hide
from tests.blind.hidden import KNOWN
from tests.blind.inspection import diagnosis_of
from tests.blind.recipes import recipe

STRENGTH = 16.0


#: Causes that bench and library write with the same coefficients, and the parameter of the form that is linear in the
#: logarithm of the bench's first uniform draw.
CAUSES: dict[str, str] = {
    "quadratic": "", "offset-temperature": "", "gain-temperature": "", "vibration-rectification": "", "nest-tilt": "",
    "warm-up": "time_constant_s", "settling": "time_constant_s", "clamp-creep": "time_constant_s",
}  # fmt: skip


@dataclass
class Stored:
    """Random numbers that remember what was drawn last: coefficients, and the logarithm of a time constant."""

    of: Any
    coefficients: Array = None
    log_constant: float = np.nan

    def amplitude(self, typical: float, shape: tuple[int, ...]) -> Array:
        """Coefficients."""
        self.coefficients = self.of.amplitude(typical, shape)
        return self.coefficients

    def uniform(self, low: float, high: float) -> float:
        """The logarithm of a time constant."""
        self.log_constant = float(self.of.uniform(low, high))
        return self.log_constant


def inside(name: str, seed: int) -> list[bool]:
    """Of each coefficient, and of the time constant, whether its interval holds the truth; empty where another cause
    or another level was named."""
    stored: list[Stored] = []

    def hidden(w: World, rng: Any) -> tuple[Array, Array]:
        stored[:] = [Stored(rng)]
        return KNOWN[name](w, stored[0])  # type: ignore[arg-type]

    table, _ = hide(recipe(), hidden, seed, d=STRENGTH)
    for cause in diagnosis_of(recipe(), table).causes:
        estimate, true = cause.estimate, stored[0].coefficients
        if cause.finding.name == name and estimate is not None and estimate.value.shape == true.shape:
            held = np.abs(estimate.value - true) < Z95 * estimate.std
            return [bool(x) for x in held.ravel()] + _form(estimate, CAUSES[name], stored[0].log_constant)
    return []


def _form(estimate: Estimate, field: str, log_constant: float) -> list[bool]:
    shown = next((t for t in estimate.form if t.field == field), None)
    if shown is None:
        return []
    return [bool(abs(np.log(shown.value) - log_constant) < Z95 * shown.std / shown.value)]


def coverage(seed: int, sets: int) -> list[Figure]:
    """Row 9."""
    found = {
        name: [inside(name, seed * 10**6 + 800_000 + 1000 * i + n) for n in range(4 * sets)]
        for i, name in enumerate(CAUSES)
    }
    for name, rows in found.items():
        held = [x for row in rows for x in row]
        print(f"    {name}: {sum(held)} of {len(held)} in {sum(bool(r) for r in rows)} data sets")
    tables = [np.array(row, float) for rows in found.values() for row in rows if row]
    judge: Callable[[float], tuple[str, bool]] = lambda p: between(p, 0.93, 0.97)  # noqa: E731
    return [_pooled("95 % interval of the size covers", tables, judge)]


def _pooled(what: str, tables: list[Array], judge: Callable[[float], tuple[str, bool]]) -> Figure:
    """The share over all coefficients; whole data sets are drawn for its interval."""
    hits, counts = np.array([t.sum() for t in tables]), np.array([len(t) for t in tables])
    note = f"{counts.sum()} sizes"
    return bootstrapped(what, lambda at: float(hits[at].sum() / counts[at].sum()), len(tables), judge, note)
