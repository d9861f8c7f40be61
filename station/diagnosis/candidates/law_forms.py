"""The forms of laws: functions of time, temperature, drive, input and order that no cause of the library follows."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain, combinations, product

import numpy as np

from station.diagnosis.candidates.angle_laws import angle_laws
from station.diagnosis.candidates.motion_kernels import remembered
from station.diagnosis.candidates.motion_laws import motion_laws
from station.diagnosis.candidates.temperature_memory import MIN_TEMPERATURE_RANGE, TemperatureMemory
from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Array, Floats

#: Quantiles at which a covariate may switch, and at which it may bend; periods of its waves, as shares of its range.
SWITCHES, BENDS, PERIODS = (
    tuple(share / 20 for share in range(2, 19)),
    (0.3, 0.5, 0.7, 0.85),
    (0.2, 0.3, 0.45, 0.65, 0.9),
)
#: Quantiles about which something may be there alone, and over what share of the range.
BUMPS, BUMP_SHARE = (0.25, 0.4, 0.55, 0.7), 0.13
#: Steps of a compensation over the whole range of temperature, and where in a step it may begin.
STAIRS, BEGINS = (2.0, 2.25, 2.5, 2.8, 3.15, 3.5, 3.95, 4.4, 5.0), (0.0, 0.25, 0.5, 0.75)
#: Shares of a run at which something may begin that dies away, and after which a third of it is left.
SHOCKS, DECAYS = tuple(share / 12 for share in range(12)), (0.04, 0.12, 0.35)
#: Shares of the whole campaign after which a third is left of what dies away in it.
FADES = (0.08, 0.25)
#: Levels of the motors between which something may switch, at most.
MAX_LEVELS = 24
#: Shares of the stimulus below which a reading is dead, or beyond which it rises no more.
KNEES = (0.2, 0.35, 0.5, 0.7)
#: The same of steps from the visit before, up to twice the stimulus.
STEP_KNEES = (0.25, 0.5, 0.75, 1.0, 1.25)
#: How much steeper an exponential of the input is at its one end than a straight line, in both directions.
STEEP = (1.5, 3.0, 5.0)
#: Half waves from no input to the whole, in steps that none falls between.
HALF_WAVES = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)
#: A step from the visit before that is taken up by play, as a share of the stimulus.
PLAY = 0.3
#: Shares of what one visit left that the next one keeps; the chord of a long move, as a share of the stimulus.
KEPT, LONG_MOVE = (0.4, 0.7), 1.5
#: Lags behind the temperature, as shares of a run's duration, and plays in it, as shares of a run's range.
LAGS, THERMAL_PLAYS = (0.1, 0.3, 1.0), (0.2, 0.5)
#: Quantiles of the temperature at which something goes off, and comes on only beyond the second.
RELAYS = ((0.25, 0.5), (0.35, 0.65), (0.5, 0.75), (0.25, 0.75))
#: The branch on which each run begins: fallen, in the middle, risen.
BRANCHES = (-1.0, 0.0, 1.0)

#: Covariates, joined by *, and the columns (v, 3) of a law; two columns an axis where it has two phases.
Law = tuple[str, tuple[Floats, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Functions (v) of one covariate. plain: a straight line; bent, switched and bumped: at one place each; waves:
    cosine and sine of one period each; fading: large at the beginning and zero at the end."""

    plain: Floats
    bent: tuple[Floats, ...]
    switched: tuple[Floats, ...]
    waves: tuple[tuple[Floats, Floats], ...] = ()
    bumped: tuple[Floats, ...] = ()
    fading: tuple[Floats, ...] = ()


def laws_of_view(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Law]:
    """Every law of what these data have recorded, with the curves of each covariate."""
    a, step = _stimulus(view), steps_of_stimulus(view)
    yield from chain(_offsets(curves), _gains(curves, a), _products(curves, a, step), _crosstalk(curves, a))
    yield from chain(_memories(view), _campaign(view), _stairs(view), _visits_before(view, a, step))
    yield from chain(_products_of_axes(curves, a), _forms_of_input(a), _forms_of_step(a, step))
    yield from chain(_shocks(view), _heat_flows(view, a), _angles(view, a))
    plain = {name: of.plain for name, of in curves.items()}
    yield from ((name, tuple(map(on_every_axis, parts))) for name, parts in motion_laws(view, plain))


def _stimulus(view: ResidualView) -> Floats:
    """What each axis feels at each visit (v, 3), as a share of the most."""
    a = view.nominal_stimulus
    return np.asarray(a / np.max(np.linalg.norm(a, axis=1), initial=1e-300))


