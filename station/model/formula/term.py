"""One term of a formula: coefficient · input · modulator, with the values of its constants and who shares it."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache

import numpy as np

from station.domain.core.types import Array, Floats
from station.errors import InputError
from station.model.formula.dimension import READING, Dimension
from station.model.formula.expression import Expression, Multiplication, constants, evaluate, size, variables
from station.model.formula.grammar import (
    BENT_ALIKE,
    CONSTANTS,
    INPUTS,
    LEAST_BEND_U,
    MODULATORS,
    SHARED_BY,
    Factor,
    FormulaColumn,
    columns_of,
)
from station.model.scene import Scene, Signal

#: What an axis feels beside others, where it is below this, is the rounding of its pose.
ROUNDING = 1e-9
#: Columns of the scene by the variable that they are.
COVARIATE_OF = {
    "T": "temperature_degC",
    "T_rate": "temperature_rate",
    "t": "time_s",
    "t_power": "since_power_s",
    "t_clamp": "since_clamp_s",
    "t_arrival": "since_arrival_s",
    "motor": "motor",
}


@dataclass(frozen=True, slots=True)
class Term:
    """A term. axes: labels of its coefficients; constants: pairs of field and value, in the recipe's unit.

    InputError names what the grammar does not know, what is missing, or out of range.
    """

    input: str
    modulator: str
    axes: tuple[str, ...]
    of: str = "unit"
    constants: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        for key, value, known in (
            ("input", self.input, INPUTS),
            ("modulator", self.modulator, MODULATORS),
            ("of", self.of, SHARED_BY),
        ):
            if value not in known:
                raise InputError("formula-unknown", key=key, name=value[:40], names=tuple(known))
        if INPUTS[self.input].frame and self.modulator != "constant":
            raise InputError("formula-turn-modulated", name=self.input)
        labels = [c.label for c in columns_of(INPUTS[self.input], MODULATORS[self.modulator])]
        wrong = [a for a in self.axes if a not in labels]
        if wrong or not self.axes or len(set(self.axes)) < len(self.axes):
            raise InputError("formula-axes", axes=tuple(a[:40] for a in self.axes), names=tuple(labels))
        self._check_constants()

    def _check_constants(self) -> None:
        needed, given = self.fields, [field for field, _ in self.constants]
        if sorted(needed) != sorted(given):
            raise InputError("formula-constants", needed=needed or ("none",), given=tuple(given) or ("none",))
        for field, value in self.constants:
            low, high = self.range_of(field)
            if not (np.isfinite(value) and low <= value <= high):
                raise InputError("formula-constant-range", field=field, value=value, low=low, high=high)

    def range_of(self, field: str) -> tuple[float, float]:
        """Least and largest value of a constant."""
        kind = CONSTANTS[field]
        return LEAST_BEND_U if field == "bend_u" and self.input in BENT_ALIKE else kind.low, kind.high

    @property
    def factors(self) -> tuple[Factor, Factor]:
        """Input and modulator."""
        return INPUTS[self.input], MODULATORS[self.modulator]

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields of its constants."""
        return tuple(dict.fromkeys(c for f in self.factors for c in constants(f.tree)))

    @property
    def family(self) -> tuple[str, str]:
        """Input and modulator: what it is apart from its numbers, its axes and who shares it."""
        return self.input, self.modulator

    @property
    def columns(self) -> tuple[FormulaColumn, ...]:
        """Its coefficients."""
        every = {c.label: c for c in columns_of(*self.factors)}
        return tuple(every[label] for label in self.axes)

    @property
    def is_whole(self) -> bool:
        """Whether every axis has its coefficient."""
        return len(self.axes) == len(columns_of(*self.factors))

    @property
    def is_turn(self) -> bool:
        """Whether it turns a part."""
        return bool(INPUTS[self.input].frame)

    @property
    def needs(self) -> tuple[str, ...]:
        """Covariates without which it cannot be seen."""
        return tuple(dict.fromkeys(n for f in self.factors for n in f.needs))

    @property
    def unit(self) -> Dimension:
        """The unit of its coefficients, which follows from those of its parts."""
        return READING.times(Multiplication(tuple(f.tree for f in self.factors)).dimension.power(Fraction(-1)))

    @property
    def size(self) -> int:
        """Nodes of its tree."""
        return sum(size(f.tree) for f in self.factors)

    @property
    def description(self) -> tuple[int, int]:
        """What makes one term simpler than another: nodes and free constants, and how many axes it acts on."""
        return self.size + len(self.fields), len(self.axes)

    def with_constants(self, **values: float) -> "Term":
        """The same with other constants."""
        return replace(self, constants=tuple((field, values.get(field, value)) for field, value in self.constants))

    def with_axes(self, labels: Collection[str]) -> "Term":
        """The same with other coefficients, in the order of the grammar."""
        return replace(self, axes=tuple(c.label for c in columns_of(*self.factors) if c.label in labels))

    def tree(self, column: FormulaColumn) -> tuple[Expression, Expression]:
        """Trees of input and modulator of a coefficient."""
        return _trees(*self.family, column.phase, column.wave)[0]

    def column(self, column: FormulaColumn, signal: Signal) -> Floats:
        """What one coefficient of size 1 adds to its axis (n)."""
        one, two = self.factor_values(column, signal)
        return one * two

    def factor_values(self, column: FormulaColumn, signal: Signal) -> tuple[Floats, Floats]:
        """What the axis feels (n), and how it is modulated (n), of one coefficient."""
        trees, wanted = _trees(*self.family, column.phase, column.wave)
        values = variable_values(signal, column.i, column.j, wanted)
        one, two = (evaluate(t, values, dict(self.constants)) for t in trees)
        n = len(signal.scene)
        return np.broadcast_to(without_rounding(one), n), np.broadcast_to(two, n)


