"""Laws that nobody told the station of: made of numpy alone, without a line of its grammar.

Each law says which family of the grammar it is, as text, where it is one; constants are drawn anywhere, off every grid.
"""

# ruff: noqa: ARG001, ARG005 - every shape takes the same arguments, whichever it needs

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from station.domain.core.types import SampleTable
from tests.blind.bench import WHITE, World, readings, strength, table, world
from tests.blind.recipes import recipe

Array = Any
#: A function of the world and random numbers: (n) for an axis i and another one j.
Shape = Callable[[World, Any, int, int], Array]


@dataclass(frozen=True)
class Law:
    """added (n, 3) at size 1; families of its terms, none where the grammar cannot express it; axis it acts on most."""

    name: str
    added: Array
    families: tuple[tuple[str, str], ...]
    axis: int


@dataclass(frozen=True, slots=True, eq=False)
class Campaign:
    """A table with a law in it, or none; added (n, 3): what it adds to the readings."""

    law: Law | None
    table: SampleTable
    world: World
    added: Array


def campaign(kind: Callable[[World, Any], Law] | None, d: float, seed: int, units: int) -> Campaign:
    """Units through tilt-24 three times with a law of strength d."""
    rng = np.random.default_rng([seed, 4242])
    w = world(recipe(), units, rng)
    law = None if kind is None else kind(w, rng)
    added = np.zeros_like(w.a) if law is None else law.added
    for _ in range(0 if law is None else 2):
        added = added * (d / max(float(strength(w, w.a, added, WHITE.density)), 1e-300))
    return Campaign(law, table(w, readings(w, w.a, added, WHITE, rng), rng), w, added)


INPUTS: Mapping[str, Shape] = {
    "one": lambda w, rng, i, j: np.ones(len(w.t)),
    "own": lambda w, rng, i, j: w.a[:, i],
    "other": lambda w, rng, i, j: w.a[:, j],
    "own-squared": lambda w, rng, i, j: w.a[:, i] ** 2,
    "own-other": lambda w, rng, i, j: w.a[:, i] * w.a[:, j],
    "others": lambda w, rng, i, j: w.a[:, (i + 1) % 3] * w.a[:, (i + 2) % 3],
    "own-cubed": lambda w, rng, i, j: w.a[:, i] ** 3,
    "own-size": lambda w, rng, i, j: np.abs(w.a[:, i]),
    "other-size": lambda w, rng, i, j: np.abs(w.a[:, j]),
    "step": lambda w, rng, i, j: (w.before - w.a)[:, i],
}


def _decay(clock: str) -> Shape:
    def decay(w: World, rng: Any, i: int, j: int) -> Array:
        span = float(np.ptp(w.t))
        t = getattr(w, clock)
        return np.exp(-t / np.exp(rng.uniform(np.log(0.08 * span), np.log(0.8 * span))))

    return decay


def _wave(w: World, rng: Any, i: int, j: int) -> Array:
    f = rng.uniform(1.2 / np.ptp(w.t), 8 / np.ptp(w.t))
    return np.sin(2 * np.pi * f * w.t + rng.uniform(0, 2 * np.pi))


MODULATORS: Mapping[str, Shape] = {
    "constant": lambda w, rng, i, j: np.ones(len(w.t)),
    "temperature": lambda w, rng, i, j: w.T - rng.uniform(15, 35),
    "temperature-squared": lambda w, rng, i, j: (w.T - rng.uniform(18, 30)) ** 2,
    "temperature-rate": lambda w, rng, i, j: w.rate,
    "time": lambda w, rng, i, j: w.t,
    "root-time": lambda w, rng, i, j: np.sqrt(w.t),
    "decay": _decay("t"),
    "motor": lambda w, rng, i, j: w.motor,
    "motor-squared": lambda w, rng, i, j: w.motor**2,
    "wave": _wave,
}
#: What every calibration takes up.
ABSORBED = {("one", "constant"), ("own", "constant")}
#: Causes of the library are no unknowns.
KNOWN = {
    ("one", "temperature"), ("own", "temperature"), ("one", "temperature-squared"), ("own", "temperature-squared"),
    ("one", "temperature-rate"), ("one", "time"), ("one", "motor-squared"), ("own-squared", "constant"),
    ("own-cubed", "constant"), ("own-size", "constant"), ("step", "constant"), ("other", "constant"),
    ("own-other", "constant"),
}  # fmt: skip
FAMILIES = tuple((i, m) for i in INPUTS for m in MODULATORS if (i, m) not in ABSORBED | KNOWN)


