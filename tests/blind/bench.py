"""A bench of its own: makes samples with something hidden in them, without a line of `station.model`.

Orientations are unit quaternions, covariates are noisy, amplitudes are set by d: the length of what the hidden thing
leaves in white readings once each unit's offset and gain are taken off. Only the recipe's own vocabulary (positions,
seatings, runs) and the table type are shared with the station.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from station.domain.core.types import Labels, SampleTable
from station.domain.recipe import plan
from station.domain.recipe.recipe import Recipe

Array = Any


def q_mul(p: Array, q: Array) -> Array:
    """Hamilton products of quaternions (…, 4), scalar first."""
    w, x, y, z = np.moveaxis(np.asarray(p, float), -1, 0)
    a, b, c, d = np.moveaxis(np.asarray(q, float), -1, 0)
    return np.stack(
        [w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c,
         w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a], -1)  # fmt: skip


def q_small(angle: Array) -> Array:
    """Quaternions of rotation vectors (…, 3)."""
    angle = np.asarray(angle, float)
    half = np.linalg.norm(angle, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), angle / 2 * np.sinc(half / np.pi)], -1)


def q_matrix(R: Array) -> Array:
    """Quaternion of a rotation matrix (Shepperd's best-conditioned branch)."""
    m = np.asarray(R, float)
    trace = np.array([np.trace(m), m[0, 0], m[1, 1], m[2, 2]])
    i = int(np.argmax(trace))
    if i == 0:
        q = np.array([1 + trace[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    else:
        a, b, c = [(0, 1, 2), (1, 2, 0), (2, 0, 1)][i - 1]
        q = np.zeros(4)
        q[0] = m[c, b] - m[b, c]
        q[1 + a], q[1 + b], q[1 + c] = 1 + m[a, a] - m[b, b] - m[c, c], m[b, a] + m[a, b], m[c, a] + m[a, c]
    return q / np.linalg.norm(q)


def q_back(q: Array, v: Array) -> Array:
    """Vectors (…, 3) seen from frames turned by quaternions (…, 4)."""
    inverse = q * np.array([1, -1, -1, -1])
    pure = np.concatenate([np.zeros((*np.shape(v)[:-1], 1)), v], -1)
    return q_mul(q_mul(inverse, pure), q)[..., 1:]


@dataclass(frozen=True)
class Floor:
    """density: of white noise per √Hz; turn: rad a stop; walk: a stop; tail: degrees of freedom of Student's t."""

    density: float = 1e-4
    turn: float = 0.0
    walk: float = 0.0
    tail: float = np.inf


WHITE = Floor()
FULL = Floor(turn=1e-4, walk=1e-5)
HEAVY = Floor(tail=5.0)


@dataclass(frozen=True, eq=False)
class World:
    """Everything about the samples (n) but the readings. unit, run, visit, position, nest (n) codes; stop (n) index
    of the stop; t since the run's start; dwell since the first sample; away since arrival; T true temperature,
    rate of it; power, clamp times; motor level; a, before (n, 3): true vector now and at the stop before;
    nest_q, seat_q (n, 4); up (n, 3)."""

    recipe: Recipe
    unit: Array
    run: Array
    visit: Array
    position: Array
    nest: Array
    stop: Array
    t: Array
    away: Array
    T: Array
    rate: Array
    power: Array
    clamp: Array
    motor: Array
    started: Array
    nest_q: Array
    seat_q: Array
    up: Array
    names: tuple[str, ...] = ()
    seats: tuple[str, ...] = ()
    seat: Array = field(default_factory=lambda: np.zeros(0, int))

    def feel(self, station: Array = 0.0, nest: Array = 0.0, device: Array = 0.0) -> Array:
        """True vectors (n, 3) with parts turned by rotation vectors (n, 3)."""
        zero = np.zeros((len(self.t), 3))
        q = q_mul(q_small(zero + station), q_mul(self.nest_q, q_small(zero + nest)))
        return q_back(q_mul(q_mul(q, self.seat_q), q_small(zero + device)), self.up)

    @cached_property
    def a(self) -> Array:
        """True vectors (n, 3) of an ideal rig."""
        return _kept(self.feel())

    @cached_property
    def before(self) -> Array:
        """True vectors (n, 3) at the stop before; the stop's own at the first of a run."""
        first = np.flatnonzero(np.diff(self.stop, prepend=-1))
        a = self.a[first]
        ahead = np.r_[a[:1], a[:-1]]
        ahead[self.visit[first] == 0] = a[self.visit[first] == 0]
        return _kept(ahead[self.stop])


def _kept(values: Array) -> Array:
    """Values that are made once, and asked for at every stop and axis: nobody may change them."""
    values.setflags(write=False)
    return values


#: What a hidden thing does: new true vectors of the ideal ones, and an addition to the reading.
Hidden = Callable[[World, np.random.Generator], tuple[Array, Array]]


def world(recipe: Recipe, units: int, rng: np.random.Generator, nests: int = 2) -> World:
    """One pass of every unit through every run; moves take 1.5 s."""
    stay = recipe.dwell.longest_s
    rate = recipe.device.rate_hz
    count = round(stay * rate)
    parts: dict[str, list[Array]] = {
        k: []
        for k in (
            "unit",
            "run",
            "visit",
            "position",
            "nest",
            "seat",
            "motor",
            "started",
            "clamp",
            "power",
            "t",
            "away",
            "T",
            "rate",
        )
    }
    names = tuple(p.name for p in recipe.positions)
    seats = ("home", *recipe.seatings)
    clock = 100.0
    for load in range(0, units, nests):
        for r, run in enumerate(recipe.runs):
            order = plan.order_of(recipe, r)
            motor = np.round(rng.uniform(0, 1, len(order)), 2) * (run.motors == "on")
            sway = _sway(rng)
            for u in range(load, min(units, load + nests)):
                for v, position in enumerate(order):
                    away = recipe.settle.time_s + np.arange(count) / rate
                    t = 1.5 + v * (stay + recipe.settle.time_s + 1.5) + away
                    power = t + 3.0 + run.prewarm_s
                    wave = sway(t + clock)
                    # Half a wave from end to end, where it is to be warmer in the middle.
                    w = np.pi / (1.5 + len(order) * (stay + recipe.settle.time_s + 1.5))
                    swing = run.temperature_swing_degC * np.stack([np.sin(w * t), w * np.cos(w * t)])
                    warm = run.temperature_offset_degC + swing[0] + wave[0]
                    parts["T"].append(22 + warm + 2 * (1 - np.exp(-power / 400)))
                    parts["rate"].append(swing[1] + wave[1] + 2 / 400 * np.exp(-power / 400))
                    for key, value in (("t", t), ("away", away), ("power", power), ("clamp", t + 6.0)):
                        parts[key].append(value)
                    for key, whole in (("unit", u), ("run", r), ("visit", v), ("position", names.index(position.name)),
                                       ("nest", (u + r) % nests), ("seat", seats.index(run.seating)),
                                       ("motor", motor[v]), ("started", clock)):  # fmt: skip
                        parts[key].append(np.full(count, whole))
            clock += parts["t"][-1][-1] + 60 + run.prewarm_s
    got = {k: np.concatenate(v) for k, v in parts.items()}
    nest_q = np.array([q_matrix(p.matrix()) for p in recipe.positions])[got["position"]]
    seat_q = np.array([q_matrix(recipe.seating(s)) for s in seats])[got["seat"]]
    stop = np.cumsum(np.diff(got["visit"] + 1000 * got["run"] + 100000 * got["unit"], prepend=0) != 0)
    got["stop"] = stop - stop[0]
    up = np.tile([0.0, 0.0, recipe.reference.strength()], (len(stop), 1))
    stored = World(recipe, nest_q=nest_q, seat_q=seat_q, up=up, names=names, seats=seats, **got)
    by_time = np.lexsort((stored.t, stored.run, stored.unit))
    moved = {k: getattr(stored, k)[by_time] for k in (*got, "nest_q", "seat_q", "up")}
    stops = np.cumsum(np.diff(moved["stop"], prepend=-9) != 0) - 1
    return replace(stored, **{**moved, "stop": stops})


def _sway(rng: np.random.Generator) -> Callable[[Array], tuple[Array, Array]]:
    """The room's slow waves about zero, degC, and their rate."""
    w = 2 * np.pi / rng.uniform([150, 500, 2000], [300, 1200, 6000])
    size, phase = np.array([0.1, 0.25, 0.4]) * rng.standard_normal(3), rng.uniform(0, 6.28, 3)
    return lambda t: (
        np.sin(np.outer(t, w) + phase) @ size,
        (np.cos(np.outer(t, w) + phase) * w) @ size,
    )


def readings(
    w: World,
    felt: Array,
    added: Array,
    floor: Floor,
    rng: np.random.Generator,
    made: np.random.Generator | None = None,
) -> Array:
    """What the units read: their own offset and gain, by which they were `made`, the hidden thing, the floor."""
    units, made = int(w.unit.max()) + 1, made or rng
    offset, gain = 0.02 * made.standard_normal((units, 3)), 1 + 0.01 * made.standard_normal((units, 3))
    sigma = floor.density * np.sqrt(w.recipe.device.rate_hz / 2)
    noise = rng.standard_normal(felt.shape)
    if np.isfinite(floor.tail):
        noise = rng.standard_t(floor.tail, felt.shape) / np.sqrt(floor.tail / (floor.tail - 2))
    stops = int(w.stop.max()) + 1
    turn = floor.turn * rng.standard_normal((stops, 3))
    tilted = felt + np.cross(q_back(w.seat_q, turn[w.stop]), felt) * -1.0
    walk = floor.walk * rng.standard_normal((stops, 3))
    first = np.flatnonzero(np.diff(w.stop, prepend=-1))
    total = np.cumsum(walk, axis=0)
    begin = np.maximum.accumulate(np.where(w.visit[first] == 0, np.arange(stops), 0))
    total = total - total[begin] + walk[begin]
    return tilted * gain[w.unit] + offset[w.unit] + added + total[w.stop] + sigma * noise


def strength(w: World, felt: Array, added: Array, density: float) -> float:
    """d: what is left in the means of the stops, over their white noise, once offset and gain are fitted; the
    changes within a stop count too."""
    gone = felt - w.a + added
    sigma = density * np.sqrt(w.recipe.device.rate_hz / 2)
    count = np.bincount(w.stop)
    means = np.stack([np.bincount(w.stop, c) / count for c in gone.T], 1)
    within = float(np.sum((gone - means[w.stop]) ** 2))
    first = np.flatnonzero(np.diff(w.stop, prepend=-1))
    total = within
    for u in np.unique(w.unit):
        rows = w.unit[first] == u
        for i in range(3):
            A = np.stack([np.ones(rows.sum()), w.a[first][rows, i]], 1)
            y = means[rows, i]
            left = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
            total += float(np.sum(left**2 * count[rows]))
    return float(np.sqrt(total) / sigma)


def table(w: World, reading: Array, rng: np.random.Generator, without: tuple[str, ...] = ()) -> SampleTable:
    """The samples as the station gets them: thermometer 30 mK, clocks 10 ms, motor meter 5 %."""
    stops = int(w.stop.max()) + 1
    T = w.T + 0.03 * rng.standard_normal(stops)[w.stop]
    motor = w.motor * (1 + 0.05 * rng.standard_normal(stops)[w.stop])
    values = {
        "temperature_degC": T,
        "since_power_s": w.power + 0.01 * rng.standard_normal(stops)[w.stop],
        "since_clamp_s": w.clamp + 0.01 * rng.standard_normal(stops)[w.stop],
        "motor": np.maximum(motor, 0.0),
        "started_s": w.started,
    }
    labels = {
        "nest": Labels(("A", "B"), w.nest.astype(np.int32)),
        "seating": Labels(w.seats, w.seat.astype(np.int32)),
    }
    return SampleTable(
        unit=Labels(tuple(f"SN{i + 1:04d}" for i in range(int(w.unit.max()) + 1)), w.unit.astype(np.int32)),
        run=w.run.astype(np.int32),
        visit=w.visit.astype(np.int32),
        position=Labels(w.names, w.position.astype(np.int32)),
        time_s=w.t,
        reading=reading,
        labels={k: v for k, v in labels.items() if k not in without},
        values={k: v for k, v in values.items() if k not in without},
    )


def hide(
    recipe: Recipe,
    hidden: Hidden | None,
    seed: int,
    *,
    units: int = 4,
    floor: Floor = WHITE,
    d: float | None = None,
    size: float = 1.0,
    without: tuple[str, ...] = (),
    world_of: Callable[..., World] = world,
    made: int | None = None,
) -> tuple[SampleTable, Mapping[str, float]]:
    """A table with something hidden at strength d, or at `size` times its usual size; and what is true of it.

    made: tables with the same one are of the same units."""
    rng = np.random.default_rng([seed, 77])
    w = world_of(recipe, units, rng)
    if hidden is None:
        return table(w, readings(w, w.a, np.zeros_like(w.a), floor, rng), rng, without), {"d": 0.0}
    stored = rng.bit_generator.state
    felt, added = _scaled(w, hidden, rng, size)
    if d is not None:
        for _ in range(3):
            size *= d / max(strength(w, felt, added, floor.density), 1e-12)
            rng.bit_generator.state = stored
            felt, added = _scaled(w, hidden, rng, size)
    truth = {"size": size, "d": strength(w, felt, added, floor.density)}
    units_made = None if made is None else np.random.default_rng([made, 78])
    return table(w, readings(w, felt, added, floor, rng, units_made), rng, without), truth


class Scaled(np.random.Generator):
    """Random numbers whose normal draws are `size` times as large: the hidden thing scales, its pattern stays."""

    size = 1.0

    def amplitude(self, typical: float, shape: tuple[int, ...]) -> Array:
        """Coefficients: normal, rms `typical` · size."""
        return typical * self.size * self.standard_normal(shape)


def _scaled(w: World, hidden: Hidden, rng: np.random.Generator, size: float) -> tuple[Array, Array]:
    scaled = Scaled(rng.bit_generator)
    scaled.size = size
    return hidden(w, scaled)
