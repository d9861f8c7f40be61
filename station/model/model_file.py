"""A simulation that has learnt: schema `station.model/1`, which `diagnose` writes and `simulate` and `diagnose` read.

It says what the simulation is made of besides the recipe: the calibration it is projected free of, the noise, the
spread between units, and the causes found, with parameters as in docs/formats.md.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from station import plugins
from station.domain.core.types import Floats
from station.domain.recipe.fields import NotNegative, Number, StrictModel
from station.errors import InputError, InvalidValue
from station.model.effect import Effect, EffectStage
from station.model.formula.model_term import ModelTerm
from station.model.formula.term_effect import effect_of
from station.model.forward import ActiveEffect
from station.model.scene import Scene

EFFECTS = "station.model.effects"


class ModelNoise(StrictModel):
    """Recipe's unit: density per √Hz, flicker rms; None: as the data sheet says."""

    density: NotNegative | None = None
    flicker: NotNegative | None = None


class ModelSpread(StrictModel):
    """Spread between units: offset in the recipe's unit, gain and cross-axis gain in 1; None: as usual."""

    offset_std: NotNegative | None = None
    gain_std: NotNegative | None = None
    cross_std: NotNegative | None = None


def _number_or_text(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InvalidValue("value-not-number", given=str(value).lower()[:40])
    try:
        return float(value)
    except (ValueError, OverflowError):
        return value


class ModelParameter(StrictModel):
    """One number of a cause, as docs/formats.md names it; a mapping of axes is text."""

    name: str
    axis: str | None = None
    of: str = "common"
    value: Annotated[float | str, BeforeValidator(_number_or_text)]
    std: float | None = None
    unit: str = ""


def measured_parameter(row: Mapping[str, Any]) -> ModelParameter:
    """A number of a finding, without its standard deviation where the data tell none."""
    std = row["std"]
    return ModelParameter(**{**row, "std": std if std is not None and np.isfinite(std) else None})


class SizedTerm(StrictModel):
    """A term with its own parameters: a formula that the data cannot tell from another one."""

    parameters: tuple[ModelParameter, ...]
    term: ModelTerm


class ModelEffect(StrictModel):
    """A cause with its parameters; shape: parameters of its form by field, such as time_constant_s; term: of one that
    the library does not know, a formula, `effect` then being its name; equivalent: those that its data cannot tell from
    it, the simplest first."""

    effect: str
    parameters: tuple[ModelParameter, ...] = ()
    shape: dict[str, Number] = Field(default_factory=dict)
    term: ModelTerm | None = None
    equivalent: tuple[SizedTerm, ...] = ()

    @model_validator(mode="after")
    def _has_a_term(self) -> Self:
        if self.term is None and self.equivalent:
            raise InvalidValue("formula-equivalent-alone", effect=self.effect[:40])
        return self

    def build(self) -> Effect:
        """The cause, its form as found. InputError names what it does not know."""
        if self.term is not None:
            return effect_of(self.term.term(), self.effect, formula_size(self.parameters), self.term.source)
        kind: type[Effect] = plugins.load(EFFECTS, self.effect)
        shape = dict(self.shape)
        for form in kind.forms:
            values = [p.value for p in self.parameters if p.name == form.name]
            shape.update({form.field: float(values[0])} if values else {})
        names = [f.name for f in fields(kind) if f.name != "size"]
        for name in shape:
            if name not in names:
                raise InputError("model-shape", effect=self.effect, name=name, names=names)
        example = kind.example()
        return replace(example, **{name: type(getattr(example, name))(value) for name, value in shape.items()})

    def acting(self, scene: Scene, seed: int | None) -> list[ActiveEffect]:
        """This cause at work in a scene, once for each level its parameters speak of.

        Groups it does not speak of get coefficients of the same rms drawn with the seed, or none when it is None;
        runs and visits it does not speak of get none.
        """
        effect = self.build()
        levels: dict[str, dict[str, Floats]] = defaultdict(dict)
        for p in self.parameters:
            if (at := self.place(effect, p)) is not None:
                c = levels[p.of.partition(":")[0]].setdefault(p.of, neutral_coefficients(effect))
                c[at] = effect.read_size(p.value) if isinstance(p.value, str) else p.value
        return [_for_all_groups(effect, level, known, scene, seed) for level, known in levels.items()]

    def place(self, effect: Effect, p: ModelParameter) -> list[int] | None:
        """Which columns of the coefficients a parameter is, a missing axis meaning all; None of another parameter."""
        named = [i for i, column in enumerate(effect.columns) if column.name == p.name]
        if not named:
            return None
        found = [i for i in named if p.axis in (None, effect.columns[i].axis)]
        if not found:
            raise InputError("model-axis", effect=self.effect, axis=str(p.axis), axes=effect.axes)
        return found


class Model(StrictModel):
    """A whole model file."""

    schema_: Annotated[Literal["station.model/1"], Field(alias="schema")] = "station.model/1"
    calibration: Literal["offset-gain", "matrix"] | None = None
    noise: ModelNoise = ModelNoise()
    spread: ModelSpread = ModelSpread()
    effects: tuple[ModelEffect, ...] = ()

    def document(self) -> dict[str, Any]:
        """As it is written to a file; what is not said is left out."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)


def formula_size(parameters: tuple[ModelParameter, ...]) -> float:
    """Rms of a formula's coefficients; 0 without any."""
    sizes = [float(p.value) for p in parameters if p.name in ("coefficient", "angle") and not isinstance(p.value, str)]
    return float(np.sqrt(np.mean(np.square(sizes)))) if sizes else 0.0


def neutral_coefficients(effect: Effect) -> Floats:
    """Coefficients (axes) that do nothing."""
    return np.full(len(effect.columns), effect.parameter.neutral)


def _for_all_groups(
    effect: Effect, level: str, known: dict[str, Floats], scene: Scene, seed: int | None
) -> ActiveEffect:
    """Coefficients of every group of a level in the scene, from those of the known groups."""
    rms = effect.size_of(np.array(list(known.values())))
    if level == "common" and effect.of[0] == "visit":
        # A standard deviation of what differs at each visit: the model knows no more, and draws it.
        level, known = "visit", {}
    names = scene.group(level)[1]
    c = np.tile(neutral_coefficients(effect), (len(names), 1))
    unknown = [i for i, name in enumerate(names) if name not in known]
    # A swapped axis is one unit's fault, a bumped visit is past: neither says anything of the others.
    spreads = effect.stage is not EffectStage.OUTPUT and not (known and level in ("run", "visit", "power-on"))
    if unknown and seed is not None and spreads:
        c[unknown] = replace(effect, size=rms).coefficients([names[i] for i in unknown], seed)
    for i, name in enumerate(names):
        c[i] = known.get(name, c[i])
    return ActiveEffect(effect, c, level)
