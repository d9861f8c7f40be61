"""Hidden effects outside the library: products and bends of covariates, other exponents, two things mixed.

Each stands with the words of which at least one must be in `depends_on`, unless it is told apart from no cause of the
library at that strength. Nothing here shares a line with the station's simulation or with its kernels.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.blind.bench import Hidden, Scaled, World
from tests.blind.hidden import UNKNOWN, adds, per_unit

Array = Any


def _share(values: Array) -> Array:
    """Values brought to 0 … 1."""
    return (values - values.min()) / max(np.ptp(values), 1e-12)


def _temperature_by_time(w: World, rng: Scaled) -> Array:
    return _share(w.T) * np.sin(np.pi * _share(w.t))


def _bent_temperature_by_input(w: World, rng: Scaled) -> Array:
    return ((w.T - w.T.mean()) ** 2)[:, None] * w.a


def _temperature_by_square(w: World, rng: Scaled) -> Array:
    return (w.T - w.T.mean())[:, None] * w.a**2


def _gain_that_drifts(w: World, rng: Scaled) -> Array:
    return np.expm1(1.5 * _share(w.t))[:, None] * w.a


def _gain_under_vibration(w: World, rng: Scaled) -> Array:
    return (w.motor**1.5)[:, None] * w.a


def _root_of_motor(w: World, rng: Scaled) -> Array:
    return np.sin(2.5 * np.pi * w.motor)


def _hysteresis_with_temperature(w: World, rng: Scaled) -> Array:
    return (w.T - w.T.mean())[:, None] * (w.before - w.a)


def _hysteresis_with_load(w: World, rng: Scaled) -> Array:
    return np.abs(w.a) * (w.before - w.a)


def _tired_with_moves(w: World, rng: Scaled) -> Array:
    return _share(w.t)[:, None] * (w.before - w.a)


def _run_in_with_moves(w: World, rng: Scaled) -> Array:
    return np.exp(-2 * _share(w.t))[:, None] * (w.before - w.a)


def _vibration_by_time(w: World, rng: Scaled) -> Array:
    return w.motor * np.cos(np.pi * _share(w.t))


def _vibration_by_temperature(w: World, rng: Scaled) -> Array:
    return w.motor * (w.T - w.T.mean())


def _size_under_vibration(w: World, rng: Scaled) -> Array:
    return w.motor[:, None] * np.abs(w.a)


def _product_that_drifts(w: World, rng: Scaled) -> Array:
    return w.a * np.roll(w.a, 1, axis=1) * (w.t / w.t.max())[:, None]


def _temperature_on_crosstalk(w: World, rng: Scaled) -> Array:
    return (w.T - w.T.mean())[:, None] * np.roll(w.a, 1, axis=1)


def _hot_switch(w: World, rng: Scaled) -> Array:
    return (np.quantile(w.T, rng.uniform(0.4, 0.7)) < w.T).astype(float)


def _driven_hard(w: World, rng: Scaled) -> Array:
    return (w.motor > 0.6).astype(float)


def _gain_that_jumps(w: World, rng: Scaled) -> Array:
    return (w.t > rng.uniform(0.4, 0.6) * w.t.max())[:, None] * w.a


def _across_the_step(w: World, rng: Scaled) -> Array:
    return np.roll(w.before - w.a, 1, axis=1)


def _arriving_under_vibration(w: World, rng: Scaled) -> Array:
    return w.motor * np.exp(-w.away / 0.25)


def _each_nest_by(course: Callable[[World], Array]) -> Hidden:
    """An offset of each nest that follows something."""

    return adds(lambda w, rng: rng.amplitude(3e-4, (2, 3))[w.nest] * course(w)[:, None])


def _base_gives_under_load(w: World, rng: Any) -> tuple[Array, Array]:
    """The rig leans the more, the harder its motors pull."""
    lean = np.array([*rng.amplitude(3e-4, (2,)), 0.0])
    return w.feel(station=lean * w.motor[:, None]), np.zeros_like(w.a)


def _shock_that_fades(w: World, rng: Scaled) -> Array:
    """One unit in one run: from some moment on another offset, which dies away within some visits."""
    since = w.t - rng.uniform(0.2, 0.6) * w.t.max()
    hit = (w.unit == 0) & (w.run == int(w.run.max())) & (since >= 0)
    return np.where(hit, np.exp(-np.maximum(since, 0.0) / (0.12 * w.t.max())), 0.0)


def _swinging_gain(w: World, rng: Scaled) -> Array:
    """Another phase in each run of each unit."""
    at = 2 * np.pi * rng.uniform(1.2, 2.6) * w.t / w.t.max() + 2.4 * (w.run + 5 * w.unit)
    return np.sin(at)[:, None] * w.a


def _last_but_one(w: World, rng: Scaled) -> Array:
    """What was felt two visits ago still tells."""
    first = np.flatnonzero(np.diff(w.stop, prepend=-1))
    before = w.before[first]
    ahead = np.r_[before[:1], before[:-1]]
    ahead[w.visit[first] < 2] = before[w.visit[first] < 2]
    return ahead[w.stop] - w.a


def _by_the_length_of_the_move(w: World, rng: Scaled) -> Array:
    return (w.before - w.a) * _move(w)[:, None]


def _dwell_with_temperature(w: World, rng: Scaled) -> Array:
    return (w.T - w.T.mean()) * np.exp(-w.away / 0.3)


def _square_that_comes_on(w: World, rng: Scaled) -> Array:
    return w.a**2 * (1 - np.exp(-w.away / 0.3))[:, None]


def _drive_before(w: World, rng: Scaled) -> Array:
    first = np.flatnonzero(np.diff(w.stop, prepend=-1))
    before = np.r_[0.0, w.motor[first][:-1]]
    return np.where(w.visit[first] > 0, before - w.motor.mean(), 0.0)[w.stop]


def _long_moves_remembered(w: World, rng: Scaled) -> Array:
    first, left = np.flatnonzero(np.diff(w.stop, prepend=-1)), 0.0
    come_to = np.zeros(len(first))
    for i, (at, long) in enumerate(zip(first, _move(w)[first] > 1.6, strict=True)):
        left = 0.65 * left * (w.visit[at] > 0) + long
        come_to[i] = left
    return come_to[w.stop]


def _day_and_night(w: World, rng: Scaled) -> Array:
    return np.sin(2 * np.pi * 1.3 * _share(w.started + w.t) + 0.7)


def _seated_anew(w: World, rng: Any) -> tuple[Array, Array]:
    """Each run of each unit begins with another angle in the nest."""
    turn = rng.amplitude(3e-4, (int(w.unit.max()) + 1, int(w.run.max()) + 1, 3))
    return w.feel(nest=turn[w.unit, w.run]), np.zeros_like(w.a)


def _move(w: World) -> Array:
    return np.linalg.norm(w.before - w.a, axis=1)


#: What is hidden, with the words that may stand in `depends_on`.
OUTSIDE: dict[str, tuple[set[str], Hidden]] = {
    **UNKNOWN,
    "temperature by time": ({"temperature", "time"}, per_unit(3e-4, _temperature_by_time)),
    "square of temperature on the gain": ({"temperature", "input"}, per_unit(1e-5, _bent_temperature_by_input)),
    "temperature on the square": ({"temperature", "input"}, per_unit(1e-4, _temperature_by_square)),
    "gain that drifts": ({"time", "input"}, per_unit(3e-4, _gain_that_drifts)),
    "gain under vibration": ({"motor", "input"}, per_unit(3e-4, _gain_under_vibration)),
    "resonance of the drive": ({"motor"}, per_unit(3e-4, _root_of_motor)),
    "hysteresis with temperature": ({"temperature", "order"}, per_unit(3e-4, _hysteresis_with_temperature)),
    "hysteresis with load": ({"order", "input"}, per_unit(3e-4, _hysteresis_with_load)),
    "hysteresis that grows": ({"order", "time"}, per_unit(3e-4, _tired_with_moves)),
    "hysteresis that fades": ({"order", "time"}, per_unit(3e-4, _run_in_with_moves)),
    "size under vibration": ({"motor", "input"}, per_unit(3e-4, _size_under_vibration)),
    "temperature on crosstalk": ({"temperature", "input"}, per_unit(3e-5, _temperature_on_crosstalk)),
    "product of axes that drifts": ({"time", "input"}, per_unit(3e-4, _product_that_drifts)),
    "switch of temperature": ({"temperature"}, per_unit(3e-4, _hot_switch)),
    "switch of the drive": ({"motor"}, per_unit(3e-4, _driven_hard)),
    "gain that jumps": ({"time", "input"}, per_unit(3e-4, _gain_that_jumps)),
    "vibration by time": ({"motor", "time"}, per_unit(3e-4, _vibration_by_time)),
    "hysteresis across axes": ({"order"}, per_unit(3e-4, _across_the_step)),
    "arrival under vibration": ({"dwell-phase", "motor"}, per_unit(3e-4, _arriving_under_vibration)),
    "nest that creeps in the run": ({"time", "group"}, _each_nest_by(lambda w: _share(w.t))),
    "nest that warms": ({"temperature", "group"}, _each_nest_by(lambda w: w.T - w.T.mean())),
    "base that gives under load": ({"motor"}, _base_gives_under_load),
    "shock that fades": ({"time"}, per_unit(3e-4, _shock_that_fades)),
    "swinging gain": ({"time", "input"}, per_unit(3e-4, _swinging_gain)),
    "position before the last": ({"order"}, per_unit(3e-4, _last_but_one)),
    "course of the dwell by temperature": ({"dwell-phase"}, per_unit(3e-5, _dwell_with_temperature)),
    "hysteresis by the length of the move": ({"order"}, per_unit(3e-4, _by_the_length_of_the_move)),
    "nest that gives with the move": ({"order", "group"}, _each_nest_by(_move)),
    "square that comes on in the dwell": ({"dwell-phase", "input"}, per_unit(3e-4, _square_that_comes_on)),
    "drive at the visit before": ({"motor", "order"}, per_unit(3e-4, _drive_before)),
    "long moves that are remembered": ({"order", "time"}, per_unit(3e-4, _long_moves_remembered)),
    "day and night": ({"time", "unit"}, per_unit(3e-4, _day_and_night)),
    "seated anew": ({"unit", "input"}, _seated_anew),
    "vibration by temperature": ({"motor", "temperature"}, per_unit(3e-4, _vibration_by_temperature)),
}