def steps_of_stimulus(view: ResidualView) -> Floats:
    """By how much it was another at the visit before (v, 3)."""
    a, previous = _stimulus(view), view.scene.visits.previous
    return np.where(previous[:, None] >= 0, a[previous] - a, 0.0)


def curves_by_covariate(view: ResidualView) -> dict[str, Curves]:
    """The curves of each covariate that varies."""
    scene, found = view.scene, dict[str, Curves]()
    T, motor = scene.temperature_degC, scene.motor
    if T is not None and np.ptp(T) >= MIN_TEMPERATURE_RANGE:
        found["temperature"] = _curves_of(T, centred_values(T))
    if np.ptp(scene.time_s) > 0:
        left = _from_zero(scene.time_s.max() - scene.time_s)
        found["time"] = replace(_curves_of(scene.time_s, _from_zero(scene.time_s)), fading=(left, left**2))
    if motor is not None and np.ptp(motor) > 0:
        between = np.convolve(np.unique(motor), (0.5, 0.5), "valid")
        chosen = between[np.linspace(0, len(between) - 1, min(len(between), MAX_LEVELS)).astype(int)]
        bent = (np.sqrt(np.abs(motor)), motor, motor**3)
        switched = tuple(centred_values(motor > level) for level in chosen)
        # A part of the rig may resonate at one speed.
        curves = _curves_of(motor, _from_zero(motor))
        found["motor"] = replace(curves, bent=bent, switched=switched, waves=())
    return found


def _curves_of(x: Floats, plain: Floats) -> Curves:
    phase = 2 * np.pi * (x - x.min()) / np.ptp(x)
    bends, switches, bumps = (np.quantile(x, shares) for shares in (BENDS, SWITCHES, BUMPS))
    return Curves(
        plain,
        tuple(np.maximum(sign * (x - at), 0.0) for at in bends for sign in (1, -1)),
        tuple(centred_values(x > at) for at in switches),
        tuple((np.cos(phase / p), np.sin(phase / p)) for p in PERIODS),
        tuple(np.exp(-0.5 * ((x - at) / (BUMP_SHARE * np.ptp(x))) ** 2) for at in bumps),
    )


def centred_values(values: Array) -> Floats:
    """Values about their mean, of standard deviation 1."""
    x = np.asarray(values, float)
    x = x - np.add.reduce(x) / len(x)
    return np.asarray(x / max(float(np.sqrt(x @ x / len(x))), 1e-300))


def _from_zero(x: Floats) -> Floats:
    """Values of a mean square of 1 that keep their zero: what grows with the time or the drive is nought without it."""
    return np.asarray(x / max(float(np.sqrt(np.mean(x**2))), 1e-300), float)


def on_every_axis(x: Floats) -> Floats:
    """A function (v) on every axis alike (v, 3)."""
    return np.repeat(x[:, None], 3, axis=1)


def _offsets(curves: Mapping[str, Curves]) -> Iterator[Law]:
    """An offset that bends, switches or swings, or follows a product."""
    for name, of in curves.items():
        # What switches in time is a cause of the library.
        places = (*of.bent, *of.bumped, *(of.switched if name != "time" else ()))
        yield from ((name, (on_every_axis(x),)) for x in places)
        yield from ((name, (on_every_axis(of.plain), on_every_axis(x))) for x in of.bent[::2])
        yield from ((name, (on_every_axis(x), on_every_axis(y))) for x, y in of.waves)
    for (one, x), (two, y) in combinations(curves.items(), 2):
        yield f"{one}*{two}", (on_every_axis(x.plain * y.plain),)


def _memories(view: ResidualView) -> Iterator[Law]:
    """An offset on another branch while the temperature rises, alone or beside a straight line, or one that lags; and
    what follows whether or how fast the temperature changes, other than in proportion."""
    rate = view.scene.temperature_rate
    if rate is not None and np.ptp(rate) > 0:
        yield from (("temperature", (on_every_axis(centred_values(form)),)) for form in _forms_of_rate(rate))
        yield from _by_branch(view, rate)
    memory = TemperatureMemory.of(view.scene)
    if memory is None:
        return
    plain = on_every_axis(centred_values(memory.temperature_degC))
    for play, start in product(THERMAL_PLAYS, BRANCHES):
        branch = on_every_axis(memory.branch(play, start))
        yield "temperature", (branch,)
        yield "temperature", (plain, branch)
    for limits in RELAYS:
        off, on = np.quantile(memory.temperature_degC, limits)
        yield "temperature", (on_every_axis(centred_values(memory.relay(float(off), float(on)))),)
    for lag in LAGS:
        behind = memory.temperature_degC - memory.lagged(lag)
        yield "temperature", (plain, on_every_axis(behind / memory.range_degC))


