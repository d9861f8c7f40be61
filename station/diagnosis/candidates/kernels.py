"""Generic kernels: shapes without a physical story that compete with the causes.

When one of them explains the data better than every cause of the library, something is wrong that nobody has
described yet; its name says on what it depends: one covariate, or two of which a product acts (`time*temperature`).
These are the only columns that are not made by the simulation.
"""

from collections.abc import Iterator
from itertools import combinations, combinations_with_replacement

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from station.diagnosis.candidates.bank import PER_UNIT_LEVELS, Candidate
from station.diagnosis.candidates.columns import StopColumns
from station.diagnosis.candidates.temperature_memory import MIN_TEMPERATURE_RANGE, TemperatureMemory
from station.diagnosis.data.reduce import mean_and_contrasts
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.evidence import Pattern
from station.domain.core.types import Array, Floats
from station.model.effect import Effect
from station.model.effects.disturbed_visit import DisturbedVisit
from station.model.effects.nest_tilt import NestTilt
from station.model.forward import resting_stimulus

#: The words of `unknown.depends_on`.
COVARIATES = ("time", "position", "temperature", "input", "dwell-phase", "order", "unit", "group", "motor")
#: The same for what causes are drawn over; the others are drawn over the input or what is read of it.
_ACTS_BY = {
    "dwell": "dwell-phase", "spectrum": "dwell-phase", "order": "order", "step": "order", "run": "order",
    "temperature": "temperature", "temperature-input": "temperature", "temperature-rate": "temperature",
    "time": "time", "since-clamp": "time", "since-power": "time", "position": "position", "visits": "position",
    "motor": "motor", "unit": "unit", "clock": "unit", "group": "group",
}  # fmt: skip
#: Covariates of which products are tried two by two.
FACTORS = ("time", "temperature", "motor", "order", "input", "position")
#: All kernels.
KERNEL_NAMES = (*COVARIATES, *("*".join(pair) for pair in combinations(FACTORS, 2)))
#: The kernel of what changes within the dwells.
MOVING_KERNEL = "dwell-phase"
#: Lag behind the temperature, as a share of a run's duration, and play in it, as a share of a run's range.
LAG, PLAY = 0.3, 0.4
#: Waves of the slow and of the fast kernel of time, half periods in a run.
HALF_WAVES = (range(1, 4), range(1, 11))
#: Whole waves of what an axis feels from one end to the other, in steps that none falls between.
INPUT_WAVES = (1.5, 2.2, 2.9, 3.6, 4.3, 5.0)
#: Whole waves in a run, in steps that none falls between; of more than MOST_FEW only where a run has so many visits a
#: wave.
SWINGS, MOST_FEW, VISITS_A_WAVE = (1.0, 1.7, 2.5, 3.3, 4.1, 4.9), 2.5, 4


def kernel_candidates(view: ResidualView) -> list[Candidate]:
    """Every kernel that these data can show."""
    still = (_time, _order, _position, _temperature, _input, _unit, _group, _motor, _products, _swinging_gain)
    makers = (*still, _changing_rig, _phase)
    return [candidate for make in makers for candidate in make(view)]


def covariates_of(name: str) -> tuple[str, ...]:
    """On what a kernel depends: one word of `depends_on`, or two."""
    return tuple(name.split("*"))


def acts_by(effect: Effect | type[Effect]) -> str:
    """The word of `unknown.depends_on` for what a cause acts by."""
    return _ACTS_BY.get(effect.drawn_over, "input")


def _kernel(name: str, of: str, view: ResidualView, columns: StopColumns) -> Candidate:
    """A kernel shared at one of the scene's levels."""
    code, names = view.scene.group(of)
    return _grouped(name, of, code, names, columns)


def _grouped(name: str, of: str, code: NDArray[np.int32], names: tuple[str, ...], columns: StopColumns) -> Candidate:
    pattern: Pattern = "own" if of in PER_UNIT_LEVELS else "shared"
    return Candidate(name, None, of, pattern, code, names, columns)


def _levels(view: ResidualView, *levels: str) -> Iterator[str]:
    """Levels that differ in these data."""
    taken: set[tuple[bool, bytes]] = set()
    for of in levels:
        key = (of in PER_UNIT_LEVELS and view.grid.units > 1, view.scene.group(of)[0].tobytes())
        if key not in taken:
            taken.add(key)
            yield of


