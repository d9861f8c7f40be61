"""What a cause is. One cause is one frozen value in one file; the forward simulation adds them up (`forward.py`).

    Effect
    ├── ClockEffect     CLOCK     the device's true sample rate, before any sample exists
    ├── PoseEffect      POSE      turns a part: rotation vectors (v, 3) in its frame
    ├── StimulusEffect  STIMULUS  adds to the true vector a (n, 3) that the sensor feels
    ├── SensorEffect    SENSOR    adds to the reading, given the true vector
    ├── GoldEffect      GOLD      adds to the reading of the gold reference, in the nest's frame
    ├── OutputEffect    OUTPUT    makes a new reading of a reading: saturation, grid, decoding
    └── BusEffect       TABLE     loses, repeats or reorders frames

Axes x, y, z are those of the reading unless the effect says a frame. A coefficient at `parameter.neutral` does nothing.
"""

import hashlib
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats
from station.domain.recipe import sensor
from station.domain.recipe.recipe import Recipe
from station.errors import UsageError
from station.model.scene import Scene, Signal

XYZ = ("x", "y", "z")
SINGLE_COEFFICIENT = ("",)
_U = re.compile(r"(?<![A-Za-z])u(?![A-Za-z])")


class EffectStage(StrEnum):
    """Where in the chain from clock to bus a cause acts."""

    CLOCK = "clock"
    POSE = "pose"
    STIMULUS = "stimulus"
    SENSOR = "sensor"
    GOLD = "gold"
    OUTPUT = "output"
    TABLE = "table"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a cause. In `unit`, u stands for the recipe's unit; sizes hold where u is g.

    typical: the usual size; low, high: the range met in practice; source: where these come from; neutral: does
    nothing; grid: for a parameter of the form, the values a diagnosis scans.
    """

    name: str
    unit: str
    typical: float
    low: float
    high: float
    source: str
    neutral: float = 0.0
    grid: tuple[float, ...] = ()

    @property
    def field(self) -> str:
        """The field that holds it: the name with its unit, time_constant_s; the name alone of a pure number."""
        unit = self.unit if self.unit == "degC" else self.unit.lower()
        return f"{self.name}_{unit}" if unit else self.name

    def unit_in(self, unit: str) -> str:
        """The unit's text in a recipe's unit: u/degC becomes g/degC."""
        return unit_in(self.unit, unit)

    def scale(self, recipe: Recipe) -> float:
        """What a size given for 1 g is multiplied by in this recipe: its stimulus, to the power that u has."""
        above, _, below = self.unit.partition("/")
        power = bool(_U.search(above)) - bool(_U.search(below)) * (2 if "²" in below else 1)
        return float(stimulus_strength(recipe) ** power) if power else 1.0


def unit_in(text: str, unit: str) -> str:
    """A unit's text with u replaced by the recipe's unit."""
    return _U.sub(unit, text)


def stimulus_strength(recipe: Recipe) -> float:
    """Size of the recipe's stimulus in its unit: the magnitude, or the fastest of its rates."""
    rates = [float(np.linalg.norm(p.rate)) for p in recipe.positions if p.rate is not None]
    return max(rates, default=0.0) or recipe.reference.strength()


def random_stream(seed: int, *key: object) -> np.random.Generator:
    """The random numbers that belong to `key` alone, so that removing one cause leaves all others as they were."""
    digest = hashlib.blake2b("/".join(map(str, (seed, *key))).encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))


class Coefficient(NamedTuple):
    """One column of a cause's coefficients as the documents write it; axis "" is none."""

    name: str
    axis: str
    unit: str


#: What a cause may be drawn over in a report; `reporting/diagnosis/cause_axis.py` makes the axis of each.
DrawnOver = Literal[
    "clock", "dwell", "expected", "group", "input", "input-product", "motor", "order", "other-axis", "position", "run",
    "samples", "since-clamp", "since-power", "spectrum", "step", "temperature", "temperature-input", "temperature-rate",
    "time", "unit", "visits",
]  # fmt: skip


