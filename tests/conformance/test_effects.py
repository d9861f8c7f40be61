"""What every cause must keep, whichever file it stands in: a new file is tested here without being told of."""

import dataclasses
import doctest
import importlib
from typing import Any, get_args

import numpy as np
import pytest

from station import plugins
from station.domain.recipe.recipe import Recipe
from station.model.campaign import scene_of_plan
from station.model.effect import (
    DrawnOver,
    Effect,
    EffectStage,
    GoldEffect,
    OutputEffect,
    PoseEffect,
    SensorEffect,
    StimulusEffect,
)
from station.model.formula.term import Term
from station.model.formula.term_effect import effect_of
from station.model.forward import ActiveEffect, BaseResponse, convert_output, forward, gold_error, signature
from station.model.scene import COVARIATES, Scene
from station.model.simulate import SimulationJob, parse_effect, simulate
from tests.unit.test_formula_grammar import ALL
from tests.unit.tilt_recipe import tilt

IDS = plugins.names("station.model.effects")
SMOOTH = {EffectStage.POSE, EffectStage.STIMULUS, EffectStage.SENSOR}
#: A change beyond rounding, whatever the sensor's unit and noise.
VISIBLE = 1e-10
LEVELS = ("common", "unit", "run", "power-on", "visit", "nest", "position", "station", "lot", "operator")

#: docs/formats.md: name, unit, axes, frame of the parameters of each id.
XYZ, ALONE = ("x", "y", "z"), ("",)
CONTRACT: dict[str, tuple[str, str, tuple[str, ...], str]] = {
    "cross-axis": ("coefficient", "1", ("xy", "xz", "yz"), ""),
    "package-rotation": ("angle", "rad", XYZ, "device"),
    "nest-tilt": ("angle", "rad", XYZ, "nest"),
    "base-tilt": ("angle", "rad", ("x", "y"), "station"),
    "index-error": ("angle", "rad", XYZ, "nest"),
    "repeatability": ("angle", "rad", XYZ, "nest"),
    "disturbed-visit": ("angle", "rad", XYZ, "nest"),
    "quadratic": ("coefficient", "1/u", XYZ, ""),
    "cubic": ("coefficient", "1/u²", XYZ, ""),
    "asymmetry": ("coefficient", "1", XYZ, ""),
    "cross-quadratic": ("coefficient", "1/u", ("x:y", "x:z", "y:x", "y:z", "z:x", "z:y"), ""),
    "offset-temperature": ("coefficient", "u/degC", XYZ, ""),
    "gain-temperature": ("coefficient", "1/degC", XYZ, ""),
    "turn-on-offset": ("offset", "u", XYZ, ""),
    "temperature-rate": ("coefficient", "u·s/degC", XYZ, ""),
    "warm-up": ("amplitude", "u", XYZ, ""),
    "clamp-creep": ("amplitude", "u", XYZ, ""),
    "bias-drift": ("rate", "u/s", XYZ, ""),
    "bias-walk": ("step_std", "u", XYZ, ""),
    "hysteresis": ("coefficient", "1", XYZ, ""),
    "settling": ("coefficient", "1", XYZ, ""),
    "filter-lag": ("coefficient", "1", XYZ, ""),
    "vibration-rectification": ("coefficient", "u", XYZ, ""),
    "motor-tone": ("amplitude", "u", XYZ, ""),
    "lever-arm": ("amplitude", "u", XYZ, ""),
    "quantization": ("lsb", "u", ALONE, ""),
    "clipping": ("limit", "u", ALONE, ""),
    "wrong-scale": ("factor", "1", ALONE, ""),
    "axis-permutation": ("mapping", "", ALONE, ""),
    "local-gravity": ("coefficient", "1", ALONE, ""),
    "group-offset": ("offset", "u", XYZ, ""),
    "step": ("offset", "u", XYZ, ""),
    "gold-drift": ("offset", "u", XYZ, ""),
    "lost-frames": ("fraction", "1", ALONE, ""),
    "duplicated-frames": ("fraction", "1", ALONE, ""),
    "reordered-frames": ("fraction", "1", ALONE, ""),
    "clock-error": ("rate_error", "1", ALONE, ""),
}
FORMS = {
    **dict.fromkeys(("warm-up", "clamp-creep", "settling", "filter-lag", "lever-arm"), ("time_constant", "s")),
    "motor-tone": ("frequency", "Hz"),
    "step": ("at", "s"),
    **dict.fromkeys(("offset-temperature", "gain-temperature"), ("degree", "")),
}