def _changing_rig(view: ResidualView) -> Iterator[Candidate]:
    """A nest that turns, and positions that move, straight with time, temperature or the drive."""
    if not view.scene.recipe.pose_known:
        return
    visits = view.scene.visits
    tilt = view.signature(NestTilt.example(), "common")[0]
    nests = ["nest"] if view.scene.is_recorded("nest") else []
    moved = visits.seat_R.transpose(0, 2, 1)
    for name, functions in _factors(view).items():
        if name in ("order", "input"):
            continue
        x = functions[:, :, :1]
        for of in _levels(view, *nests, "common"):
            yield _kernel(f"{name}*input", of, view, StopColumns.of(tilt * x))
        if name != "motor":
            yield _kernel(f"{name}*position", "position", view, StopColumns.of(moved * x))


def _each_axis(functions: Array) -> Floats:
    """Functions (v, f) on each axis on its own: columns (v, 3, 3·f)."""
    return np.asarray(np.einsum("ij,vf->vifj", np.eye(3), functions).reshape(len(functions), 3, -1), float)


def _time(view: ResidualView) -> Iterator[Candidate]:
    """Waves over the run, slow and fast."""
    t = view.scene.time_s
    share = (t - t.min()) / max(float(np.ptp(t)), 1e-9)
    for waves in HALF_WAVES:
        columns = StopColumns.of(_each_axis(np.cos(np.pi * share[:, None] * np.array(waves))))
        for of in _levels(view, "run", "unit", "common"):
            yield _kernel("time", of, view, columns)
    # Some swings in a run, with any phase: few numbers, where a run has few visits.
    for swing in _swings(view):
        columns = StopColumns.of(_each_axis(np.concatenate(swing, axis=1)))
        for of in _levels(view, "run", "unit", "common"):
            yield _kernel("time", of, view, columns)


def _swings(view: ResidualView) -> Iterator[tuple[Floats, Floats]]:
    """Cosine and sine (v, 1) of some periods in the longest run."""
    t = view.scene.time_s
    share = (t - t.min())[:, None] / max(float(np.ptp(t)), 1e-9)
    most = max(MOST_FEW, view.grid.slot.shape[2] / VISITS_A_WAVE)
    for cycles in (c for c in SWINGS if c <= most):
        yield np.cos(2 * np.pi * cycles * share), np.sin(2 * np.pi * cycles * share)


def _diagonal(values: Floats) -> Floats:
    """Values (v, 3) of each axis on that axis alone: columns (v, 3, 3)."""
    return np.asarray(np.eye(3) * values[:, None, :])


def _order(view: ResidualView) -> Iterator[Candidate]:
    """Every second stop, the step from the one before on any axis, the length of the move, what each axis felt before
    that, and the position before."""
    visits = view.scene.visits
    turn = _each_axis(np.where(visits.visit % 2, -1.0, 1.0)[:, None])
    a = resting_stimulus(view.scene, view.active)
    step = _each_axis(_steps(view, a))
    last_but_one = np.where(visits.previous >= 0, visits.previous[visits.previous], -1)
    earlier = _diagonal(np.where(last_but_one[:, None] >= 0, a[last_but_one] - a, 0.0))
    turned = StopColumns.of(_diagonal(a) * turn)
    length = _each_axis(np.linalg.norm(_steps(view, a), axis=1)[:, None])
    alone = [StopColumns.of(columns) for columns in (turn, step, length, earlier)]
    for of in _levels(view, "unit", "common"):
        yield from (_kernel("order", of, view, columns) for columns in alone)
        yield _kernel("order*input", of, view, turned)
    before = np.where(visits.previous >= 0, visits.position.code[visits.previous], len(visits.position.names))
    names = (*(f"previous:{n}" for n in visits.position.names), "previous:")
    yield _grouped("order", "previous", before.astype(np.int32), names, _ones(view))


def _position(view: ResidualView) -> Iterator[Candidate]:
    """Any offset at each position: along the device's axes, along the nest's, for each unit."""
    visits = view.scene.visits
    places = len(visits.position.names)
    yield _kernel("position", "position", view, _ones(view))
    if np.ptp(visits.seat_R, axis=0).max(initial=0.0) > 1e-6:
        yield _kernel("position", "position", view, StopColumns.of(visits.seat_R.transpose(0, 2, 1)))
    if view.grid.units > 1:
        code = visits.unit.code * places + visits.position.code
        yield _grouped("position", "unit-position", *_packed(code), _ones(view))


