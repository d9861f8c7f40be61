"""The forward simulation: from visits and causes to readings. Pure, vectorised, exact and non-linear.

R = exp(Σ station) · nest_R · exp(Σ nest) · seat_R · exp(Σ device)      resting orientation of the sensor
a = Rᵀ · stimulus + Σ stimulus effects                                 what it feels
reading = M_u · a + b_u + Σ sensor effects(a)                          what it reads, before its converter
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.domain.core import rotation
from station.domain.core.types import Floats
from station.model.effect import Effect, GoldEffect, OutputEffect, PoseEffect, SensorEffect, StimulusEffect
from station.model.scene import Scene, Signal


class ActiveEffect(NamedTuple):
    """A cause at work: its coefficients (groups, axes), groups as `scene.group(of)` orders them."""

    effect: Effect
    coefficients: Floats
    of: str

    def by_visit(self, scene: Scene) -> Floats:
        """Coefficients of every visit (v, axes)."""
        return self.effect.gather(scene, self.coefficients, self.of)

    def by_row(self, scene: Scene) -> Floats:
        """Coefficients of every row (n, axes)."""
        return np.asarray(self.by_visit(scene)[scene.visit])


#: Which causes act; the key is the effect's id, or any other name where one effect acts at two levels.
ActiveEffects = Mapping[str, ActiveEffect]
NO_EFFECTS: ActiveEffects = {}


@dataclass(frozen=True, slots=True, eq=False)
class BaseResponse:
    """What is no defect: offset (U, 3) and matrix (U, 3, 3) of each unit, ordered as `visits.unit.names`."""

    offset: Floats
    matrix: Floats

    @staticmethod
    def ideal(units: int) -> "BaseResponse":
        """Units without any error."""
        return BaseResponse(np.zeros((units, 3)), np.tile(np.eye(3), (units, 1, 1)))


def forward(scene: Scene, base: BaseResponse, active: ActiveEffects = NO_EFFECTS) -> Floats:
    """Readings (n, 3) in the recipe's unit, before noise, converter and bus."""
    return sensor_reading(sensor_signal(scene, active), base, active)


def sensor_reading(signal: Signal, base: BaseResponse, active: ActiveEffects = NO_EFFECTS) -> Floats:
    """What the sensors read (n, 3) of what they feel."""
    scene = signal.scene
    unit = scene.visits.unit.code
    at_rest = np.einsum("vij,vj->vi", base.matrix[unit], signal.at_visit) + base.offset[unit]
    reading = np.asarray(at_rest[scene.visit])
    if signal.moving:
        moving = signal.true - signal.at_visit[scene.visit]
        reading += np.einsum("nij,nj->ni", base.matrix[unit][scene.visit], moving)
    for acting in active.values():
        if isinstance(acting.effect, SensorEffect):
            reading += acting.effect.apply(signal, acting.by_row(scene))
    return reading


def sensor_signal(scene: Scene, active: ActiveEffects = NO_EFFECTS) -> Signal:
    """What the sensors feel, at rest and with everything that still moves."""
    at_visit = resting_stimulus(scene, active)
    rest = Signal(scene, at_visit[scene.visit], at_visit)
    true = rest.true
    for acting in active.values():
        if isinstance(acting.effect, StimulusEffect):
            true = true + acting.effect.apply(rest, acting.by_row(scene))
    return Signal(scene, true, at_visit, moving=true is not rest.true)


def signal_during_moves(signal: Signal, moving: NDArray[np.bool_], plate: Floats) -> Signal:
    """The same, but rows where `moving` (n) are still on their way to their visit.

    plate (m, 3, 3): nest → station rotation of the positioner at those rows. What is felt at the visit is turned back
    by the rest of the way; a rate, which belongs to the table and not to its attitude, is left as it is.
    """
    scene, visits = signal.scene, signal.scene.visits
    if not moving.any() or scene.recipe.reference.source == "rate":
        return signal
    rows = scene.visit[moving]
    remaining_R = np.einsum("mji,mjk->mik", plate, visits.nest_R[rows])
    seated = np.einsum("mji,mjk,mkl->mil", visits.seat_R[rows], remaining_R, visits.seat_R[rows])
    recipe, true = scene.recipe, signal.true.copy()
    if recipe.converts:
        felt = _felt(scene, NO_EFFECTS, stimulus_in_nest(scene))[rows]
        true[moving] = recipe.perfect_reading(np.einsum("mij,mj->mi", seated, felt))
    else:
        true[moving] = np.einsum("mij,mj->mi", seated, true[moving])
    return replace(signal, true=true, moving=True)


def resting_stimulus(scene: Scene, active: ActiveEffects = NO_EFFECTS) -> Floats:
    """What each sensor feels at rest at each visit (v, 3), in the device's frame."""
    at_nest = (
        stimulus_in_nest(scene, active) if scene.visits.gold is None else scene.visits.gold - gold_error(scene, active)
    )
    return scene.recipe.perfect_reading(_felt(scene, active, at_nest))