@dataclass(frozen=True)
class Effect(ABC):
    """A cause. Fields are its parameters: `size` (rms of its coefficients) and those of its form, units in names.

    id: from the file's name; physics: one sentence; remedy: what to do on the line; shown_by: the change of a recipe
    that shows it where another hides it; drawn_over: what its residual is drawn against; separated_by: pairs of
    another cause's id and what would tell the two apart where no run of a recipe does; pose_free: whether it changes
    the length of a reading, so that visits of unknown pose show it; level: device, rig or bus; of: who shares one
    coefficient (the first is simulated, the others are tried too); axes: one coefficient each; needs: covariates
    without which it cannot be seen; forms: the parameters besides `size`; quantities: what a sensor that can feel it
    measures, empty for any.
    """

    size: float

    id: ClassVar[str]
    physics: ClassVar[str]
    remedy: ClassVar[str]
    shown_by: ClassVar[str]
    drawn_over: ClassVar[DrawnOver]
    separated_by: ClassVar[tuple[tuple[str, str], ...]] = ()
    pose_free: ClassVar[bool] = True
    stage: ClassVar[EffectStage]
    level: ClassVar[Literal["device", "rig", "bus"]]
    of: ClassVar[tuple[str, ...]]
    axes: ClassVar[tuple[str, ...]] = XYZ
    parameter: ClassVar[Parameter]
    forms: ClassVar[tuple[Parameter, ...]] = ()
    needs: ClassVar[tuple[str, ...]] = ()
    quantities: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls) -> None:
        cls.id = cls.__module__.rsplit(".", 1)[-1].replace("_", "-")

    @classmethod
    def example(cls) -> Self:
        """This cause at its typical size, in a recipe whose stimulus is 1."""
        return cls(cls.parameter.typical)

    @classmethod
    def acts_on(cls, recipe: Recipe) -> bool:
        """Whether the recipe's sensor can feel it."""
        return not cls.quantities or sensor.of(recipe).quantity in cls.quantities

    @property
    def columns(self) -> tuple[Coefficient, ...]:
        """What each column of its coefficients is, u for the recipe's unit."""
        return tuple(Coefficient(self.parameter.name, axis, self.parameter.unit) for axis in self.axes)

    @classmethod
    def read_size(cls, text: str, unit: str = "u") -> float:
        """The size a person wrote, in a recipe's unit; UsageError when it is none."""
        try:
            size = float(text)
        except ValueError:
            size = float("nan")
        if not np.isfinite(size):
            example = f"{cls.id}={cls.parameter.typical:g} ({cls.parameter.unit_in(unit)})"
            raise UsageError("effect-size", effect=cls.id, text=text[:40], example=example)
        return size

    def draw(self, groups: int, rng: np.random.Generator) -> Floats:
        """Coefficients (groups, axes) of random direction whose rms over the axes is `size` in every group."""
        z = rng.standard_normal((groups, len(self.axes)))
        return np.asarray(self.size * z / np.sqrt(np.mean(z**2, axis=1, keepdims=True)))

    def coefficients(self, names: Sequence[str], seed: int) -> Floats:
        """Coefficients (groups, axes) of the named groups, each from its own random stream.

        A single coefficient that everybody shares is exactly `size`, sign included.
        """
        if tuple(names) == ("common",) and len(self.axes) == 1:
            return np.full((1, 1), self.size)
        return np.concatenate([self.draw(1, random_stream(seed, self.id, name)) for name in names])

    def with_drawn_form(self, recipe: Recipe, seed: int) -> Self:
        """This cause with the parameters of its form drawn for a recipe; most have them fixed already."""
        del recipe, seed
        return self

    def draw_hits(self, names: Sequence[str], seed: int, share: float) -> Array:
        """Which of the groups (groups) a rare cause hits: about `share` of them, and at least one."""
        chance = np.array([random_stream(seed, self.id, "pick", name).uniform() for name in names])
        return np.asarray(chance < max(share, chance.min() * 1.000001))

    def gather(self, scene: Scene, coefficients: Floats, level: str) -> Floats:
        """Coefficients of each visit (v, axes), from those of the groups of `level` (groups, axes)."""
        return np.asarray(coefficients[scene.codes(level)])

    def gather_alike(self, scene: Scene, coefficient: Floats, level: str) -> Floats:
        """Coefficients of each row (n, axes) where those of all groups of `level` are the same (axes)."""
        del level
        return np.broadcast_to(coefficient, (len(scene.visit), len(coefficient)))

    def value_of(self, coefficient: float) -> float | str:
        """The coefficient as the documents write it."""
        return float(coefficient)

    def size_of(self, coefficients: Floats) -> float:
        """The size (rms) that coefficients (groups, columns) speak of."""
        return float(np.sqrt(np.mean(coefficients**2)))

    @property
    def form_parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the form that this very value has something to say about."""
        return self.forms

    def parameter_rows(self, names: Sequence[str], coefficients: Floats, unit: str) -> list[dict[str, object]]:
        """The parameters that do something, as the documents write them: {name, axis, of, value, unit}; the form's
        last."""
        rows: list[dict[str, object]] = [
            {
                "name": column.name, "axis": column.axis or None, "of": of, "value": self.value_of(c),
                "unit": unit_in(column.unit, unit),
            }
            for of, row in zip(names, coefficients, strict=True)
            for column, c in zip(self.columns, row, strict=True)
            if c != self.parameter.neutral
        ]  # fmt: skip
        return rows + [
            {"name": f.name, "axis": None, "of": "common", "value": getattr(self, f.field), "unit": f.unit_in(unit)}
            for f in self.form_parameters
        ]


@dataclass(frozen=True)
class ClockEffect(Effect):
    """Changes the rate at which the device samples."""

    stage: ClassVar[EffectStage] = EffectStage.CLOCK

    @abstractmethod
    def apply(self, rate_hz: Floats, c: Floats) -> Floats:
        """New rates (u) of the units, given the nominal ones and the units' coefficients (u, axes)."""


