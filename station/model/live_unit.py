"""One unit in one nest of the live simulation: its own errors, its share of the causes, its random streams."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from station.domain.core.types import Floats, Frames, Labels
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.recipe import Recipe
from station.model.effect import BusEffect, ClockEffect, Effect, random_stream
from station.model.forward import ActiveEffect, ActiveEffects, BaseResponse
from station.model.noise import flicker_at
from station.model.scene import Scene
from station.model.simulate import SimulationJob
from station.model.timeline import run_timeline
from station.model.visit_table import VisitTable, on_turned_base, visit_table

#: Flicker of a live unit comes again after this time.
FLICKER_SPAN_S = 3600.0

#: A fault of the bus, the fraction of frames it hits, and its random stream.
FrameFault = tuple[BusEffect, float, np.random.Generator]


@dataclass(frozen=True, slots=True, eq=False)
class FixtureMove:
    """A move of the fixture: to which visit, when it left and arrived; motor: drive level of the line's motors there.

    plate (3, 3): how the plate came to rest, once known.
    """

    visit: PlannedVisit
    departs_s: float
    arrives_s: float
    motor: float = 0.0
    plate: Floats | None = None


class LiveUnit:
    """A unit that was clamped and powered. labels: nest, and station, lot, operator where known.

    The same seed, serial and place give the same coefficients as in a simulated campaign.
    """

    def __init__(self, job: SimulationJob, unit: str, labels: Mapping[str, str]) -> None:
        self.unit = unit
        self.base: BaseResponse = job.base((unit,))
        self.thermometer = random_stream(job.seed, "thermometer", unit)
        self._job = job
        self._labels = labels
        self._rng = random_stream(job.seed, "noise", unit)
        self._slow = job.noise.slow(FLICKER_SPAN_S, self._rng)
        self._planned = _planned(job.recipe, unit)
        self._drawn: dict[tuple[int, str], Floats] = {}
        self.rate_error, self._bus = _on_the_bus(job, unit)

    def delivered(self, frames: Frames) -> Frames:
        """The unit's frames as they arrive: payloads in the order of arrival, times still in order."""
        for effect, fraction, rng in self._bus:
            order = effect.apply(np.zeros(len(frames), int), np.full(len(frames), fraction), rng)
            frames = replace(frames[order], time_ns=frames.time_ns[np.sort(order)])
        return frames

    def noise(self, time_s: Floats) -> Floats:
        """Noise (n, 3) of the next samples, time_s (n) from the start of the run."""
        white = self._job.noise.white(len(time_s), self._job.recipe.device.rate_hz, self._rng)
        return np.asarray(white + flicker_at(self._slow, time_s))

    def visits(self, went: Sequence[FixtureMove]) -> VisitTable:
        """The visits of this run so far, for this unit, with the plate where it came to rest."""
        recipe = self._job.recipe
        planned = [w.visit for w in went]
        zero = np.zeros(len(planned), np.int32)
        labels = {name: Labels((text,), zero) for name, text in self._labels.items()}
        labels |= {
            "position": Labels.of([p.position for p in planned]),
            "seating": Labels.of([p.seating for p in planned]),
        }
        run, visit = (np.array([getattr(p, key) for p in planned], np.int32) for key in ("run", "visit"))
        visits = visit_table(recipe, Labels((self.unit,), zero), run, visit, labels)
        if recipe.reference.source == "rate":
            return visits
        rested = np.array([w.visit.nest if w.plate is None else w.plate for w in went])
        return replace(visits, nest_R=on_turned_base(recipe, run, rested))

    def active(self, scene: Scene) -> ActiveEffects:
        """The causes at work on this unit."""
        acting = {f"model-{i}": a for i, a in enumerate(self._model_effects(scene))}
        for i, effect in enumerate(self._job.effects):
            of = effect.of[0]
            c = np.array([self._coefficients(i, effect, name) for name in scene.group(of)[1]])
            acting[f"asked-{i}"] = ActiveEffect(effect, c, of)
        return acting

    def _model_effects(self, scene: Scene) -> list[ActiveEffect]:
        return [a for listed in self._job.model_effects for a in listed.acting(scene, self._job.seed)]

    def _coefficients(self, i: int, effect: Effect, name: str) -> Floats:
        """Coefficients (axes) of one group; those of planned visits are drawn together, as a campaign draws them."""
        if (i, name) not in self._drawn:
            together = self._planned.get(name.partition(":")[0], ())
            names = together if name in together else (*together, name)
            drawn = effect.coefficients(names, self._job.seed)
            self._drawn.update({(i, n): c for n, c in zip(names, drawn, strict=True)})
        return self._drawn[i, name]


def _on_the_bus(job: SimulationJob, unit: str) -> tuple[float, list[FrameFault]]:
    """Relative error of a unit's clock, and what the bus does to its frames."""
    scene = Scene.of_units(job.recipe, (unit,))
    rate, faults = np.ones(1), []
    for acting in job.active(scene, ClockEffect).values():
        if isinstance(acting.effect, ClockEffect):
            rate = acting.effect.apply(rate, acting.by_visit(scene))
    for acting in job.active(scene, BusEffect).values():
        if isinstance(acting.effect, BusEffect):
            rng = random_stream(job.seed, acting.effect.id, "frames", unit)
            faults.append((acting.effect, float(acting.by_visit(scene)[0, 0]), rng))
    return float(rate[0]) - 1.0, faults


def _planned(recipe: Recipe, unit: str) -> dict[str, tuple[str, ...]]:
    """Names of the unit's planned runs and visits."""
    runs = range(len(recipe.runs))
    counts = [len(run_timeline(recipe, run).position) for run in runs]
    visits = (f"visit:{unit}/{run}/{v}" for run in runs for v in range(counts[run]))
    return {"run": tuple(f"run:{unit}/{run}" for run in runs), "visit": tuple(visits)}