def _term(w: World, rng: Any, family: tuple[str, str]) -> tuple[Array, int]:
    """One term: on one axis with one coefficient for all, or on every axis with coefficients of each unit."""
    axis = int(rng.integers(3))
    constants = int(rng.integers(1 << 30))
    added = np.zeros_like(w.a)
    alone = rng.uniform() < 0.6
    for i in (axis,) if alone else range(3):
        j = (i + 1 + int(rng.integers(2))) % 3
        again = np.random.default_rng(constants)
        shape = INPUTS[family[0]](w, again, i, j) * MODULATORS[family[1]](w, again, i, j)
        size = rng.standard_normal(1 if alone else int(w.unit.max()) + 1)
        added[:, i] = shape * (size[0] if alone else size[w.unit])
    return added, axis


def in_grammar(w: World, rng: Any) -> Law:
    """One term of the grammar."""
    family = FAMILIES[int(rng.integers(len(FAMILIES)))]
    added, axis = _term(w, rng, family)
    return Law("·".join(family), added, (family,), axis)


def two_terms(w: World, rng: Any) -> Law:
    """Two terms of about one strength."""
    one, two = (FAMILIES[int(i)] for i in rng.permutation(len(FAMILIES))[:2])
    (a, axis), (b, _) = _term(w, rng, one), _term(w, rng, two)
    added = a / np.std(a) + b / np.std(b)
    return Law("·".join(one) + " + " + "·".join(two), added, (one, two), axis)


def _scramble(code: Array, rng: Any) -> Array:
    """Another number for each code, at random."""
    return rng.standard_normal(int(code.max()) + 1)[code]


def _lagging(w: World, rng: Any) -> Array:
    """What the temperature is ahead of something that follows it late, run by run of a unit."""
    ahead, late = np.empty_like(w.T), rng.uniform(0.1, 0.3) * np.ptp(w.t)
    for rows in (np.flatnonzero((w.unit == u) & (w.run == r)) for u in np.unique(w.unit) for r in np.unique(w.run)):
        follows = w.T[rows[0]]
        for before, now in zip(np.r_[rows[0], rows[:-1]], rows, strict=True):
            follows += (w.T[now] - follows) * (1 - np.exp(-(w.t[now] - w.t[before]) / late))
            ahead[now] = w.T[now] - follows
    return ahead


def _phase(w: World, rng: Any) -> Array:
    """Two to six rounds in a run."""
    return 2 * np.pi * rng.uniform(2, 6) / np.ptp(w.t) * w.t + rng.uniform(0, 6)


def _off(w: World, rng: Any) -> Array:
    """Distance from some temperature."""
    return w.T - rng.uniform(20, 30)


