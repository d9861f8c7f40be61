"""What the uncertainty budget takes for granted where a recipe says nothing: each default with its source.

A recipe that knows better states the value; one that knows a contribution to be nothing states 0.
"""

from dataclasses import dataclass, replace

import numpy as np

from station.domain.core.types import Floats
from station.domain.recipe import gravity, sensor
from station.domain.recipe.recipe import Recipe
from station.messages import Message

#: Normal gravity runs from 9.7803 m/s² (equator) to 9.8322 (pole): −2684 … +2604 ppm about standard gravity, taken
#: as rectangular (JCGM 100, 4.3.7).
GRAVITY_RELATIVE = 2684e-6 / 3**0.5
FIELD_RELATIVE, RATE_RELATIVE = 5e-3, 1e-3
#: ISO 2768-1, class m, sides of 120 to 400 mm: angles within ± 10′, taken as rectangular.
NEST_DEG = 10 / 60 / 3**0.5
#: A machinist's level read to one division of 1 mm/m.
BASE_DEG = 0.05
FIELD_DEG = 0.2
#: Taken where residuals are too few to show errors of poses.
POSE_DEG = 10 / 60 / 3**0.5
#: Key of scatter that no reading shows: what the log would teach of it is said under the same.
HIDDEN_SCATTER = "residuals"
#: Keys of what temperature does.
TEMPCOS, THERMOMETER = ("device.offset_tempco", "device.gain_tempco"), "reference.thermometer_std_degC"
#: Key of the offset of another power-on.
TURN_ON = "device.turn_on_std"
#: Residuals of so many degrees of freedom show errors of poses by themselves.
MIN_RESIDUAL_DOF = 3
#: Sensitivity and cross-axis sensitivity as data sheets of MEMS sensors usually bound them.
GAIN, CROSS = 0.01, 0.01
#: Rate that a MEMS gyroscope shows for 1 g, in deg/s, as its data sheets usually bound it.
G_SENSITIVITY = 0.1
#: IEC 60751, class B, about room temperature.
THERMOMETER_DEGC = 0.4 / 3**0.5
#: Of a gold reference whose certificate's values were not entered: share of the stimulus.
GOLD_RELATIVE = 1e-3
#: Of a step: what a converter may cut off all readings, or not, has this standard uncertainty (two thirds of a half).
CUT_OFF = 1 / 3


@dataclass(frozen=True, slots=True)
class Assumption:
    """One contribution: the recipe's key, its standard value in `unit`, whether the recipe states it, its source."""

    key: str
    value: float
    unit: str
    stated: bool
    source: Message


def magnitude_relative_std(recipe: Recipe) -> float:
    """Standard uncertainty of the stimulus' magnitude, relative."""
    reference = recipe.reference
    if reference.site is not None or reference.gravimeter is not None or reference.magnitude_std is not None:
        return reference.relative_std()
    return {"gravity": GRAVITY_RELATIVE, "field": FIELD_RELATIVE, "rate": RATE_RELATIVE}.get(reference.source, 0.0)


def nest_deg(recipe: Recipe) -> float:
    """How the nest sits on its fixture, about each axis; a gold reference in the nest leaves its own seat."""
    return _stated_or(recipe.reference.nest_std_deg, 0.0 if recipe.reference.source == "gold" else NEST_DEG)


def base_deg(recipe: Recipe) -> float:
    """How the fixture stands, about each level axis; a rate table and a gold reference do not feel it."""
    return _stated_or(recipe.reference.base_std_deg, BASE_DEG if recipe.reference.source == "gravity" else 0.0)


def field_deg(recipe: Recipe) -> float:
    """Direction of a field against the station, about each axis."""
    return _stated_or(recipe.reference.field_std_deg, FIELD_DEG if recipe.reference.source == "field" else 0.0)


def directions_deg(recipe: Recipe) -> dict[str, float]:
    """Of nest, base and field, for references.direction_errors; a gold reference knows its own direction."""
    if recipe.reference.source == "gold" and recipe.reference.nest_std_deg is None:
        return {}
    return {"nest": nest_deg(recipe), "base": base_deg(recipe), "field": field_deg(recipe)}


def pose_deg(recipe: Recipe, residual_dof: float) -> float:
    """Error of each pose by itself, about each axis; where nothing is stated, residuals show it if they can."""
    return _stated_or(recipe.reference.pose_std_deg, 0.0 if residual_dof >= MIN_RESIDUAL_DOF else POSE_DEG)


def unestimated_std(recipe: Recipe) -> Floats:
    """Standard deviations (12) of the coefficients, as far as a method takes them for granted; offsets are always
    estimated."""
    device = recipe.device
    gain, cross = _stated_or(device.gain_std, GAIN), _stated_or(device.cross_std, CROSS)
    return np.asarray(np.r_[np.zeros(3), np.where(np.eye(3, dtype=bool), gain, cross).ravel()])