def kind(name: str) -> type[Effect]:
    return plugins.load("station.model.effects", name)


@pytest.fixture(scope="module")
def recipe() -> Recipe:
    # The third axis leaves no component at rest: what goes with a product of two or three shows.
    runs = [{}, {"seating": "turned", "order": "shuffled", "temperature_offset_degC": 10, "prewarm_s": 600}]
    return tilt(third=(1, 1, 1), runs=runs, dwell={"time_s": 0.1})


@pytest.fixture(scope="module")
def scene(recipe: Recipe) -> Scene:
    """Two units, two runs; every array locked, so that an effect that writes into its input fails."""
    scene = scene_of_plan(recipe, ("A", "B"), seed=1)
    visits = scene.visits
    for name in ("time_s", "visit", *COVARIATES):
        getattr(scene, name).flags.writeable = False
    for array in (visits.nest_R, visits.seat_R, visits.stimulus, visits.previous, visits.run, visits.visit):
        array.flags.writeable = False
    return scene


@pytest.fixture(scope="module")
def base() -> BaseResponse:
    rng = np.random.default_rng(5)
    base = BaseResponse(rng.normal(0, 0.02, (2, 3)), np.eye(3) + rng.normal(0, 0.01, (2, 3, 3)))
    base.offset.flags.writeable = base.matrix.flags.writeable = False
    return base


def reaching(effect: Effect, scene: Scene) -> Scene:
    """The scene with times and temperatures about those that an effect's form names: a jump after an hour shows."""
    for form in effect.forms:
        value = float(getattr(effect, form.field))
        if form.name == "start":
            longer = scene.time_s * max(1.0, 2 * value / float(scene.time_s.max()))
            scene = dataclasses.replace(scene, time_s=longer)
        if form.unit == "degC":
            T = scene.require("temperature_degC")
            scene = dataclasses.replace(scene, temperature_degC=T + value - float(T.mean()))
    scene.time_s.flags.writeable = scene.require("temperature_degC").flags.writeable = False
    return scene


def acting(effect: Effect, scene: Scene, factor: float = 1.0, seed: int = 3) -> ActiveEffect:
    names = scene.group(effect.of[0])[1]
    neutral = effect.parameter.neutral if effect.stage in SMOOTH else 0.0
    c = neutral + factor * (effect.coefficients(names, seed) - neutral)
    c.flags.writeable = False
    return ActiveEffect(effect, c, effect.of[0])


def still(effect: Effect, scene: Scene) -> ActiveEffect:
    c = np.full((len(scene.group(effect.of[0])[1]), len(effect.axes)), effect.parameter.neutral)
    return ActiveEffect(effect, c, effect.of[0])


def test_every_id_of_the_contracts_has_its_file() -> None:
    assert set(CONTRACT) <= set(IDS)


@pytest.mark.parametrize("name", CONTRACT)
def test_parameters_are_those_of_the_contracts(name: str) -> None:
    effect = kind(name)
    parameter, unit, axes, frame = CONTRACT[name]
    assert (effect.parameter.name, effect.parameter.unit, effect.axes) == (parameter, unit, axes)
    if issubclass(effect, PoseEffect):
        assert effect.frame == frame
    assert [(p.name, p.unit) for p in effect.forms][:1] == ([FORMS[name]] if name in FORMS else [])


@pytest.mark.parametrize("name", IDS)
def test_file_says_what_a_reader_needs(name: str) -> None:
    effect = kind(name)
    assert effect.id == name
    assert effect.physics.endswith(".") and 20 < len(effect.physics) <= 120
    assert 10 < len(effect.remedy) <= 120 and not effect.remedy.endswith(".")
    assert 10 < len(effect.shown_by) <= 120 and not effect.shown_by.endswith(".")
    assert effect.drawn_over in get_args(DrawnOver)
    assert {other for other, _ in effect.separated_by} <= set(IDS) - {name}
    assert effect.level in ("device", "rig", "bus")
    assert effect.of and set(effect.of) <= set(LEVELS)
    assert set(effect.needs) <= {*COVARIATES, "gold"}
    for parameter in (effect.parameter, *effect.forms):
        assert parameter.low <= parameter.typical <= parameter.high, parameter
        assert parameter.source
    assert {p.field for p in effect.forms} == {f.name for f in dataclasses.fields(effect)} - {"size"}
    assert all(p.low <= value <= p.high for p in effect.forms for value in p.grid)


