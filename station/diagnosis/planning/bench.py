"""The bench that the data show: how it warms after power-on, and how long before a run units have power and clamp."""

from dataclasses import replace

import numpy as np

from station.domain.core.types import Floats
from station.model.scene import Scene
from station.model.simulated_line import SimulatedLine

#: Time constants of self-heating that are tried, s.
HEATING_TAUS_S = (100.0, 200.0, 400.0, 800.0, 1600.0)
#: Span of times since power-on below which the room's own drift decides what fits; an ordinary bench is taken then.
LEAST_SPAN_S = 300.0


def bench_of(scene: Scene) -> SimulatedLine:
    """An ordinary bench with what the recorded covariates say of this one."""
    line = SimulatedLine()
    if scene.since_power_s is not None:
        lead = scene.since_power_s - scene.time_s
        cold = lead < float(lead.min()) + 1.0
        line = replace(line, power_lead_s=max(float(np.median(lead[cold])), 0.0))
        if scene.temperature_degC is not None and float(np.ptp(scene.since_power_s)) > LEAST_SPAN_S:
            line = _with_heating(line, scene, scene.since_power_s, scene.temperature_degC)
    if scene.temperature_degC is not None:
        line = replace(line, room_degC=_room_degC(line, scene, scene.temperature_degC))
    if scene.since_clamp_s is not None:
        line = replace(line, clamp_lead_s=max(float(np.median(scene.since_clamp_s - scene.time_s)), 0.0))
    return line


def _with_heating(line: SimulatedLine, scene: Scene, since_power_s: Floats, temperature_degC: Floats) -> SimulatedLine:
    """T = T_run + H·(1 − e^(−t/τ)), t since power-on, by least squares; τ of those tried that fits best."""
    run = scene.codes("run")[scene.visit]
    count = np.maximum(np.bincount(run), 1)

    def within(x: Floats) -> Floats:
        return np.asarray(x - (np.bincount(run, x) / count)[run])

    y = within(temperature_degC)
    fits = []
    for tau in HEATING_TAUS_S:
        x = within(1 - np.exp(-since_power_s / tau))
        size = float(x @ y) / max(float(x @ x), 1e-12)
        fits.append((float(np.sum((y - size * x) ** 2)), size, tau))
    _, size, tau = min(fits)
    return replace(line, heating_degC=max(size, 0.0), heating_tau_s=tau)


def _room_degC(line: SimulatedLine, scene: Scene, temperature_degC: Floats) -> float:
    """The room in which a bench that warms so has the mean temperature measured."""
    runs = scene.recipe.runs
    offsets = np.array([run.temperature_offset_degC for run in runs])[scene.codes("run-of-recipe")[scene.visit]]
    powered = scene.time_s + line.power_lead_s if scene.since_power_s is None else scene.since_power_s
    heated = line.heating_degC * (1 - np.exp(-powered / line.heating_tau_s))
    return float(np.mean(temperature_degC - offsets - heated))
