"""A whole campaign out of nothing: recipe, units, causes and a seed → the samples table, and the truth about it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np

from station import plugins
from station.domain.core.types import Floats, SampleTable
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError
from station.model import record
from station.model.campaign import campaign_of
from station.model.effect import ClockEffect, Effect, GoldEffect, stream, strength
from station.model.forward import Acting, Active, Base, convert, feel, read
from station.model.line import Line
from station.model.model_file import EFFECTS, Model, ModelEffect
from station.model.noise import Noise
from station.model.scene import Scene, Signal
from station.model.timeline import Batch, density_of

#: Spread of good units, as parts of the stimulus: ±25 mg and 1 % (ADXL355: ±25 mg typical, ±8 % at most).
OFFSET_STD, GAIN_STD = 0.025, 0.01
#: Flicker rms as a part of the white density: a twentieth of what a dwell of a second averages to.
FLICKER = 0.035
#: Samples of one part of a fleet: enough to be fast, few enough for its arrays to stay near the processor.
PORTION = 100_000


@dataclass(frozen=True, slots=True)
class Job:
    """What to simulate. units: serials; gold: whether to write the gold's columns though the recipe asks for none.

    A cause among `effects` takes the place of the model's of the same id: it is there once, with its whole size.
    """

    recipe: Recipe
    units: tuple[str, ...]
    seed: int
    effects: tuple[Effect, ...] = ()
    model: Model = field(default_factory=Model)
    line: Line = field(default_factory=Line)
    gold: bool = False

    @property
    def causes(self) -> tuple[Effect, ...]:
        """The causes of the model, and those asked for."""
        return (*(told.build() for told in self.learnt), *self.effects)

    @property
    def learnt(self) -> tuple[ModelEffect, ...]:
        """The causes of the model that are not asked for by name."""
        asked = {effect.id for effect in self.effects}
        return tuple(told for told in self.model.effects if told.effect not in asked)

    @property
    def wants_gold(self) -> bool:
        """Whether the gold reference is read."""
        needed = any(isinstance(effect, GoldEffect) for effect in self.causes)
        return self.gold or needed or self.recipe.reference.source == "gold"

    @property
    def noise(self) -> Noise:
        """Noise of the units."""
        said = self.model.noise
        density = density_of(self.recipe) if said.density is None else said.density
        return Noise(density, FLICKER * density if said.flicker is None else said.flicker)

    def base(self, units: Sequence[str]) -> Base:
        """Offset and gain of each unit, from its own random stream."""
        said, size = self.model.spread, strength(self.recipe)
        offset_std = OFFSET_STD * size if said.offset_std is None else said.offset_std
        gain_std = GAIN_STD if said.gain_std is None else said.gain_std
        std = np.where(np.eye(3) > 0, gain_std, said.cross_std or 0.0)
        draws = np.array([stream(self.seed, "unit", name).standard_normal(12) for name in units])
        return Base(offset_std * draws[:, :3], np.eye(3) + std * draws[:, 3:].reshape(-1, 3, 3))

    def active(self, scene: Scene, kind: type[Effect] = Effect) -> dict[str, Acting]:
        """The causes of a kind at work in a scene: those of the model, and those asked for."""
        told = [a for told in self.learnt for a in told.acting(scene, self.seed)]
        acting = [a for a in told if isinstance(a.effect, kind)]
        for effect in self.effects:
            if isinstance(effect, kind):
                of = effect.of[0]
                acting.append(Acting(effect, effect.coefficients(scene.group(of)[1], self.seed), of))
        return {f"{i}/{a.effect.id}": a for i, a in enumerate(acting)}

    def settled(self) -> "Job":
        """The same job, the form of every cause drawn."""
        return replace(self, effects=tuple(e.settled(self.recipe, self.seed) for e in self.effects))


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """What was made of what: serials and base of the units, the groups' coefficients, and every sample's conditions."""

    units: tuple[str, ...]
    base: Base
    active: Active
    scene: Scene


@dataclass(frozen=True, slots=True, eq=False)
class Simulated(Made):
    """A simulated campaign as a samples table."""

    table: SampleTable


def effect_of(name: str, recipe: Recipe, size: str | None = None) -> Effect:
    """A cause by id, in the recipe's unit; size as a person wrote it, or the typical one scaled to the stimulus.

    UsageError names the known ids, a size that is none, and a cause that this recipe's sensor cannot feel.
    """
    known = plugins.names(EFFECTS)
    if name not in known:
        near = " or ".join(get_close_matches(name, known, 2, 0.0))
        raise UsageError(f"there is no effect {name[:40]!r}; the nearest are {near}, and `station effects` lists all")
    kind: type[Effect] = plugins.load(EFFECTS, name)
    if recipe.sensor not in kind.sensors:
        raise UsageError(f"{name} cannot act on a {recipe.sensor}, only on {' or '.join(kind.sensors)}; leave it out")
    if size is not None:
        return replace(kind.example(), size=kind.read_size(size, recipe.unit))
    example = kind.example()
    return replace(example, size=example.size * kind.parameter.scale(recipe))


def effects_of(asked: Sequence[str], recipe: Recipe) -> tuple[Effect, ...]:
    """Causes as a person asks for them, ID or ID=SIZE; UsageError also for one that is asked for twice."""
    pairs = [text.partition("=") for text in asked]
    names = [name for name, _, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise UsageError(f"effect {name} is asked for {names.count(name)} times; say it once, with its whole size")
    return tuple(effect_of(name, recipe, size if equals else None) for name, equals, size in pairs)


def simulate(job: Job) -> Simulated:
    """All units of a job at once."""
    return part(job.settled(), Batch(job.units))


def parts(job: Job, units: int | None = None) -> Iterator[Simulated]:
    """The same in parts of so many units (left out: of about PORTION samples), so that a fleet need not fit into
    memory; the samples are the same too."""
    job = job.settled()
    together = max(PORTION // _samples_of_a_unit(job), 1) if units is None else units
    for first in range(0, len(job.units), together):
        yield part(job, Batch(job.units[first : first + together], first, len(job.units)))


def _samples_of_a_unit(job: Job) -> int:
    """About how many samples the plan has for each unit."""
    campaign = campaign_of(job.recipe, job.units[:1], job.seed, job.line)
    return max(round(float(campaign.dwell_s().sum()) * job.recipe.device.rate_hz), 1)


def part(job: Job, batch: Batch) -> Simulated:
    """Some units of a settled job."""
    rates = rates_of(job, batch)
    scene = campaign_of(job.recipe, batch, job.seed, job.line).dwells(rates)
    active, base = job.active(scene), job.base(batch.units)
    signal = feel(scene, active)
    table = record.table(scene, output(job, signal, base, active), rates, job.seed)
    if job.wants_gold:
        table = replace(table, gold=record.gold(signal, active, job.noise, job.seed))
    return Simulated(batch.units, base, active, scene, record.arrived(table, scene, active, job.seed))


def output(job: Job, signal: Signal, base: Base, active: Active) -> Floats:
    """What the devices put out (n, 3): readings with noise, by their data sheet, after converter and decoding."""
    reading = read(signal, base, active) + record.noise(signal.scene, job.noise, job.seed)
    return convert(signal.scene, by_sheet(job.recipe, reading), active)


def by_sheet(recipe: Recipe, reading: Floats) -> Floats:
    """The reading as a device that keeps its data sheet gives it: within its full scale, on its grid."""
    sheet = recipe.device
    if sheet.full_scale is not None:
        reading = np.clip(reading, -sheet.full_scale, sheet.full_scale)
    return np.asarray(np.round(reading / sheet.lsb) * sheet.lsb) if sheet.lsb > 0 else reading


def rates_of(job: Job, batch: Batch) -> Floats:
    """True sample rate of each unit (U), Hz: within half the clock's tolerance, unless a clock is off."""
    sheet = job.recipe.device
    within = np.array([stream(job.seed, "clock", name).uniform(-0.5, 0.5) for name in batch.units])
    rates = sheet.rate_hz * (1 + 1e-6 * sheet.clock_tolerance_ppm * within)
    if any(isinstance(effect, ClockEffect) for effect in job.causes):
        scene = Scene.of_units(job.recipe, batch.units)
        for acting in job.active(scene, ClockEffect).values():
            if isinstance(acting.effect, ClockEffect):
                rates = acting.effect.apply(rates, acting.by_visit(scene))
    return np.asarray(rates)