@pytest.mark.parametrize("name", IDS)
def test_example_of_the_docstring_holds(name: str) -> None:
    module = importlib.import_module(kind(name).__module__)
    failed, tried = doctest.testmod(module)
    assert tried > 0 and failed == 0


@pytest.mark.parametrize("name", IDS)
def test_an_effect_is_a_frozen_value(name: str) -> None:
    effect = kind(name).example()
    assert effect == kind(name).example()
    with pytest.raises(dataclasses.FrozenInstanceError):
        effect.size = 2.0  # type: ignore[misc]


@pytest.mark.parametrize("name", IDS)
def test_neutral_coefficients_do_nothing(name: str, scene: Scene, base: BaseResponse) -> None:
    active = {name: still(kind(name).example(), scene)}
    np.testing.assert_array_equal(forward(scene, base, active), forward(scene, base))
    reading = forward(scene, base)
    np.testing.assert_array_equal(convert_output(scene, reading, active), reading)
    np.testing.assert_array_equal(gold_error(scene, active), np.zeros((len(scene.visits), 3)))


@pytest.mark.parametrize("name", IDS)
def test_pure_and_visible_at_its_typical_size(name: str, scene: Scene, base: BaseResponse) -> None:
    """The scene is locked: writing into it raises. Called twice it gives the same, and it changes something."""
    assert_pure_and_visible(kind(name).example(), scene, base)


@pytest.mark.parametrize("term", ALL[::7], ids=lambda t: "-".join(t.family))
def test_a_formula_of_any_form_would_be_visible(term: Term, scene: Scene, base: BaseResponse) -> None:
    """Whatever formula is adopted: its file is tested in this scene, far from its own time, temperature and size."""
    far = {"start_s": 3600.0, "kink_degC": 80.0, "about_degC": -30.0, "bend_u": 0.3}
    made = term.with_constants(**{field: value for field, value in far.items() if field in term.fields})
    assert_pure_and_visible(effect_of(made, "found-law", 1e-6), scene, base)


def assert_pure_and_visible(effect: Effect, scene: Scene, base: BaseResponse) -> None:
    scene, name = reaching(effect, scene), effect.id
    active = {name: acting(effect, scene)}
    reading = forward(scene, base)
    reading.flags.writeable = False
    results: list[Any] = []
    for _ in range(2):
        out = convert_output(scene, forward(scene, base, active) if effect.stage in SMOOTH else reading, active)
        results.append((out, gold_error(scene, active)))
    np.testing.assert_array_equal(results[0][0], results[1][0])
    if isinstance(effect, PoseEffect | StimulusEffect | SensorEffect | OutputEffect):
        assert np.abs(results[0][0] - reading).max() > VISIBLE
    if isinstance(effect, GoldEffect):
        assert np.abs(results[0][1]).max() > VISIBLE


@pytest.mark.parametrize("name", [n for n in IDS if kind(n).stage in SMOOTH])
def test_additive_at_small_size(name: str, scene: Scene, base: BaseResponse) -> None:
    """Twice the coefficient gives twice the change, up to the square of the size."""
    effect = kind(name).example()
    scene = reaching(effect, scene)
    off = forward(scene, base)
    one = forward(scene, base, {name: acting(effect, scene, 0.01)}) - off
    two = forward(scene, base, {name: acting(effect, scene, 0.02)}) - off
    scale = np.abs(one).max()
    assert scale > 0
    np.testing.assert_allclose(two, 2 * one, atol=0.02 * max(effect.size, 0.01) * scale + 1e-15)