@dataclass(frozen=True)
class PoseEffect(Effect):
    """Turns a part by a rotation vector (rad, right-handed) in `frame`."""

    stage: ClassVar[EffectStage] = EffectStage.POSE
    pose_free: ClassVar[bool] = False
    frame: ClassVar[Literal["device", "nest", "station"]]

    def apply(self, c: Floats) -> Floats:
        """Rotation vectors (v, 3) in rad from the visits' coefficients (v, axes); axes not listed do not turn."""
        turned = np.zeros((len(c), 3))
        turned[:, [XYZ.index(axis) for axis in self.axes]] = c
        return turned


@dataclass(frozen=True)
class StimulusEffect(Effect):
    """Adds to what the sensor truly feels."""

    stage: ClassVar[EffectStage] = EffectStage.STIMULUS

    @abstractmethod
    def apply(self, signal: Signal, c: Floats) -> Floats:
        """Addition (n, 3) to the true vector; signal is at rest; c (n, axes) are the rows' coefficients."""


@dataclass(frozen=True)
class SensorEffect(Effect):
    """Adds to what the sensor reads. Every one is given the same true vector, so their order does not matter."""

    stage: ClassVar[EffectStage] = EffectStage.SENSOR

    @abstractmethod
    def apply(self, signal: Signal, c: Floats) -> Floats:
        """Addition (n, 3) to the reading; c (n, axes) are the rows' coefficients."""


@dataclass(frozen=True)
class GoldEffect(Effect):
    """Adds to what the gold reference reads."""

    stage: ClassVar[EffectStage] = EffectStage.GOLD
    pose_free: ClassVar[bool] = False

    @abstractmethod
    def apply(self, c: Floats) -> Floats:
        """Addition (v, 3) to the gold reading of each visit, in the nest's frame; c (v, axes)."""


@dataclass(frozen=True)
class OutputEffect(Effect):
    """Makes a new reading of a reading. They act in the order of `place`: converter first, decoding last."""

    stage: ClassVar[EffectStage] = EffectStage.OUTPUT
    place: ClassVar[int]

    @abstractmethod
    def apply(self, reading: Floats, c: Floats) -> Floats:
        """The new reading (n, 3); c (n, axes) are the rows' coefficients."""

    def coefficients(self, names: Sequence[str], seed: int) -> Floats:
        """Exactly `size` for everyone: these faults have a value, not a spread."""
        del seed
        return np.full((len(names), len(self.axes)), self.size)


@dataclass(frozen=True)
class BusEffect(Effect):
    """Changes which frames arrive, and in which order. `size` is the fraction of frames it hits."""

    stage: ClassVar[EffectStage] = EffectStage.TABLE
    level = "bus"
    of = ("unit",)
    axes = SINGLE_COEFFICIENT

    @abstractmethod
    def apply(self, block: NDArray[np.int_], fraction: Floats, rng: np.random.Generator) -> NDArray[np.int_]:
        """Indices of the sent frames in the order of arrival.

        block (n): frames of one number follow each other without a pause; fraction (n) hit, 0 … 1.
        """

    def coefficients(self, names: Sequence[str], seed: int) -> Floats:
        """Exactly `size` for everyone."""
        del seed
        return np.full((len(names), 1), self.size)
