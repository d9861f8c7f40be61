"""A whole campaign out of nothing: recipe, units, causes and a seed → the samples table, and the truth about it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np

from station import plugins
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError
from station.model import recording
from station.model.campaign import campaign_of
from station.model.effect import ClockEffect, Effect, GoldEffect, random_stream, stimulus_strength
from station.model.forward import (
    ActiveEffect,
    ActiveEffects,
    BaseResponse,
    convert_output,
    sensor_reading,
    sensor_signal,
)
from station.model.model_file import EFFECTS, Model, ModelEffect
from station.model.noise import Noise
from station.model.scene import Scene, Signal
from station.model.simulated_line import SimulatedLine
from station.model.timeline import FleetPart, noise_density_of

#: Spread of good units, as parts of the stimulus: ±25 mg and 1 % (ADXL355: ±25 mg typical, ±8 % at most).
OFFSET_STD, GAIN_STD = 0.025, 0.01
#: Flicker rms as a part of the white density: a twentieth of what a dwell of a second averages to.
FLICKER_RATIO = 0.035
#: Samples of one part of a fleet: enough to be fast, few enough for its arrays to stay near the processor.
SAMPLES_PER_PART = 100_000


@dataclass(frozen=True, slots=True)
class SimulationJob:
    """What to simulate. units: serials; gold: whether to write the gold's columns though the recipe asks for none.

    A cause among `effects` takes the place of the model's of the same id: it is there once, with its whole size.
    """

    recipe: Recipe
    units: tuple[str, ...]
    seed: int
    effects: tuple[Effect, ...] = ()
    model: Model = field(default_factory=Model)
    line: SimulatedLine = field(default_factory=SimulatedLine)
    gold: bool = False

    @property
    def causes(self) -> tuple[Effect, ...]:
        """The causes of the model, and those asked for."""
        return (*(listed.build() for listed in self.model_effects), *self.effects)

    @property
    def model_effects(self) -> tuple[ModelEffect, ...]:
        """The causes of the model that are not asked for by name."""
        requests = {effect.id for effect in self.effects}
        return tuple(listed for listed in self.model.effects if listed.effect not in requests)

    @property
    def needs_gold(self) -> bool:
        """Whether the gold reference is read."""
        needed = any(isinstance(effect, GoldEffect) for effect in self.causes)
        return self.gold or needed or self.recipe.reference.source == "gold"

    @property
    def noise(self) -> Noise:
        """Noise of the units."""
        stated = self.model.noise
        density = noise_density_of(self.recipe) if stated.density is None else stated.density
        return Noise(density, FLICKER_RATIO * density if stated.flicker is None else stated.flicker)

    def base(self, units: Sequence[str]) -> BaseResponse:
        """Offset and gain of each unit, from its own random stream."""
        stated, size = self.model.spread, stimulus_strength(self.recipe)
        offset_std = OFFSET_STD * size if stated.offset_std is None else stated.offset_std
        gain_std = GAIN_STD if stated.gain_std is None else stated.gain_std
        std = np.where(np.eye(3) > 0, gain_std, stated.cross_std or 0.0)
        draws = np.array([random_stream(self.seed, "unit", name).standard_normal(12) for name in units])
        return BaseResponse(offset_std * draws[:, :3], np.eye(3) + std * draws[:, 3:].reshape(-1, 3, 3))

    def active(self, scene: Scene, kind: type[Effect] = Effect) -> dict[str, ActiveEffect]:
        """The causes of a kind at work in a scene: those of the model, and those asked for."""
        listed = [a for listed in self.model_effects for a in listed.acting(scene, self.seed)]
        acting = [a for a in listed if isinstance(a.effect, kind)]
        for effect in self.effects:
            if isinstance(effect, kind):
                of = effect.of[0]
                acting.append(ActiveEffect(effect, effect.coefficients(scene.group(of)[1], self.seed), of))
        return {f"{i}/{a.effect.id}": a for i, a in enumerate(acting)}

    def with_drawn_form(self) -> "SimulationJob":
        """The same job, the form of every cause drawn."""
        return replace(self, effects=tuple(e.with_drawn_form(self.recipe, self.seed) for e in self.effects))


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedUnits:
    """What was made of what: serials and base of the units, the groups' coefficients, and every sample's conditions."""

    units: tuple[str, ...]
    base: BaseResponse
    active: ActiveEffects
    scene: Scene


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedCampaign(SimulatedUnits):
    """A simulated campaign as a samples table."""

    table: SampleTable


def parse_effect(name: str, recipe: Recipe, size: str | None = None, form: Mapping[str, str] | None = None) -> Effect:
    """A cause by id, in the recipe's unit; size as a person wrote it, or the typical one scaled to the stimulus; form:
    parameters of its form by name, such as degree or time_constant_s.

    UsageError names the known ids, a size that is none, and a cause that this recipe's sensor cannot feel.
    """
    known = plugins.names(EFFECTS)
    if name not in known:
        raise UsageError("effect-unknown", name=name[:40], nearest=get_close_matches(name, known, 2, 0.0))
    kind: type[Effect] = plugins.load(EFFECTS, name)
    if not kind.acts_on(recipe):
        raise UsageError("effect-sensor", effect=name, sensor=recipe.sensor, quantities=kind.quantities)
    shaped = _with_form(kind.example(), form or {})
    if size is not None:
        return replace(shaped, size=kind.read_size(size, recipe.unit))
    return replace(shaped, size=shaped.size * kind.parameter.scale(recipe))


def _with_form(effect: Effect, form: Mapping[str, str]) -> Effect:
    """The cause with parameters of its form as a person wrote them; within the range met in practice."""
    known = {name: p for p in effect.forms for name in (p.name, p.field)}
    found: dict[str, float] = {}
    for name, text in form.items():
        if name not in known:
            raise UsageError(
                "effect-form-name", effect=effect.id, name=name[:40], known=[p.field for p in effect.forms]
            )
        p = known[name]
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not (np.isfinite(value) and min(p.low, p.typical) <= value <= p.high):
            raise UsageError(
                "effect-form-value", effect=effect.id, name=p.field, text=text[:40], low=p.low, high=p.high
            )
        found[p.field] = type(getattr(effect, p.field))(value)
    return replace(effect, **found)


def parse_effects(requests: Sequence[str], recipe: Recipe) -> tuple[Effect, ...]:
    """Causes as a person asks for them, ID or ID=SIZE, each with parameters of its form behind commas
    (warm-up=5e-4,time_constant_s=60); UsageError also for one that is asked for twice."""
    pairs = [_split_request(text) for text in requests]
    names = [name for name, _, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise UsageError("effect-repeated", effect=name, count=names.count(name))
    return tuple(parse_effect(name, recipe, size, form) for name, size, form in pairs)


def _split_request(text: str) -> tuple[str, str | None, dict[str, str]]:
    """ID[=SIZE][,NAME=VALUE…] as id, size and form; a mapping such as -y,x,z is a size with commas."""
    first, *rest = text.split(",")
    name, equals, size = first.partition("=")
    sizes = [size, *(part for part in rest if "=" not in part)]
    form = dict(part.split("=", 1) for part in rest if "=" in part)
    return name, ",".join(sizes) if equals else None, form


def simulate(job: SimulationJob) -> SimulatedCampaign:
    """All units of a job at once."""
    return simulate_part(job.with_drawn_form(), FleetPart(job.units))


def simulate_in_parts(job: SimulationJob, units: int | None = None) -> Iterator[SimulatedCampaign]:
    """The same in parts of so many units (left out: of about PORTION samples), so that a fleet need not fit into
    memory; the samples are the same too."""
    job = job.with_drawn_form()
    together = max(SAMPLES_PER_PART // _samples_of_a_unit(job), 1) if units is None else units
    for first in range(0, len(job.units), together):
        yield simulate_part(job, FleetPart(job.units[first : first + together], first, len(job.units)))


def _samples_of_a_unit(job: SimulationJob) -> int:
    """About how many samples the plan has for each unit."""
    campaign = campaign_of(job.recipe, job.units[:1], job.seed, job.line)
    return max(round(float(campaign.dwell_s().sum()) * job.recipe.device.rate_hz), 1)


def simulate_part(job: SimulationJob, fleet_part: FleetPart) -> SimulatedCampaign:
    """Some units of a settled job."""
    rates = rates_of(job, fleet_part)
    scene = campaign_of(job.recipe, fleet_part, job.seed, job.line).dwells(rates)
    active, base = job.active(scene), job.base(fleet_part.units)
    signal = sensor_signal(scene, active)
    table = recording.samples_table(scene, device_output(job, signal, base, active), rates, job.seed)
    if job.needs_gold:
        table = replace(table, gold=recording.gold_readings(signal, active, job.noise, job.seed))
    return SimulatedCampaign(
        fleet_part.units, base, active, scene, recording.after_bus_faults(table, scene, active, job.seed)
    )


def device_output(job: SimulationJob, signal: Signal, base: BaseResponse, active: ActiveEffects) -> Floats:
    """What the devices put out (n, 3): readings with noise, by their data sheet, after converter and decoding."""
    reading = sensor_reading(signal, base, active) + recording.sensor_noise(signal.scene, job.noise, job.seed)
    return convert_output(signal.scene, by_data_sheet(job.recipe, reading), active)


def by_data_sheet(recipe: Recipe, reading: Floats) -> Floats:
    """The reading as a device that keeps its data sheet gives it: within its full scale, on its grid."""
    sheet = recipe.device
    if recipe.axes < 3:
        reading = np.where(np.arange(3) < recipe.axes, reading, 0.0)
    if sheet.full_scale is not None:
        reading = np.clip(reading, -sheet.full_scale, sheet.full_scale)
    return np.asarray(np.round(reading / sheet.lsb) * sheet.lsb) if sheet.lsb > 0 else reading


def rates_of(job: SimulationJob, fleet_part: FleetPart) -> Floats:
    """True sample rate of each unit (U), Hz: within half the clock's tolerance, unless a clock is off."""
    sheet = job.recipe.device
    within = np.array([random_stream(job.seed, "clock", name).uniform(-0.5, 0.5) for name in fleet_part.units])
    rates = sheet.rate_hz * (1 + 1e-6 * sheet.clock_tolerance_ppm * within)
    if any(isinstance(effect, ClockEffect) for effect in job.causes):
        scene = Scene.of_units(job.recipe, fleet_part.units)
        for acting in job.active(scene, ClockEffect).values():
            if isinstance(acting.effect, ClockEffect):
                c = acting.by_visit(scene)
                rates = acting.effect.apply(np.where(c[:, 0] == 0, rates, sheet.rate_hz), c)
    return np.asarray(rates)