def _forms_of_rate(rate: Floats) -> tuple[Floats, ...]:
    """What follows whether or how fast the temperature changes, or that in one direction alone."""
    return np.sign(rate), np.abs(rate), rate**2, np.maximum(rate, 0.0), np.minimum(rate, 0.0)


def _by_branch(view: ResidualView, rate: Floats) -> Iterator[Law]:
    """A coefficient of temperature that is another while it rises, or rises fast."""
    T = view.scene.temperature_degC
    if T is None or np.ptp(T) < MIN_TEMPERATURE_RANGE:
        return
    plain = on_every_axis(centred_values(T))
    for least in (0.0, float(np.median(rate))):
        rises = on_every_axis((rate > least).astype(float))
        if np.ptp(rises) > 0:
            yield "temperature", (plain * rises,)
            yield "temperature", (plain, plain * rises)


def _shocks(view: ResidualView) -> Iterator[Law]:
    """What is there at once at some time of a run, and dies away."""
    t = view.scene.time_s
    share = (t - t.min()) / max(float(np.ptp(t)), 1e-300)
    for begun, decay in product(SHOCKS, DECAYS):
        yield "time", (on_every_axis((share >= begun) * np.exp(-np.maximum(share - begun, 0.0) / decay)),)


def _heat_flows(view: ResidualView, a: Floats) -> Iterator[Law]:
    """A gain that differs while the temperature rises, and heat that flows upwards through a part: what one axis feels
    shows which side is down."""
    rate = view.scene.temperature_rate
    if rate is None or not np.ptp(rate):
        return
    flow = _from_zero(rate)
    # Where the temperature only rises, its side is a gain.
    for form in (x for x in (flow, np.sign(rate), centred_values(rate)) if np.ptp(x) > 0):
        yield "temperature*input", (on_every_axis(form) * a,)
    yield from (("temperature*input", (on_every_axis(flow * side),)) for side in a.T)


def fades_of_campaign(view: ResidualView) -> list[Floats]:
    """What dies away (v) over all runs of a campaign: stress that is let go, glue that hardens."""
    started = view.scene.started_s
    if started is None or not np.ptp(started):
        return []
    clock = started + view.scene.time_s
    share = (clock - clock.min()) / np.ptp(clock)
    return [np.exp(-share / fade) for fade in FADES]


def _campaign(view: ResidualView) -> Iterator[Law]:
    """An offset that swings by the clock of the campaign, on through all runs."""
    started = view.scene.started_s
    if started is not None and len(view.scene.group("run")[1]) > view.grid.units:
        clock = started + view.scene.time_s
        waves = _curves_of(clock, _from_zero(clock)).waves
        yield from (("time", (on_every_axis(x), on_every_axis(y))) for x, y in waves)


def _stairs(view: ResidualView) -> Iterator[Law]:
    """An offset that climbs with the temperature and falls back at once, as a compensation in steps leaves it."""
    T = view.scene.temperature_degC
    if T is not None and np.ptp(T) >= MIN_TEMPERATURE_RANGE:
        share = (T - T.min()) / np.ptp(T)
        for steps, begun in product(STAIRS, BEGINS):
            yield "temperature", (on_every_axis(centred_values((steps * share + begun) % 1.0)),)


def _visits_before(view: ResidualView, a: Floats, step: Floats) -> Iterator[Law]:
    """What earlier visits have left, the most recent weighing most: long moves, all moves, what was felt."""
    length = np.linalg.norm(step, axis=1)
    for kept in KEPT:
        for left in ((length > LONG_MOVE).astype(float), length):
            yield "order", (on_every_axis(remembered(left[:, None], view, kept)[:, 0]),)
        yield "order", (remembered(a + step, view, kept),)


def _gains(curves: Mapping[str, Curves], a: Floats) -> Iterator[Law]:
    """The same for a gain; a gain straight with temperature is a cause of the library."""
    for name, of in curves.items():
        plain = () if name == "temperature" else (of.plain,)
        yield from ((f"{name}*input", (on_every_axis(x) * a,)) for x in (*plain, *of.bent, *of.switched, *of.bumped))
        yield from ((f"{name}*input", (on_every_axis(x) * a, on_every_axis(y) * a)) for x, y in of.waves)
    for (one, x), (two, y) in combinations(curves.items(), 2):
        yield f"{one}*{two}*input", (on_every_axis(x.plain * y.plain) * a,)


def _products(curves: Mapping[str, Curves], a: Floats, step: Floats) -> Iterator[Law]:
    """What bends the input or follows the previous visit, times a covariate."""
    for name, of in curves.items():
        x = on_every_axis(of.plain)
        yield from ((f"{name}*input", (x * form,)) for form in (a**2, np.abs(a), a**3))
        yield from ((f"{name}*order", (x * form,)) for form in (step, np.abs(a) * step, _side(step), np.abs(step)))
        yield from ((f"{name}*order", (on_every_axis(x) * step,)) for x in of.fading)