@pytest.mark.parametrize("name", [n for n in IDS if kind(n).stage in SMOOTH])
def test_signature_predicts_the_effect(name: str, scene: Scene, base: BaseResponse) -> None:
    """The derivative by each axis, times the coefficients, is what switching it on does: all alike, then each."""
    effect = kind(name).example()
    scene = reaching(effect, scene)
    groups = len(scene.group(effect.of[0])[1])
    parts = signature(scene, base, effect)
    equal = np.tile(0.01 * effect.size * np.arange(1, len(effect.axes) + 1), (groups, 1))
    each = acting(effect, scene, 0.01).coefficients
    for c in (equal, each) if type(effect).gather is Effect.gather else (equal,):
        change = forward(scene, base, {name: ActiveEffect(effect, c, effect.of[0])}) - forward(scene, base)
        rows = c[scene.group(effect.of[0])[0]][scene.visit]
        predicted = sum(part * rows[:, [k]] for k, part in enumerate(parts))
        tolerance = 0.03 * max(effect.size, 0.01) * np.abs(change).max() + 1e-12
        np.testing.assert_allclose(predicted, change, atol=tolerance)


def test_effects_compose(scene: Scene, base: BaseResponse) -> None:
    """All smooth causes together do what they do apart, up to products of small sizes."""
    effects = [kind(n).example() for n in IDS if kind(n).stage in SMOOTH]
    small = {e.id: acting(e, scene, 1e-3) for e in effects}
    off = forward(scene, base)
    together = forward(scene, base, small) - off
    apart = sum(forward(scene, base, {key: value}) - off for key, value in small.items())
    np.testing.assert_allclose(together, apart, atol=1e-3 * np.abs(together).max())
    backwards = forward(scene, base, dict(reversed(small.items())))
    np.testing.assert_allclose(backwards, forward(scene, base, small), atol=1e-15)


@pytest.mark.parametrize("name", IDS)
def test_own_random_stream(name: str, recipe: Recipe) -> None:
    """Switching a cause on leaves the coefficients of all others as they were; off, the readings are the same."""
    others = tuple(parse_effect(n, recipe) for n in ("quadratic", "repeatability", "disturbed-visit") if n != name)
    units = ("A", "B")
    with_it = simulate(SimulationJob(recipe, units, 7, (*others, parse_effect(name, recipe))))
    without = simulate(SimulationJob(recipe, units, 7, others))
    for a, b in zip(without.active.values(), with_it.active.values(), strict=False):
        np.testing.assert_array_equal(a.coefficients, b.coefficients)
    np.testing.assert_array_equal(with_it.base.matrix, without.base.matrix)
    off = dataclasses.replace(kind(name).example(), size=kind(name).parameter.neutral)
    again = simulate(SimulationJob(recipe, units, 7, (*others, off)))
    np.testing.assert_array_equal(again.table.reading, without.table.reading)


@pytest.mark.parametrize("name", IDS)
def test_coefficients_belong_to_their_groups(name: str, recipe: Recipe) -> None:
    """A group keeps its coefficients when others join; the size is their rms; equal seeds give equal numbers."""
    effect = parse_effect(name, recipe)
    of = effect.of[0]
    names = ("common",) if of == "common" else tuple(f"{of}:G{i}" for i in range(400))
    c = effect.coefficients(names, 11)
    assert c.shape == (len(names), len(effect.axes))
    np.testing.assert_array_equal(c, effect.coefficients(names, 11))
    hit = (c != effect.parameter.neutral).any(axis=1)
    assert hit.any()
    # 1200 normal numbers: four standard errors of their rms are 8 %.
    assert np.sqrt(np.mean(c[hit] ** 2)) == pytest.approx(effect.size, rel=0.25 if hit.sum() < 100 else 0.085)
    if len(names) > 1 and not hit.all():
        return
    np.testing.assert_array_equal(c[: len(names) // 2 or 1], effect.coefficients(names[: len(names) // 2 or 1], 11))


@pytest.mark.parametrize("name", IDS)
def test_told_in_the_contracts_form(name: str, recipe: Recipe, scene: Scene) -> None:
    effect = parse_effect(name, recipe)
    on = acting(effect, scene)
    shown = effect.parameter_rows(scene.group(on.of)[1], on.coefficients, recipe.unit)
    assert shown
    for row in shown:
        assert set(row) == {"name", "axis", "of", "value", "unit"}
        assert row["axis"] is None or row["axis"] in effect.axes
        assert isinstance(row["value"], float | str)
        assert row["unit"] in {p.unit.replace("u", recipe.unit) for p in (effect.parameter, *effect.forms)}
    assert {str(r["name"]) for r in shown} <= {effect.parameter.name, *(p.name for p in effect.forms)}