def g_sensitivity(recipe: Recipe) -> float:
    """What a gyroscope shows for 1 g, in the recipe's unit, on any axis."""
    return _stated_or(recipe.device.g_sensitivity, G_SENSITIVITY)


def tempcos(recipe: Recipe) -> tuple[float, float]:
    """Temperature coefficients of offset (unit/°C) and gain (1/°C); left out, those of usual data sheets."""
    # A sensor kind of before rules 10 names none.
    of_offset, of_gain = getattr(sensor.of(recipe), "usual_tempcos", (0.0, 0.0))
    return _stated_or(recipe.device.offset_tempco, of_offset), _stated_or(recipe.device.gain_tempco, of_gain)


def turn_on_std(recipe: Recipe) -> float:
    """How an offset differs from one power-on to another, in the recipe's unit; left out, as usual data sheets have it
    where a product keeps the coefficients, which then serve at every later power-on."""
    # A sensor kind of before rules 11 names none.
    usual = 0.0 if recipe.product is None else getattr(sensor.of(recipe), "usual_turn_on", 0.0)
    return _stated_or(recipe.device.turn_on_std, usual)


def thermometer_degC(recipe: Recipe) -> float:
    """Standard uncertainty of the temperature at which the coefficients hold."""
    return _stated_or(recipe.reference.thermometer_std_degC, THERMOMETER_DEGC)


def _stated_or(stated: float | None, default: float) -> float:
    return float(default if stated is None else stated)


def listing(recipe: Recipe) -> tuple[Assumption, ...]:
    """Every contribution that the recipe states or leaves to a default, for `check` and the certificate."""
    r, device = recipe.reference, recipe.device
    found = [_magnitude(recipe)] if r.source != "gold" and not recipe.converts else []
    if recipe.pose_known and r.source != "gold":
        found.append(
            _of("reference.pose_std_deg", r.pose_std_deg, 0.0, "deg", Message("assumed-pose", fallback=POSE_DEG))
        )
        found.append(_of("reference.nest_std_deg", r.nest_std_deg, NEST_DEG, "deg", Message("assumed-nest")))
    found += _hidden_scatter(recipe)
    if recipe.pose_known and r.source == "gravity":
        found.append(_of("reference.base_std_deg", r.base_std_deg, BASE_DEG, "deg", Message("assumed-base")))
    if recipe.pose_known and r.source == "field":
        found.append(_of("reference.field_std_deg", r.field_std_deg, FIELD_DEG, "deg", Message("assumed-field")))
    if recipe.method in ("one-point", "three-point") or recipe.model == "offset-gain":
        if recipe.method == "one-point":
            found.append(_of("device.gain_std", device.gain_std, GAIN, "1", Message("assumed-gain")))
        found.append(_of("device.cross_std", device.cross_std, CROSS, "1", Message("assumed-cross")))
    found += [*_gold(recipe), *_earth_rate(recipe), _rounding(recipe)]
    usual = turn_on_std(recipe)
    source = Message("assumed-turn-on-usual" if usual else "assumed-turn-on")
    found.append(_of(TURN_ON, device.turn_on_std, usual, recipe.unit, source))
    if recipe.feels_rotation and r.source != "gold":
        sensitivity, own_unit = device.g_sensitivity, f"{recipe.unit}/g"
        found.append(
            _of("device.g_sensitivity", sensitivity, G_SENSITIVITY, own_unit, Message("assumed-g-sensitivity"))
        )
    source, own_unit = Message("assumed-tempco"), f"{recipe.unit}/degC"
    of_offset, of_gain = tempcos(recipe)
    found.append(_of(TEMPCOS[0], device.offset_tempco, of_offset, own_unit, source))
    found.append(_of(TEMPCOS[1], device.gain_tempco, of_gain, "1/degC", source))
    if any(tempcos(recipe)):
        found.append(thermometer(recipe))
    return tuple(found)


def at_one_temperature(listed: tuple[Assumption, ...]) -> tuple[Assumption, ...]:
    """The same of a budget without temperature, as where none was measured: what nobody stated of it is nothing."""
    told = (a for a in listed if a.stated or a.key != THERMOMETER)
    held = Message("assumed-one-temperature")
    return tuple(replace(a, value=0.0, source=held) if a.key in TEMPCOS and not a.stated else a for a in told)


def at_one_power_on(listed: tuple[Assumption, ...]) -> tuple[Assumption, ...]:
    """The same of a budget of before rules 11, which took another power-on's offset for nothing unless stated."""
    held = Message("assumed-turn-on")
    return tuple(replace(a, value=0.0, source=held) if a.key == TURN_ON and not a.stated else a for a in listed)


def unknown_earth_rate(recipe: Recipe) -> Floats:
    """What nobody knows of the Earth's turning about each axis of the station, deg/s: its level part without a heading,
    all of it without a site."""
    site = recipe.reference.site
    if site is None:
        return np.full(3, gravity.EARTH_RATE / 3**0.5)
    level = 0.0 if site.heading_deg is not None else gravity.EARTH_RATE * np.cos(np.deg2rad(site.latitude_deg))
    return np.array([level, level, 0.0]) / 2**0.5


