"""The scale on which a constant of a term is searched, and its prior density on that scale."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.discovery.library import visit_interval
from station.domain.core.types import Floats
from station.model.effect import stimulus_strength
from station.model.formula.grammar import CONSTANTS

#: Where the zero and the bend of temperatures are looked for, in ranges of temperature about the middle: a square whose
#: zero is among the temperatures has a narrow best.
ZEROS = (-2.5, -1.2, -0.6, -0.3, -0.15, 0.0, 0.15, 0.3, 0.6, 1.2, 2.5)
BENDS = (-0.45, -0.2, 0.0, 0.2, 0.45)
#: Factor over which time constants are looked for, e-folds.
TIME_RANGE = 4.0


@dataclass(frozen=True, slots=True)
class ConstantScale:
    """The range of a constant, on a scale where equal steps matter equally. density: its prior along that scale."""

    start: float
    around: tuple[float, ...]
    value: Callable[[float], float]
    density: Callable[[Floats], Floats]

    @staticmethod
    def of(field: str, now: float, view: ResidualView) -> "ConstantScale":
        """The scale of a constant about its present value."""
        kind = CONSTANTS[field]

        def within(x: float) -> float:
            return float(min(max(x, kind.low), kind.high))

        if field == "time_constant_s":
            middle = float(np.log(now))
            around = (middle - 0.7, middle + 0.7)
            return ConstantScale(middle, around, lambda x: within(float(np.exp(x))), _evenly(TIME_RANGE))
        if field in ("about_degC", "kink_degC"):
            return _temperature_scale(field, now, view.scene.require("temperature_degC"), within)
        longest = max(float(view.scene.time_s.max()), 1e-3)
        if field == "cycles_hz":
            step = 0.35 / longest
            return ConstantScale(now, (now - step, now + step), within, _evenly(0.5 / visit_interval(view.scene)))
        if field == "start_s":
            step = longest / 18
            return ConstantScale(now, (now - step, now + step), within, _evenly(longest))
        step = 0.2 * abs(now) or 0.1
        bends = tuple(now + s * step for s in (-3, -2, -1, 1, 2))
        return ConstantScale(now, bends, within, _evenly(2 * stimulus_strength(view.scene.recipe)))


def _evenly(length: float) -> Callable[[Floats], Floats]:
    """A uniform prior over a scale of this length."""
    return lambda x: np.full(x.shape, 1 / length)


def _temperature_scale(field: str, now: float, T: Floats, within: Callable[[float], float]) -> ConstantScale:
    """The scale of a temperature: arcsinh of its distance from the mean, in ranges. A bend is uniform over the range; a
    zero has the distribution of a ratio of two coefficients of equal size (Cauchy)."""
    centre, width = float(T.mean()), max(float(np.ptp(T)), 0.1)
    std = max(float(T.std()) / width, 1e-3)
    low, high = (float(T.min()) - centre) / width, (float(T.max()) - centre) / width

    def density(x: Floats) -> Floats:
        from_centre = np.sinh(x)
        if field == "kink_degC":
            return np.where((from_centre >= low) & (from_centre <= high), np.cosh(x), 0.0)
        return np.cosh(x) / (np.pi * std * (1 + (from_centre / std) ** 2))

    start = float(np.arcsinh((now - centre) / width))
    around = ZEROS if field == "about_degC" else BENDS
    return ConstantScale(start, around, lambda x: within(centre + width * float(np.sinh(x))), density)