def _crosstalk(curves: Mapping[str, Curves], a: Floats) -> Iterator[Law]:
    """What an axis picks up from the next two, varying with a covariate."""
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    for name, of in curves.items():
        for wave in of.waves:
            yield f"{name}*input", tuple(on_every_axis(x) * other for x in wave for other in (one, two))
        for x in (of.plain, *of.switched[:: max(len(of.switched) // 4, 1)]):
            yield f"{name}*input", (on_every_axis(x) * one, on_every_axis(x) * two)


def _products_of_axes(curves: Mapping[str, Curves], a: Floats) -> Iterator[Law]:
    """What an axis picks up from the size or the product of others, or of itself and another one, varying with a
    covariate."""
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    for name, of in curves.items():
        x = on_every_axis(of.plain)
        forms = (a * one, a * two), (one * two,), (np.abs(one), np.abs(two))
        yield from ((f"{name}*input", tuple(x * form for form in some)) for some in forms)


def _forms_of_input(a: Floats) -> Iterator[Law]:
    """What is neither a square, a cube nor a size of the input."""
    size = np.abs(a)
    for knee in KNEES:
        yield "input", (np.sign(a) * np.minimum(size, knee),)
        yield "input", (np.maximum(size - knee, 0.0),)
        yield from (("input", (np.maximum(sign * a - knee, 0.0),)) for sign in (1, -1))
    yield from (("input", (np.sin(m * np.pi * a),)) for m in HALF_WAVES)
    yield from (("input", (np.cos(m * np.pi * a),)) for m in HALF_WAVES)
    yield from (("input", (np.exp(sign * k * a - k),)) for k in STEEP for sign in (1, -1))
    yield from (("input", (form,)) for form in (np.tanh(4 * a), a**5, a * size))
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    yield from (("input", (form(one), form(two))) for form in (np.abs, np.square))
    yield from (("input", forms) for forms in ((a**2 * one, a**2 * two), (one * two,), (a * one * two,)))
    yield from (("input", (a * form(one), a * form(two))) for form in (np.abs, np.square, _side))


def _angles(view: ResidualView, a: Floats) -> Iterator[Law]:
    """What follows the angle of the part, and that of its nest where the part was turned in it."""
    yield from (("input", parts) for parts in angle_laws(a))
    seat = view.scene.visits.seat_R
    if view.scene.recipe.pose_known and np.any(np.ptp(seat, axis=0) > 1e-6):
        yield from (("position", parts) for parts in angle_laws(np.einsum("vij,vj->vi", seat, a)))


def laws_of_nests(view: ResidualView, curves: Mapping[str, Curves]) -> Iterator[Law]:
    """What may be another in each nest: a bend, a memory, a course. None where nests and units are the same."""
    code, names = view.scene.group("nest")
    both = len(np.unique(np.stack([view.scene.visits.unit.code, code]), axis=1).T)
    if len(names) < 2 or both == len(names) == view.grid.units:
        return
    a = _stimulus(view)
    yield from (("input", (form,)) for form in (a, a**2, np.abs(a)))
    yield "order", (steps_of_stimulus(view),)
    yield from ((name, (on_every_axis(of.plain),)) for name, of in curves.items())


def _side(a: Floats) -> Floats:
    """Which side of level each axis is on, 0 where it is level."""
    return np.asarray(np.sign(a) * (np.abs(a) > 1e-6))


def _forms_of_step(a: Floats, step: Floats) -> Iterator[Law]:
    """What follows the step from the previous visit other than in proportion."""
    size, way = np.abs(step), _side(step)
    yield from (("order*input", (form * step,)) for form in (np.abs(a), a**2, a))
    yield from (
        ("order", (form,)) for form in (way, way * np.minimum(size, PLAY), way * np.sqrt(size), step * size, size)
    )
    yield from (("order", (np.roll(form, 1, axis=1), np.roll(form, 2, axis=1))) for form in (step, size))
    before = a + step
    yield from (("order", (form,)) for form in (before**2, np.abs(before)))
    yield "order", (np.roll(before, 1, axis=1), np.roll(before, 2, axis=1))
    yield from (("order*input", (form * a,)) for form in (before, way))
    yield "order*input", (np.roll(before, 1, axis=1) * a, np.roll(before, 2, axis=1) * a)
    for knee in STEP_KNEES:
        beyond = np.maximum(size - knee, 0.0)
        yield from (("order", (form,)) for form in (way * (size > knee), way * beyond, beyond))
    move = on_every_axis(np.linalg.norm(step, axis=1))
    yield from (("order", (form,)) for form in (move, step * move, way * move))