@cache
def _trees(
    input_name: str, modulator_name: str, phase: str, wave: str
) -> tuple[tuple[Expression, Expression], frozenset[str]]:
    """Trees of an input and a modulator at a phase and a wave, and the names of the variables in both."""
    one, two = dict(INPUTS[input_name].forms)[phase], dict(MODULATORS[modulator_name].forms)[wave]
    return (one, two), variables(one) | variables(two)


def without_rounding(values: Floats) -> Floats:
    """Values of an input, zero where they are but the rounding of poses: at six faces no two axes have a product."""
    return values if float(np.max(np.abs(values), initial=0.0)) > ROUNDING else np.zeros_like(values)


def axis_places(i: int, j: int) -> dict[str, int]:
    """Which axis each place of a column is."""
    k = (j + 1) % 3 if i == j else 3 - i - j
    return {"i": i, "j": j, "k": k}


def variable_values(signal: Signal, i: int, j: int, wanted: frozenset[str]) -> dict[tuple[str, str], Array]:
    """Values (n) of the variables wanted, for the reading of axis i and another axis j."""
    found: dict[tuple[str, str], Array] = {
        (name, ""): _covariate(signal.scene, column) for name, column in COVARIATE_OF.items() if name in wanted
    }
    for place, axis in axis_places(i, j).items():
        if "a" in wanted:
            found["a", place] = signal.true[:, axis]
        if "step" in wanted:
            found["step", place] = signal.step[:, axis]
        if "previous" in wanted:
            found["previous", place] = previous_felt(signal)[:, axis]
        if "angle" in wanted:
            found["angle", place] = turn_angle(signal.true, axis)
    return found


def _covariate(scene: Scene, column: str) -> Array:
    return scene.time_s if column == "time_s" else scene.require(column)


def previous_felt(signal: Signal) -> Floats:
    """What was felt at rest at the visit before (n, 3); at a run's first visit, what is felt there."""
    return np.asarray(signal.step + signal.at_visit[signal.scene.visit])


def turn_angle(true: Floats, axis: int) -> Floats:
    """Angle (n) of what is felt about an axis, rad."""
    return np.asarray(np.arctan2(true[:, (axis + 1) % 3], true[:, (axis + 2) % 3]))
