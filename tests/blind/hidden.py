"""What can be hidden: known causes in a parametrisation of their own, causes of the wrong form, and unknown ones.

Each takes the world and random numbers and gives the true vectors and an addition to the readings. Amplitudes are
normal, per unit or common as the cause would have them; time constants and phases are free.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.blind.bench import Hidden, Scaled, World, q_back

Array = Any
Add = Callable[[World, Scaled], Array]


def _units(w: World) -> int:
    return int(w.unit.max()) + 1


def adds(of: Add) -> Hidden:
    """Something that only adds to the reading."""
    return lambda w, rng: (w.a, of(w, rng))  # type: ignore[arg-type]


def turns(part: str, groups: Callable[[World], tuple[Array, int]], typical: float, axes: int = 3) -> Hidden:
    """A part turned by a random angle in each group."""

    def hidden(w: World, rng: Any) -> tuple[Array, Array]:
        code, count = groups(w)
        angle = np.zeros((count, 3))
        angle[:, :axes] = rng.amplitude(typical, (count, axes))
        return w.feel(**{part: angle[code]}), np.zeros_like(w.a)

    return hidden


def by_unit(w: World) -> tuple[Array, int]:
    """One group a unit."""
    return w.unit, _units(w)


def by_nest(w: World) -> tuple[Array, int]:
    """One group a nest."""
    return w.nest, int(w.nest.max()) + 1


def by_position(w: World) -> tuple[Array, int]:
    """One group a position."""
    return w.position, int(w.position.max()) + 1


def together(w: World) -> tuple[Array, int]:
    """One group."""
    return np.zeros(len(w.t), int), 1


def per_unit(typical: float, form: Callable[[World, Scaled], Array], axes: int = 3) -> Hidden:
    """A form times a coefficient of each unit and axis."""

    def of(w: World, rng: Scaled) -> Array:
        shape = form(w, rng)
        return rng.amplitude(typical, (_units(w), axes))[w.unit] * (shape if shape.ndim == 2 else shape[:, None])

    return adds(of)


def common(typical: float, form: Callable[[World, Scaled], Array]) -> Hidden:
    """A form times one coefficient of each axis."""

    def of(w: World, rng: Scaled) -> Array:
        shape = form(w, rng)
        return rng.amplitude(typical, (1, 3)) * (shape if shape.ndim == 2 else shape[:, None])

    return adds(of)


def _square(w: World, rng: Scaled) -> Array:
    """Both axes that are not square to each other, as an angle between them."""
    yx, zx, zy = rng.amplitude(4e-3, (3, _units(w)))[:, w.unit]
    x, y, z = w.a.T
    return np.stack([yx * y + zx * z, yx * x + zy * z, zx * x + zy * y], 1)


def _products(w: World, rng: Scaled) -> Array:
    c = rng.amplitude(1e-4, (_units(w), 3, 2))[w.unit]
    return w.a * np.stack([c[:, i, 0] * w.a[:, (i + 1) % 3] + c[:, i, 1] * w.a[:, (i + 2) % 3] for i in range(3)], 1)


def _left(low: float, high: float) -> Callable[[World, Scaled], Array]:
    """What is left of the last move, with a free time constant."""

    def form(w: World, rng: Scaled) -> Array:
        return (w.before - w.a) * np.exp(-w.away / np.exp(rng.uniform(np.log(low), np.log(high))))[:, None]

    return form


def _ringing(w: World, rng: Scaled) -> Array:
    tau, f = rng.uniform(0.1, 0.25), rng.uniform(4, 7)
    return (w.before - w.a) * (np.exp(-w.away / tau) * np.cos(2 * np.pi * f * w.away))[:, None]


def _swing(w: World, rng: Scaled) -> Array:
    return np.exp(-w.away / rng.uniform(0.06, 0.25))


def _hysteresis(w: World, rng: Scaled) -> Array:
    return w.before - w.a


def _play(w: World, rng: Scaled) -> Array:
    """Only moves longer than the play leave something, and always the same."""
    step = w.before - w.a
    return np.sign(step) * (np.abs(step) > 0.3)


def _jump(w: World, rng: Scaled) -> Array:
    at = rng.uniform(0.3, 0.7) * w.t.max()
    u, r = rng.integers(_units(w)), rng.integers(int(w.run.max()) + 1)
    return ((w.t > at) & (w.unit == u) & (w.run == r)).astype(float)


def _bumped(w: World, rng: Any) -> tuple[Array, Array]:
    stop = rng.integers(int(w.stop.max()) + 1)
    return w.feel(nest=rng.amplitude(5e-3, (1, 3)) * (w.stop == stop)[:, None]), np.zeros_like(w.a)


def _group(w: World, rng: Scaled) -> Array:
    code, count = by_nest(w)
    return rng.amplitude(5e-4, (count, 3))[code]


#: Known causes: what is hidden, by the id that must be named.
KNOWN: dict[str, Hidden] = {
    "cross-axis": adds(_square),
    "package-rotation": turns("device", by_unit, 4e-3),
    "quadratic": per_unit(3e-4, lambda w, rng: w.a**2),
    "cubic": per_unit(2e-4, lambda w, rng: w.a**3),
    "asymmetry": per_unit(4e-4, lambda w, rng: np.maximum(w.a, 0.0) * 2 - w.a),
    "cross-quadratic": adds(_products),
    "offset-temperature": per_unit(1.5e-4, lambda w, rng: w.T - 21.0),
    "gain-temperature": per_unit(1e-4, lambda w, rng: (w.T - 21.0)[:, None] * w.a),
    "temperature-rate": per_unit(0.2, lambda w, rng: w.rate),
    "warm-up": per_unit(5e-4, lambda w, rng: np.exp(-w.power / np.exp(rng.uniform(np.log(20), np.log(150))))),
    "bias-drift": per_unit(2e-6, lambda w, rng: w.t - 30.0),
    "hysteresis": per_unit(1e-4, _hysteresis),
    "vibration-rectification": per_unit(3e-4, lambda w, rng: w.motor**2),
    "filter-lag": per_unit(3e-3, _left(0.05, 0.3)),
    "nest-tilt": turns("nest", by_nest, 2e-3),
    "base-tilt": turns("station", together, 5e-4, axes=2),
    "index-error": turns("nest", by_position, 5e-4),
    "settling": common(3e-3, _left(0.05, 0.3)),
    "lever-arm": adds(lambda w, rng: rng.amplitude(1e-3, (2, 3))[w.nest] * _swing(w, rng)[:, None]),
    "clamp-creep": per_unit(3e-4, lambda w, rng: np.log1p(w.clamp / np.exp(rng.uniform(np.log(3), np.log(30))))),
    "group-offset": adds(_group),
    "step": common(1e-3, _jump),
    "disturbed-visit": _bumped,
}

#: Causes of another form than the library's, which must be named all the same.
WRONG_FORM: dict[str, tuple[str, Hidden]] = {
    "warm-up with two time constants": (
        "warm-up",
        per_unit(5e-4, lambda w, rng: 0.6 * np.exp(-w.power / 15) + 0.4 * np.exp(-w.power / 120)),
    ),
    "creep as an exponential": ("clamp-creep", per_unit(1e-3, lambda w, rng: 1 - np.exp(-w.clamp / 30))),
    "quadratic offset-temperature": (
        "offset-temperature",
        per_unit(1.5e-4, lambda w, rng: (w.T - 21) + 0.03 * (w.T - 21) ** 2),
    ),
    "ringing": ("settling", common(3e-3, _ringing)),
    "play": ("hysteresis", per_unit(1e-4, _play)),
    "a times its size": ("cubic", per_unit(2e-4, lambda w, rng: w.a * np.abs(w.a))),
    # At tilts of 45° an axis feels 0, .71 or 1: every odd curve through them is a gain and a cube.
    "third harmonic of the input": ("cubic", per_unit(3e-4, lambda w, rng: np.sin(3 * np.pi * w.a))),
    "fifth power": ("cubic", per_unit(3e-4, lambda w, rng: w.a**5 - w.a**3)),
    "sine nonlinearity": ("cubic", per_unit(2e-4, lambda w, rng: np.sin(2.2 * w.a))),
    "eccentric divided head": ("index-error", turns("nest", by_position, 5e-4, axes=1)),
}


def _yaw(w: World, rng: Scaled) -> Array:
    """Depends on where a horizontal arm of the nest points, which gravity does not show."""
    arm = q_back(w.nest_q * np.array([1, -1, -1, -1]), np.tile([1.0, 0, 0], (len(w.t), 1)))
    other = q_back(w.nest_q * np.array([1, -1, -1, -1]), np.tile([0, 1.0, 0], (len(w.t), 1)))
    return np.cos(2 * np.arctan2(arm[:, 1] + other[:, 2], arm[:, 0] + 0.3))


def _wave(w: World, rng: Scaled) -> Array:
    return np.sin(2 * np.pi * w.t / rng.uniform(12, 30) + rng.uniform(0, 6.28))


def _late(w: World, rng: Scaled) -> Array:
    return np.where(w.away > rng.uniform(0.4, 0.6), 1.0, 0.0)


#: Another offset in each run, which begins with a power-on.
ANOTHER_OFFSET = adds(lambda w, rng: rng.amplitude(3e-4, (_units(w) * 9, 3))[w.unit * 9 + w.run])

#: A bump over the temperature: at the few temperatures of these runs no other curve than one of degree 2 or 3.
TEMPERATURE_BUMP = per_unit(3e-4, lambda w, rng: np.exp(-((w.T - w.T.mean()) ** 2) / 2))

#: What no cause of the library explains, with the words that may stand in `depends_on`.
UNKNOWN: dict[str, tuple[set[str], Hidden]] = {
    "periodic in time": ({"time", "order"}, per_unit(3e-4, _wave)),
    "square of the next axis": ({"input"}, per_unit(3e-4, lambda w, rng: np.roll(w.a, 1, axis=1) ** 2)),
    "jump late in each dwell": ({"dwell-phase"}, per_unit(1e-3, _late)),
    "offset of each position": (
        {"position", "input"},
        adds(lambda w, rng: rng.amplitude(3e-4, (int(w.position.max()) + 1, 3))[w.position]),
    ),
    "pull towards even stops": ({"order", "time"}, per_unit(3e-4, lambda w, rng: (-1.0) ** w.visit)),
}