def _earth_rate(recipe: Recipe) -> list[Assumption]:
    if not recipe.feels_rotation or recipe.reference.source == "gold":
        return []
    unknown = unknown_earth_rate(recipe)
    source = Message("assumed-earth-rate" if unknown.any() else "assumption-stated")
    size = float(np.linalg.norm(unknown))
    return [Assumption("reference.site.heading_deg", size, recipe.unit, not unknown.any(), source)]


def _rounding(recipe: Recipe) -> Assumption:
    device = recipe.device
    stated, size = device.rounding != "unknown", 0.0 if device.rounding == "nearest" else CUT_OFF * device.lsb
    source = Message("assumption-stated" if stated else "assumed-rounding")
    return Assumption("device.rounding", size, recipe.unit, stated, source)


def _gold(recipe: Recipe) -> list[Assumption]:
    """What is not entered of a gold reference's certificate."""
    gold = recipe.reference.gold
    if recipe.reference.source != "gold" or gold is None:
        return []
    true = [recipe.true_vector(p, run.seating) for run in recipe.runs for p in recipe.positions]
    size = GOLD_RELATIVE * float(np.linalg.norm(np.reshape(true, (-1, 3)), axis=1).max(initial=0.0))
    of_values, of_seat = Message("assumed-gold"), Message("assumed-nest")
    return [
        _of("reference.gold.offset_std", gold.offset_std, size, recipe.unit, of_values),
        _of("reference.gold.gain_std", gold.gain_std, GOLD_RELATIVE, "1", of_values),
        _of("reference.gold.seat_std_deg", gold.seat_std_deg, NEST_DEG, "deg", of_seat),
    ]


def thermometer(recipe: Recipe) -> Assumption:
    """How well the temperature is known at which the result holds."""
    own = recipe.reference.thermometer_std_degC
    return _of(THERMOMETER, own, THERMOMETER_DEGC, "degC", Message("assumed-thermometer"))


def hides_scatter(recipe: Recipe, true: Floats) -> bool:
    """Whether scatter along the stimulus (v, 3) shows nowhere when each pose is visited once: readings across feel
    errors of poses, and coefficients take all that those along it say."""
    felt = recipe.pose_known and recipe.method != "norm" and recipe.reference.source != "gold" and not recipe.converts
    if not felt or recipe.reference.pose_std_deg == 0 or recipe.reproducibility is not None:
        return False
    pairs = [(i, i) for i in range(3)] + ([(0, 1), (0, 2), (1, 2)] if recipe.model == "matrix" else [])
    along = np.column_stack([true, *(true[:, i] * true[:, j] for i, j in pairs)])
    return len(true) - int(np.linalg.matrix_rank(along)) < MIN_RESIDUAL_DOF


def _hidden_scatter(recipe: Recipe) -> list[Assumption]:
    """Scatter that nothing shows, as large as errors of poses make it (station.domain.methods.hidden_scatter)."""
    seatings = [run.seating for run in recipe.runs]
    true = np.array([recipe.true_vector(p, seating) for seating in seatings for p in recipe.positions])
    coefficients = {"one-point": 1, "three-point": 2}.get(recipe.method, 4 if recipe.model == "matrix" else 2)
    pose = np.deg2rad(pose_deg(recipe, recipe.axes * (len(true) - coefficients))) if recipe.pose_known else 0.0
    if not pose or len(set(seatings)) < len(seatings) or not hides_scatter(recipe, true):
        return []
    size = float(pose * np.linalg.norm(true, axis=1).max())
    return [_of(HIDDEN_SCATTER, None, size, recipe.unit, Message("assumed-hidden-scatter"))]


def _magnitude(recipe: Recipe) -> Assumption:
    r, value = recipe.reference, magnitude_relative_std(recipe)
    if r.site is not None and r.source != "rate":
        return Assumption("reference.site", value, "1", stated=True, source=Message("assumed-site"))
    if r.gravimeter is not None:
        return Assumption("reference.gravimeter", value, "1", stated=True, source=Message("assumption-stated"))
    if r.source == "rate" and r.magnitude_std is not None:
        return _of("reference.magnitude_std", r.magnitude_std, 0.0, recipe.unit, Message("assumed-rate"))
    sources = {"gravity": "assumed-gravity", "field": "assumed-field-magnitude", "rate": "assumed-rate"}
    source = Message("assumption-stated") if r.magnitude_std is not None else Message(sources[r.source])
    return Assumption("reference.magnitude_std", value, "1", r.magnitude_std is not None, source)


def _of(key: str, stated: float | None, default: float, unit: str, source: Message) -> Assumption:
    if stated is not None:
        return Assumption(key, float(stated), unit, stated=True, source=Message("assumption-stated"))
    return Assumption(key, float(default), unit, stated=False, source=source)