def _felt(scene: Scene, active: ActiveEffects, at_nest: Floats) -> Floats:
    """The stimulus (v, 3) of the nests' frames in those of the devices."""
    seated = np.einsum("vji,vj->vi", scene.visits.seat_R, at_nest)
    return _turned_back(scene, active, "device", seated)


def stimulus_in_nest(scene: Scene, active: ActiveEffects = NO_EFFECTS) -> Floats:
    """The stimulus at rest at each visit (v, 3) in the frame of the nest, every tilt of the rig included."""
    stimulus = scene.visits.stimulus
    # A rate is given about the nest's axes: how the rig stands on its base does not matter to it.
    if scene.recipe.reference.source != "rate":
        stimulus = _turned_back(scene, active, "station", stimulus)
    return _turned_back(scene, active, "nest", np.einsum("vji,vj->vi", scene.visits.nest_R, stimulus))


def gold_error(scene: Scene, active: ActiveEffects) -> Floats:
    """What the gold reads too much at each visit (v, 3), in the frame of the nest."""
    error = np.zeros((len(scene.visits), 3))
    for acting in active.values():
        if isinstance(acting.effect, GoldEffect):
            error += acting.effect.apply(acting.by_visit(scene))
    return error


def convert_output(scene: Scene, reading: Floats, active: ActiveEffects) -> Floats:
    """The reading (n, 3) after the faults of converter and decoding, in the order of their places."""
    faults = [(a.effect, a.by_row(scene)) for a in active.values() if isinstance(a.effect, OutputEffect)]
    for effect, c in sorted(faults, key=lambda fault: fault[0].place):
        reading = effect.apply(reading, c)
    return reading


def signature(scene: Scene, base: BaseResponse, effect: Effect, of: str = "") -> list[Floats]:
    """`derivatives` with no other cause at work."""
    return list(derivatives(scene, base, effect, of))


def derivatives(
    scene: Scene,
    base: BaseResponse,
    effect: Effect,
    of: str = "",
    active: ActiveEffects = NO_EFFECTS,
    signal: Signal | None = None,
) -> Iterator[Floats]:
    """Derivative (n, 3) of `forward` by each axis' coefficient, all groups of level `of` at once: one array an axis.

    Central differences about zero, with a step of a tenth of the typical size. A coefficient acts on its own
    group's rows (of bias-walk: on the rest of the run too), so the caller splits the rows by group.
    of: one of effect.of, the first when left out; active: causes that are on beside this one; signal: what the sensors
    feel with them, where it is known already.
    """
    of = of or effect.of[0]
    h = 0.1 * effect.parameter.typical * effect.parameter.scale(scene.recipe)
    signal = sensor_signal(scene, active) if signal is None else signal
    rest = signal.at_rest
    for step in np.eye(len(effect.columns)) * h:
        if isinstance(effect, SensorEffect):
            # It adds to the reading: all else is the same on both sides.
            c = effect.gather_alike(scene, step, of)
            apart = effect.apply(signal, c) - effect.apply(signal, -c)
        elif isinstance(effect, StimulusEffect):
            both = (effect.gather_alike(scene, x, of) for x in (step, -step))
            felt = (replace(signal, true=signal.true + effect.apply(rest, c), moving=True) for c in both)
            apart = _difference(next(felt), next(felt), base, active)
        else:
            groups = len(scene.group(of)[1])
            acting = (ActiveEffect(effect, np.tile(x, (groups, 1)), of) for x in (step, -step))
            felt = (sensor_signal(scene, {**active, "?": one}) for one in acting)
            apart = _difference(next(felt), next(felt), base, active)
        apart /= 2 * h
        yield apart


def _difference(one: Signal, two: Signal, base: BaseResponse, active: ActiveEffects) -> Floats:
    """`read` (n, 3) of one signal less that of another, of the same scene."""
    unit, visit = one.scene.visits.unit.code, one.scene.visit
    if not (one.moving or two.moving):
        apart = np.einsum("vij,vj->vi", base.matrix[unit], one.at_visit - two.at_visit)[visit]
    elif np.any(base.matrix * (1 - np.eye(3))):
        apart = np.einsum("nij,nj->ni", base.matrix[unit[visit]], one.true - two.true)
    else:
        # Gains alone, as there are most often: a third of the numbers, and the same bits.
        apart = np.einsum("uii->ui", base.matrix)[unit].take(visit, axis=0) * (one.true - two.true)
    for acting in active.values():
        if isinstance(acting.effect, SensorEffect):
            c = acting.by_row(one.scene)
            apart += acting.effect.apply(one, c) - acting.effect.apply(two, c)
    return np.asarray(apart)


def _turned_back(scene: Scene, active: ActiveEffects, frame: str, vectors: Floats) -> Floats:
    """Vectors (v, 3) as seen from a frame that the pose effects of `frame` have turned."""
    turns = [
        acting.effect.apply(acting.by_visit(scene))
        for acting in active.values()
        if isinstance(acting.effect, PoseEffect) and acting.effect.frame == frame
    ]
    if not turns:
        return vectors
    return np.asarray(np.einsum("vji,vj->vi", rotation.from_vector(np.sum(turns, axis=0)), vectors))
