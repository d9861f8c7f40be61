"""The bench that the data show: how it warms after power-on, and how long before a run units have power and clamp.

It warms as one exponential, and where it was measured by so much more or less as the course of the temperature says: a
cause that follows the rate of that course would else be told from one of the time alone by the error of a fit.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from station.domain.core.types import Floats
from station.model.scene import Scene
from station.model.simulated_line import SimulatedLine

#: Time constants of self-heating that are tried, s.
HEATING_TAUS_S = (100.0, 200.0, 400.0, 800.0, 1600.0)
#: How far a room may have moved within a run, degC: what a short run warms by says no more of the heating than that.
ROOM_DRIFT_DEGC = 0.02


#: Times since power-on that are this close are one, s.
SAME_TIME_S = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class WarmingBench:
    """How a bench warms: line, one exponential; beside which at since_power_s (k), ascending, it warms faster by
    more_degC_s (k), and by less the further it is from these. goes_on: whether it warms on as fast as at the last of
    these, as a room does that drifts."""

    line: SimulatedLine = field(default_factory=SimulatedLine)
    since_power_s: Floats = field(default_factory=lambda: np.zeros(0))
    more_degC_s: Floats = field(default_factory=lambda: np.zeros(0))
    goes_on: bool = False

    @property
    def fastest_degC_s(self) -> float:
        """The largest rate, of either sign, at which it was seen to change; of none seen that of the exponential."""
        return float(np.max(np.abs(self._rates())))

    def warmed_degC(self, since_power_s: Floats) -> Floats:
        """By how much it is warmer than its room (n), so long after power-on; at the first time measured by as much as
        the exponential says."""
        known, more = self.since_power_s, self.more_degC_s
        if not len(known):
            return self._exponential(since_power_s)
        if self.goes_on and np.any(since_power_s > known[-1]):
            seen, late = np.minimum(since_power_s, known[-1]), np.maximum(since_power_s - known[-1], 0.0)
            return np.asarray(self.warmed_degC(seen) + float(self._rates()[-1]) * late)
        within = np.r_[0.0, np.cumsum(np.diff(known) * (more[1:] + more[:-1]) / 2)]
        before, after = (np.maximum(x, 0.0) for x in (known[0] - since_power_s, since_power_s - known[-1]))
        tau = self.line.heating_tau_s
        ends = more[-1] * (1 - np.exp(-after / tau)) - more[0] * (1 - np.exp(-before / tau))
        return np.asarray(self._exponential(since_power_s) + np.interp(since_power_s, known, within) + tau * ends)

    def _exponential(self, since_power_s: Floats) -> Floats:
        return np.asarray(self.line.heating_degC * (1 - np.exp(-since_power_s / self.line.heating_tau_s)))

    def _rates(self) -> Floats:
        """How fast it was seen to warm (k), degC/s; of none seen the exponential's at the beginning of a run (1)."""
        line, since = self.line, self.since_power_s if len(self.since_power_s) else np.array([self.line.power_lead_s])
        rate = line.heating_degC / line.heating_tau_s * np.exp(-since / line.heating_tau_s)
        return np.asarray(rate + (self.more_degC_s if len(self.more_degC_s) else 0.0))


def warming_bench_of(scene: Scene) -> WarmingBench:
    """The bench of visits, one row each, with what the course of the temperature shows beside its exponential."""
    line = bench_of(scene)
    since, rate = scene.since_power_s, scene.temperature_rate
    if since is None or rate is None:
        return WarmingBench(line)
    more = rate - line.heating_degC / line.heating_tau_s * np.exp(-since / line.heating_tau_s)
    _, at = np.unique(np.round(since / SAME_TIME_S), return_inverse=True)
    count = np.bincount(at)
    return WarmingBench(line, np.bincount(at, since) / count, np.bincount(at, more) / count)


def bench_of(scene: Scene) -> SimulatedLine:
    """An ordinary bench with what the recorded covariates say of this one."""
    line = SimulatedLine()
    if scene.since_power_s is not None:
        lead = scene.since_power_s - scene.time_s
        cold = lead < float(lead.min()) + 1.0
        line = replace(line, power_lead_s=max(float(np.median(lead[cold])), 0.0))
        if scene.temperature_degC is not None:
            line = _with_heating(line, scene, scene.since_power_s, scene.temperature_degC)
    if scene.temperature_degC is not None:
        line = replace(line, room_degC=_room_degC(line, scene, scene.temperature_degC))
    if scene.since_clamp_s is not None:
        line = replace(line, clamp_lead_s=max(float(np.median(scene.since_clamp_s - scene.time_s)), 0.0))
    return line


def _with_heating(line: SimulatedLine, scene: Scene, since_power_s: Floats, temperature_degC: Floats) -> SimulatedLine:
    """T = T_run + H·(1 − e^(−t/τ)), t since power-on. H is that of an ordinary bench, and uncertain by as much, before
    the readings; H and log τ are means over what they then leave likely. A short run, which any τ fits, has none of
    the extreme ones."""
    run = scene.codes("run")[scene.visit]
    count = np.maximum(np.bincount(run), 1)

    def within(x: Floats) -> Floats:
        return np.asarray(x - (np.bincount(run, x) / count)[run])

    y, prior = within(temperature_degC), 1 / line.heating_degC**2
    fits = []
    for tau in HEATING_TAUS_S:
        x = within(1 - np.exp(-since_power_s / tau))
        # Rows of one visit err together.
        weight = len(scene.visits) / len(y)
        alone = y - x * float(x @ y) / max(float(x @ x), 1e-12)
        error = max(float(alone @ alone) / len(y), ROOM_DRIFT_DEGC**2)
        size = (weight * float(x @ y) / error + line.heating_degC * prior) / (weight * float(x @ x) / error + prior)
        off = weight * float(np.sum((y - size * x) ** 2)) / error + (size - line.heating_degC) ** 2 * prior
        fits.append((-0.5 * (off + len(scene.visits) * np.log(error)), size, np.log(tau)))
    nats, sizes, logs = (np.array(column) for column in zip(*fits, strict=True))
    likely = np.exp(nats - nats.max())
    size, tau = float(np.average(sizes, weights=likely)), float(np.exp(np.average(logs, weights=likely)))
    return replace(line, heating_degC=max(size, 0.0), heating_tau_s=tau)


def _room_degC(line: SimulatedLine, scene: Scene, temperature_degC: Floats) -> float:
    """The room in which a bench that warms so has the mean temperature measured."""
    runs = scene.recipe.runs
    offsets = np.array([run.temperature_offset_degC for run in runs])[scene.codes("run-of-recipe")[scene.visit]]
    powered = scene.time_s + line.power_lead_s if scene.since_power_s is None else scene.since_power_s
    heated = line.heating_degC * (1 - np.exp(-powered / line.heating_tau_s))
    return float(np.mean(temperature_degC - offsets - heated))
