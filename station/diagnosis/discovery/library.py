"""Every term of the grammar that these visits could show, with its constants on a grid, as one table of products."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.residuals import ResidualView
from station.domain.core.types import Floats
from station.model.effect import stimulus_strength
from station.model.formula.expression import constants, evaluate, variables
from station.model.formula.grammar import INPUTS, MODULATORS, Factor, FormulaColumn, columns_of
from station.model.formula.term import Term, variable_values, without_rounding
from station.model.forward import sensor_signal
from station.model.scene import Scene, Signal

#: Inputs that are tried with every modulator; all others with the plain ones only.
BASIC_INPUTS = frozenset(
    {"one", "own", "other", "own-squared", "own-cubed", "own-other", "others", "own-size", "other-size", "step"}
)
#: Modulators of so many grid values that only basic inputs are tried with them.
SPECIAL_MODULATORS = frozenset({"wave", "after", "temperature-kink", "temperature-cubed", "time-squared"})
#: Modulators that change within a visit, and the inputs tried with them.
MOVING_MODULATORS, MOVING_INPUTS = frozenset({"decay-since-arrival"}), ("one", "own", "step")
#: Inputs of so many columns or constants that they are tried with these modulators only.
BENDS = frozenset({"own-kink", "own-dead-band", "own-saturation", *(f"harmonic-{m}" for m in range(1, 5))})
PLAIN_MODULATORS = frozenset(
    {"constant", "temperature", "time", "decay", "decay-since-power", "motor", "temperature-rate"}
)
#: Times of a jump, frequencies and steps of a time constant that are scanned.
JUMPS, MOST_WAVES, DECAYS = 16, 60, 7
#: A range of temperature below this, degC, shows nothing; below that, no bend.
LEAST_RANGE_DEGC, LEAST_BENT_RANGE_DEGC = 0.2, 3.0

Constants = tuple[tuple[str, float], ...]


class Shape(NamedTuple):
    """One factor at one value of its constants: its values (n) by axes and phase; usual: the first value of each."""

    factor: Factor
    constants: Constants
    values: Mapping[tuple[int, int, str], Floats]
    usual: bool


@dataclass(frozen=True, slots=True, eq=False)
class ColumnProduct:
    """An input and a modulator at values of their constants, and where their columns stand in the table."""

    input: Shape
    modulator: Shape
    columns: tuple[FormulaColumn, ...]
    first: int

    def term(self, at: Sequence[int], of: str) -> Term:
        """The term of some of its columns."""
        values = (*self.input.constants, *self.modulator.constants)
        return Term(
            self.input.factor.name,
            self.modulator.factor.name,
            tuple(self.columns[i].label for i in at),
            of,
            values,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Library:
    """The products that stand still during a visit, or those that move; their values are those at some visits alone."""

    products: tuple[ColumnProduct, ...]
    moving: bool

    @property
    def width(self) -> int:
        """Columns in all."""
        return sum(len(p.columns) for p in self.products)

    def values(self, some: Sequence[ColumnProduct]) -> tuple[Floats, list[int]]:
        """Values (n, c) of the columns of some products on the rows of its visits, and the axis of each."""
        columns, axes = [], []
        for p in some:
            for c in p.columns:
                columns.append(p.input.values[c.i, c.j, c.phase] * p.modulator.values[0, 0, c.wave])
                axes.append(c.i)
        return np.stack(columns, axis=1), axes


def libraries(view: ResidualView, visits: NDArray[np.bool_]) -> tuple[Library, ...]:
    """All that these data could show, what stands still and what moves within a visit, as some visits (v) have it."""
    found = [_library(view, view.signal, visits, moving=False)]
    if view.reduced.contrast.shape[1] and view.scene.since_arrival_s is not None:
        within = np.repeat(visits, view.reduced.rows_of_visit)
        found.append(_library(view, sensor_signal(view.reduced.fine, view.active), within, moving=True))
    return tuple(found)


def _library(view: ResidualView, signal: Signal, rows: NDArray[np.bool_], *, moving: bool) -> Library:
    grids = _Grids(view)
    recorded = [m for m in MODULATORS.values() if (m.name in MOVING_MODULATORS) == moving and grids.shows(m)]
    names = MOVING_INPUTS if moving else [n for n, f in INPUTS.items() if not f.frame]
    if view.feels_one_stimulus:
        names = [n for n in names if n == "one"]
    inputs = [s for n in names for s in _shapes(INPUTS[n], grids, signal, rows)]
    modulators = [s for m in recorded for s in _shapes(m, grids, signal, rows)]
    made, first = [], 0
    for one, two in product(inputs, modulators):
        if not _tried(one.factor.name, two):
            continue
        columns = columns_of(one.factor, two.factor)
        made.append(ColumnProduct(one, two, columns, first))
        first += len(columns)
    return Library(tuple(made), moving)


def _tried(input_: str, modulator: Shape) -> bool:
    name = modulator.factor.name
    if name in SPECIAL_MODULATORS:
        return input_ in BASIC_INPUTS
    if input_ in ("one", "own") and name == "temperature":
        # Where its zero is, offset and gain take up.
        return modulator.usual
    if input_ == "previous" and name == "constant":
        # A step but for the gain.
        return False
    return input_ not in BENDS or name in PLAIN_MODULATORS


def _shapes(factor: Factor, grids: "_Grids", signal: Signal, rows: NDArray[np.bool_]) -> Iterator[Shape]:
    """A factor at every value of its constants, on some rows of a signal."""
    fields = constants(factor.tree)
    places = _places(factor)
    n = len(signal.scene)
    wanted = frozenset().union(*(variables(tree) for _, tree in factor.forms))
    felt = {place: variable_values(signal, *place, wanted) for place in places}
    grid = [grids.of(factor, field) for field in fields]
    for chosen in product(*grid):
        pairs = tuple(zip(fields, chosen, strict=True))
        known = dict(pairs)
        shaped = {
            (*place, phase): np.broadcast_to(without_rounding(evaluate(tree, felt[place], known)), n)[rows]
            for place in places
            for phase, tree in factor.forms
        }
        yield Shape(factor, pairs, shaped, chosen == tuple(values[0] for values in grid))


def _places(factor: Factor) -> list[tuple[int, int]]:
    if factor.name in MODULATORS:
        return [(0, 0)]
    return list(dict.fromkeys((c.i, c.j) for c in columns_of(factor, MODULATORS["constant"])))


def visit_interval(scene: Scene) -> float:
    """Time from a visit of a run to the next, s, in the middle of all; the longest run where there is no next."""
    steps = np.diff(scene.time_s)[scene.visits.previous[1:] >= 0]
    return max(float(np.median(steps)) if len(steps) else float(scene.time_s.max()), 1e-3)


class _Grids:
    """The values of each constant that these data make worth trying."""

    def __init__(self, view: ResidualView) -> None:
        self.scene, self.strength = view.scene, stimulus_strength(view.scene.recipe)
        scene = self.scene
        self.longest = max(float(scene.time_s.max()), 1e-3)
        self.interval = visit_interval(scene)

    def shows(self, modulator: Factor) -> bool:
        """Whether its covariate was recorded and varies."""
        for name in modulator.needs:
            if not self.scene.is_recorded(name):
                return False
            values = self.scene.require(name)
            spread = float(np.ptp(values))
            if name == "temperature_degC":
                bent = modulator.name != "temperature"
                if spread < (LEAST_BENT_RANGE_DEGC if bent else LEAST_RANGE_DEGC):
                    return False
            elif spread <= 0:
                return False
        return modulator.name == "constant" or len(self.scene.time_s) > 2

    def of(self, factor: Factor, field: str) -> tuple[float, ...]:
        """The grid of a constant; the first value is the usual one."""
        if field in ("about_degC", "kink_degC"):
            T = self.scene.require("temperature_degC")
            if field == "kink_degC":
                return tuple(float(x) for x in np.quantile(T, (0.5, 0.25, 0.75)))
            ends = (float(T.mean()), float(T.min()), float(T.max()))
            return ends[:1] if factor.name == "temperature-cubed" else ends
        if field == "bend_u":
            shares = (-0.5, -0.25, 0.25, 0.5) if factor.name == "own-kink" else (0.3, 0.6)
            return tuple(self.strength * share for share in shares)
        if field == "start_s":
            return tuple(float(x) for x in np.linspace(0, self.longest, JUMPS + 2)[1:-1])
        if field == "cycles_hz":
            count = int(min(MOST_WAVES, max(4, self.longest / self.interval)))
            return tuple(float(x) for x in np.linspace(0.35 / self.longest, 0.5 / self.interval, count))
        return self._times(factor)

    def _times(self, factor: Factor) -> tuple[float, ...]:
        """Time constants."""
        if "t_arrival" in variables(factor.tree):
            return (0.03, 0.06, 0.12, 0.25, 0.5)
        clock = {"t": "time_s", "t_power": "since_power_s", "t_clamp": "since_clamp_s"}
        (name,) = variables(factor.tree)
        t = self.scene.time_s if name == "t" else self.scene.require(clock[name])
        if factor.name.startswith("creep"):
            return (1.0, 10.0, 100.0)
        return tuple(float(x) for x in np.geomspace(max(self.interval, 1e-3), 2 * max(float(t.max()), 1.0), DECAYS))