def _temperature(view: ResidualView) -> Iterator[Candidate]:
    """Curves of temperature."""
    T = view.scene.temperature_degC
    if T is None or np.ptp(T) < MIN_TEMPERATURE_RANGE:
        return
    # A bend or two of what a straight line leaves, or any curve.
    for degree in (3, 6):
        columns = StopColumns.of(_each_axis(legendre.legvander(_scaled(T), degree)[:, 1:]))
        for of in _levels(view, "unit", "common"):
            yield _kernel("temperature", of, view, columns)
    memory = TemperatureMemory.of(view.scene)
    if memory is not None:
        # What lags behind it, or is on another branch while it rises.
        branches = [memory.branch(PLAY, start) for start in (-1.0, 1.0)]
        functions = np.stack([(T - memory.lagged(LAG)) / memory.range_degC, *branches], axis=1)
        columns = StopColumns.of(_each_axis(functions))
        for of in _levels(view, "unit", "common"):
            yield _kernel("temperature", of, view, columns)


def _steps(view: ResidualView, a: Floats) -> Floats:
    """By how much what each axis feels (v, 3) was another at the stop before."""
    previous = view.scene.visits.previous
    return np.where(previous[:, None] >= 0, a[previous] - a, 0.0)


def _input(view: ResidualView) -> Iterator[Candidate]:
    """Every product of two or three components of the true vector on every axis, that of the two others alone, or some
    waves of its own."""
    a = resting_stimulus(view.scene, view.active)
    a = a / np.max(np.linalg.norm(a, axis=1), initial=1e-300)
    powers = [c for degree in (2, 3) for c in combinations_with_replacement(range(3), degree)]
    products = _each_axis(np.stack([np.prod(a[:, list(c)], axis=1) for c in powers], axis=1))
    waves = [[_diagonal(f(m * np.pi * a)) for f in (np.sin, np.cos)] for m in INPUT_WAVES]
    for columns in (products, _products_of_axes(a)[0], *(np.concatenate(wave, axis=2) for wave in waves)):
        packed = StopColumns.of(columns)
        for of in _levels(view, "unit", "common"):
            yield _kernel("input", of, view, packed)


def _phase(view: ResidualView) -> Iterator[Candidate]:
    """Any course within the dwell: the same at each stop, following the last move, the input, or what is slow."""
    r = view.reduced
    if r.contrast.shape[1] == 0 or not np.any(r.count[:, 1:]):
        return
    blocks = np.arange(r.count.shape[1])
    pulse = (blocks[:, None] == blocks[:-1]).astype(float)
    a = resting_stimulus(view.scene, view.active)
    step = _steps(view, a)
    slow = (np.repeat(x, 3, axis=1) for x in _slow_courses(view))
    for size in (np.ones_like(a), step, a, *slow):
        rows = np.einsum("bp,vi,ij->vbipj", pulse, size, np.eye(3)).reshape(len(a), len(blocks), 3, -1)
        columns = StopColumns.of(*mean_and_contrasts(rows, r.count))
        for of in _levels(view, "unit", "common"):
            yield _kernel(MOVING_KERNEL, of, view, columns)


def _slow_courses(view: ResidualView) -> Iterator[Floats]:
    """Time and temperature (v, 1) from -1 to 1, as far as they vary."""
    T = view.scene.temperature_degC
    for x in (view.scene.time_s, None if T is None or np.ptp(T) < MIN_TEMPERATURE_RANGE else T):
        if x is not None and np.ptp(x) > 0:
            yield _scaled(x)[:, None]


def _unit(view: ResidualView) -> Iterator[Candidate]:
    """Another offset and another gain in each run of each unit."""
    if len(view.scene.group("run")[1]) == view.grid.units:
        return
    a = resting_stimulus(view.scene, view.active)
    yield _kernel("unit", "run", view, _ones(view))
    yield _kernel("unit", "run", view, StopColumns.of(_diagonal(a)))


def _group(view: ResidualView) -> Iterator[Candidate]:
    """Another offset, and another matrix, for each station, nest, lot and operator."""
    a = resting_stimulus(view.scene, view.active)
    matrix = StopColumns.of(np.einsum("ij,vk->vijk", np.eye(3), a).reshape(len(a), 3, 9))
    for of in ("station", "nest", "lot", "operator"):
        if view.scene.is_recorded(of) and len(view.scene.group(of)[1]) > 1:
            yield _kernel("group", of, view, _ones(view))
            yield _kernel("group", of, view, matrix)


def _motor(view: ResidualView) -> Iterator[Candidate]:
    """Curves of the motors' drive: a bend or two, or waves, as of a resonance."""
    motor = view.scene.motor
    if motor is None or not np.ptp(motor):
        return
    for degree in (3, 7):
        columns = StopColumns.of(_each_axis(legendre.legvander(_scaled(motor), degree)[:, 1:]))
        for of in _levels(view, "unit", "common"):
            yield _kernel("motor", of, view, columns)


