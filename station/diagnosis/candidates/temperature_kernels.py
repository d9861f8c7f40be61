"""Kernels of the temperature: curves, waves, switches, memory, and heat that flows or fades depending on the pose."""

from collections.abc import Iterator

import numpy as np
from numpy.polynomial import legendre

from station.diagnosis.candidates.bank import Candidate
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.candidates.kernel_columns import each_axis, kernel, kernels_at, levels_that_differ, scaled
from station.diagnosis.candidates.temperature_memory import MIN_TEMPERATURE_RANGE, TemperatureMemory
from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Floats

#: Lag behind the temperature, as a share of a run's duration, and play in it, as a share of a run's range.
LAG, PLAY = 0.3, 0.4
#: Where among the temperatures something may switch, or be alone, and over what share of their range.
SWITCH_QUANTILES, BUMP_QUANTILES, BUMP_SHARE = (0.2, 0.35, 0.5, 0.65, 0.8), (0.25, 0.4, 0.55, 0.7), 0.12
#: Whole waves over the range, in steps that none falls between.
RIPPLES = (1.7, 2.5, 3.3, 4.1, 4.9)
#: Time after power-on or clamping in which what warmed has faded to a third, s.
FADE_S = 50.0


def temperature_kernels(view: ResidualView) -> Iterator[Candidate]:
    """Every kernel of heat that these data can show."""
    yield from _curves(view)
    yield from _heated_by_pose(view)
    yield from _fading_by_pose(view)


def _curves(view: ResidualView) -> Iterator[Candidate]:
    """Curves and waves of temperature, as a compensation in steps leaves them, and the memory of earlier
    temperatures."""
    T = view.scene.temperature_degC
    if T is None or np.ptp(T) < MIN_TEMPERATURE_RANGE:
        return
    # A bend or two of what a straight line leaves, or any curve.
    for degree in (3, 6):
        columns = CauseColumns.in_bank(view, each_axis(legendre.legvander(scaled(T), degree)[:, 1:]))
        for of in levels_that_differ(view, "unit", "common"):
            yield kernel("temperature", of, view, columns)
    for cycles in RIPPLES:
        wave = np.pi * cycles * scaled(T)
        yield from kernels_at(
            view, "temperature/ripple", each_axis(np.stack([np.cos(wave), np.sin(wave)], axis=1)), "unit", "common"
        )
    yield from _places(T, view)
    memory = TemperatureMemory.of(view.scene)
    if memory is not None:
        # What lags behind it, or is on another branch while it rises.
        branches = [memory.branch(PLAY, start) for start in (-1.0, 1.0)]
        functions = np.stack([(T - memory.lagged(LAG)) / memory.range_degC, *branches], axis=1)
        columns = CauseColumns.in_bank(view, each_axis(functions))
        for of in levels_that_differ(view, "unit", "common"):
            yield kernel("temperature", of, view, columns)


def _places(T: Floats, view: ResidualView) -> Iterator[Candidate]:
    """What switches at a temperature, or appears only near one: one number an axis, where a curve has many."""
    switches = [(np.quantile(T, q) < T).astype(float) for q in SWITCH_QUANTILES]
    bumps = [np.exp(-0.5 * ((T - np.quantile(T, q)) / (BUMP_SHARE * np.ptp(T))) ** 2) for q in BUMP_QUANTILES]
    for x in (*switches, *bumps):
        yield from kernels_at(view, "temperature/place", each_axis(x[:, None]), "unit", "common")


def _heated_by_pose(view: ResidualView) -> Iterator[Candidate]:
    """What each axis picks up from any other while the temperature changes: a flow of heat that turns with the part."""
    memory, rate = TemperatureMemory.of(view.scene), view.scene.temperature_rate
    if memory is None or rate is None:
        return
    a = view.nominal_stimulus
    for x in (np.sign(rate), (memory.temperature_degC - memory.lagged(LAG)) / memory.range_degC):
        if np.ptp(x) > 0:
            yield from kernels_at(view, "temperature*input", each_axis(a) * x[:, None, None], "unit", "common")


def _fading_by_pose(view: ResidualView) -> Iterator[Candidate]:
    """What each axis picks up from any other after power-on or clamping and loses with time: air that rises along a
    warm part."""
    a = view.nominal_stimulus
    for since in (view.scene.since_power_s, view.scene.since_clamp_s):
        if since is not None and np.ptp(since) > 0:
            fading = np.exp(-since / FADE_S)[:, None, None]
            yield from kernels_at(view, "time*input", each_axis(a) * fading, "unit", "common")
