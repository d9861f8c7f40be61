"""What a recipe will know of every coefficient, before anything moves: the calibration of an ideal unit.

The forecast is no formula of its own. It is the recipe's method, budget and limits applied to the stops of a perfect
sensor with the data sheet's noise.
"""

from dataclasses import dataclass

import numpy as np

from station.domain import coefficients, design, method, resolution, uncertainty
from station.domain.judge import COVERAGE_FACTOR, guard_band
from station.domain.recipe import Recipe
from station.domain.stillness import expected_noise
from station.domain.types import Floats, Stops
from station.domain.uncertainty import Budget

#: From this ratio of limit to expanded uncertainty on, the uncertainty hardly matters (ILAC-G8, 4:1).
COMFORTABLE = 4.0


@dataclass(frozen=True, slots=True)
class Decision:
    """Whether a limit can be decided: limit and expanded uncertainty U of its least certain coefficient; guard: the
    rule's guard band there; verdict: comfortable | tight | impossible."""

    kind: str
    coefficient: str
    limit: float
    expanded: float
    guard: float
    verdict: str


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Budget of a perfect unit, and what each limit can decide; noise: of one sample, in the recipe's unit."""

    budget: Budget
    decisions: tuple[Decision, ...]
    noise: float


def forecast(recipe: Recipe, rounding: Floats) -> Forecast:
    """The forecast of a recipe that `design.check` accepts and that lists its positions."""
    stops = ideal_stops(recipe)
    problem = method.problem(recipe, [stops])
    fit = method.of(recipe).fit(problem)
    budget = uncertainty.budgets(recipe, problem, fit, [stops], rounding)[0]
    return Forecast(budget, _decisions(recipe, budget), expected_noise(recipe))


def ideal_stops(recipe: Recipe) -> Stops:
    """The planned stops as a perfect sensor with the sheet's noise and resolution would see them."""
    position, seating, true = design.of_plan(recipe)
    v, noise = len(position), expected_noise(recipe)
    dwell_s = recipe.dwell.time_s or recipe.dwell.max_s
    count = max(round(dwell_s * recipe.device.rate_hz), 1)
    variance = (recipe.dwell.until_std or noise / np.sqrt(count)) ** 2
    rounding = float(resolution.rounding_variance(np.array(recipe.device.lsb), np.array(noise)))
    return Stops(
        position=position,
        seating=seating,
        run=np.zeros(v, np.int32),
        visit=np.arange(v, dtype=np.int32),
        mean=true,
        cov=np.tile((variance + rounding) * np.eye(3), (v, 1, 1)),
        quantisation=np.full((v, 3), rounding),
        dof=np.full((v, 3), 1e6),
        true=true,
        std=np.full((v, 3), noise),
        count=np.full(v, count),
        effective=np.full(v, float(count)),
        time_s=np.arange(v, dtype=float) * (dwell_s + recipe.settle.time_s),
        temperature_degC=_temperatures(recipe),
    )


def _temperatures(recipe: Recipe) -> Floats:
    """Planned differences between the runs, about 20 °C."""
    per_run = len(recipe.positions)
    return np.repeat([20.0 + run.temperature_offset_degC for run in recipe.runs], per_run)


def _decisions(recipe: Recipe, budget: Budget) -> tuple[Decision, ...]:
    limits, std = recipe.limits, budget.std()
    guard = guard_band(limits, std, budget.dof)
    kinds = {"offset": coefficients.OFFSETS, "gain": coefficients.GAINS, "cross_axis": coefficients.CROSS}
    out = []
    for kind, which in kinds.items():
        limit = getattr(limits, kind)
        if limit is None:
            continue
        worst = int(np.argmax(np.where(which, std, -1.0)))
        expanded = float(COVERAGE_FACTOR * std[worst])
        told = "impossible" if max(expanded, guard[worst]) >= limit else "tight"
        told = "comfortable" if COMFORTABLE * expanded <= limit else told
        out.append(Decision(kind, coefficients.NAMES[worst], limit, expanded, float(guard[worst]), told))
    return tuple(out)