INEXPRESSIBLE: Mapping[str, Shape] = {
    "chirp": lambda w, rng, i, j: w.a[:, i] * np.sin(rng.uniform(8, 14) * (w.t / np.ptp(w.t)) ** 2 * np.pi),
    "three covariates": lambda w, rng, i, j: w.a[:, j] * (w.T - 26) * (w.motor - 0.4),
    "position and run": lambda w, rng, i, j: _scramble(w.position + 24 * w.run, rng),
    "telegraph": lambda w, rng, i, j: np.sign(_scramble(w.visit + 24 * w.run, rng)) * w.a[:, i],
    "resonance": lambda w, rng, i, j: w.a[:, j] / (1 + ((w.motor - rng.uniform(0.3, 0.7)) / 0.04) ** 2),
    "order and drive": lambda w, rng, i, j: (w.before - w.a)[:, i] * (w.motor - 0.5) * (2.0 * (w.visit % 2) - 1),
    "patches": lambda w, rng, i, j: np.sign(np.sin(7 * w.a[:, i] + 5 * w.a[:, j]) * np.sin(w.t / 7 + w.run)),
    "bursts": lambda w, rng, i, j: np.where(_scramble(w.visit + 24 * w.run + 72 * w.unit, rng) > 1.2, 1.0, 0.0),
    "square wave": lambda w, rng, i, j: w.a[:, i] * np.sign(np.sin(_phase(w, rng))),
    "rate squared": lambda w, rng, i, j: w.rate**2,
    "two-tilt wave": lambda w, rng, i, j: np.sin(rng.uniform(3, 6) * w.a[:, i]) * np.sin(rng.uniform(3, 6) * w.a[:, j]),
    "unit and run": lambda w, rng, i, j: _scramble(10 * w.unit + w.run, rng) * w.a[:, i] ** 2,
    "backlash": lambda w, rng, i, j: np.sign((w.before - w.a)[:, i]) * w.a[:, j],
    "motor threshold": lambda w, rng, i, j: (w.motor > rng.uniform(0.4, 0.7)) * w.a[:, j],
    "exponential": lambda w, rng, i, j: np.exp(rng.uniform(2, 4) * w.a[:, i]) * _off(w, rng),
    "line in temperature": lambda w, rng, i, j: (
        w.a[:, j] / (1 + ((w.T - np.quantile(w.T, rng.uniform(0.2, 0.8))) / (0.12 * np.ptp(w.T))) ** 2)
    ),
    "triangle": lambda w, rng, i, j: np.abs(_phase(w, rng) / (2 * np.pi) % 1 - 0.5) * w.a[:, j],
    "time and temperature": lambda w, rng, i, j: w.t * _off(w, rng),
    "temperature and motor": lambda w, rng, i, j: _off(w, rng) * w.motor,
    "root of size": lambda w, rng, i, j: np.sqrt(np.abs(w.a[:, j])) * _off(w, rng),
    "damped wave": lambda w, rng, i, j: np.exp(-w.t / np.ptp(w.t) * rng.uniform(2, 5)) * np.sin(_phase(w, rng)),
    "modulated wave": lambda w, rng, i, j: (1 + w.a[:, j]) * np.sin(_phase(w, rng)) * (w.T - 25),
    "lagging temperature": lambda w, rng, i, j: _lagging(w, rng) * w.a[:, i],
    "staircase": lambda w, rng, i, j: _scramble((5.99 * (w.T - w.T.min()) / np.ptp(w.T)).astype(int), rng),
    "bump": lambda w, rng, i, j: np.exp(-0.5 * ((w.t / np.ptp(w.t) - rng.uniform(0.2, 0.8)) / 0.07) ** 2) * w.a[:, j],
    "ratio": lambda w, rng, i, j: w.a[:, i] / (1.15 + w.a[:, j]) * w.motor,
    "larger of two": lambda w, rng, i, j: np.maximum(w.a[:, i], w.a[:, j]) * _off(w, rng),
    "difference": lambda w, rng, i, j: np.abs(w.a[:, i] - rng.uniform(0.6, 1.6) * w.a[:, j]),
    "switch": lambda w, rng, i, j: np.sign(w.a[:, i] - rng.uniform(-0.3, 0.3)) * w.motor,
    "position and temperature": lambda w, rng, i, j: _scramble(w.position, rng) * _off(w, rng),
    "logarithm": lambda w, rng, i, j: np.log(w.T - w.T.min() + 0.5) * w.a[:, j],
    "product of three": lambda w, rng, i, j: w.a[:, i] * w.a[:, j] ** 2 * np.abs(w.a[:, 3 - i - j]) * _off(w, rng),
    "size of each visit": lambda w, rng, i, j: _scramble(w.visit + 24 * w.run, rng) * w.a[:, j],
    "move and motor": lambda w, rng, i, j: np.abs((w.before - w.a)[:, j]) * w.motor**2,
}


def not_expressible(w: World, rng: Any) -> Law:
    """Something that no three terms of the grammar are."""
    name = list(INEXPRESSIBLE)[int(rng.integers(len(INEXPRESSIBLE)))]
    axis = int(rng.integers(3))
    j = (axis + 1 + int(rng.integers(2))) % 3
    added = np.zeros_like(w.a)
    added[:, axis] = INEXPRESSIBLE[name](w, rng, axis, j)
    return Law(name, added, (), axis)