def _products(view: ResidualView) -> Iterator[Candidate]:
    """Products of two covariates, each straight or bent once, on every axis on its own."""
    factor = _factors(view)
    for one, two in combinations(FACTORS, 2):
        if one not in factor or two not in factor:
            continue
        for bends in (1, 2):
            # (v, 3, functions of the one, functions of the other)
            both = factor[one][:, :, :bends, None] * factor[two][:, :, None, :bends]
            functions = both.reshape(len(both), 3, -1)
            columns = StopColumns.of(np.einsum("ij,vif->vifj", np.eye(3), functions).reshape(len(both), 3, -1))
            for of in _levels(view, "unit", "common") if bends == 1 else ("unit",):
                yield _kernel(f"{one}*{two}", of, view, columns)
    a = resting_stimulus(view.scene, view.active)
    for one in FACTORS:
        if one in factor and (name := f"{one}*input") in KERNEL_NAMES and one != "order":
            # What each axis takes of any, of the product of the two others, or of its own with them.
            for forms in (_each_axis(a), *_products_of_axes(a)):
                columns = StopColumns.of(forms * factor[one][:, :, :1])
                for of in _levels(view, "unit", "common"):
                    yield _kernel(name, of, view, columns)


def _products_of_axes(a: Floats) -> tuple[Floats, Floats]:
    """On each axis the product of the two others (v, 3, 3), and its own with each of them (v, 3, 6)."""
    a = a / np.max(np.linalg.norm(a, axis=1), initial=1e-300)
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    return _diagonal(one * two), np.concatenate([_diagonal(a * one), _diagonal(a * two)], axis=2)


def _swinging_gain(view: ResidualView) -> Iterator[Candidate]:
    """A gain that swings in time, with any phase."""
    a = resting_stimulus(view.scene, view.active)
    for swing in _swings(view) if np.ptp(view.scene.time_s) > 0 else ():
        columns = StopColumns.of(np.concatenate([_diagonal(a * wave) for wave in swing], axis=2))
        for of in _levels(view, "run", "unit", "common"):
            yield _kernel("time*input", of, view, columns)


def _factors(view: ResidualView) -> dict[str, Floats]:
    """Functions (v, 3, f) of each covariate that varies, for each axis: Legendre's first two, or what an axis feels
    now and by how much that is another than at the stop before."""
    scene = view.scene
    a = resting_stimulus(scene, view.active)
    a = a / np.max(np.linalg.norm(a, axis=1), initial=1e-300)
    step = _steps(view, a)
    plain: dict[str, Floats | None] = {"time": scene.time_s, "motor": scene.motor}
    T = scene.temperature_degC
    plain["temperature"] = None if T is None or np.ptp(T) < MIN_TEMPERATURE_RANGE else T
    found = {
        name: np.repeat(legendre.legvander(_scaled(x), 2)[:, None, 1:], 3, axis=1)
        for name, x in plain.items()
        if x is not None and np.ptp(x) > 0
    }
    return {**found, "order": step[:, :, None], "input": np.stack([a, a**2], axis=2)}


def _ones(view: ResidualView) -> StopColumns:
    return StopColumns.of(np.broadcast_to(np.eye(3), (len(view.reduced.mean), 3, 3)))


def _scaled(values: Floats) -> Floats:
    """Values brought to −1 … 1."""
    low, high = float(values.min()), float(values.max())
    return np.asarray(2 * (values - low) / max(high - low, 1e-300) - 1)


def _packed(code: Array) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Codes without gaps, and names for them."""
    names, packed = np.unique(code, return_inverse=True)
    return packed.astype(np.int32), tuple(f"group:{n}" for n in names)


def disturbed_readings(view: ResidualView) -> list[Candidate]:
    """A visit whose reading is wrong by anything, not by a turn alone: a part that still moved, or was bumped. Where
    only lengths are known, a length."""
    code, names = view.scene.group("visit")
    if len(names) < 2:
        return []
    anything = np.broadcast_to(np.eye(3), (len(code), 3, 3)).copy()
    if view.grid.k == 1:
        anything = view.keep.transpose(0, 2, 1) / np.sum(view.keep**2, axis=2, keepdims=True)
    return [Candidate(DisturbedVisit.id, None, "visit", "scan", code, names, StopColumns.of(anything))]
