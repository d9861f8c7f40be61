"""The bank: for each cause what it would look like in these data, got by switching it on in the simulation.

A candidate is a cause at one shape (a time constant, say) and at one level of sharing (one coefficient a unit, one
for all, one a position …). Derivatives of the simulation by its coefficients are its columns; groups act on their
own rows, so one derivative serves all groups and all levels.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from station import plugins
from station.diagnosis.candidates import visit_gaps
from station.diagnosis.candidates.bank_columns import BankColumns, places, scattered
from station.diagnosis.candidates.columns import CauseColumns
from station.diagnosis.data.residuals import ResidualView
from station.diagnosis.linear.evidence import Pattern
from station.diagnosis.linear.grid import RowLayout
from station.diagnosis.linear.projection import DataColumns
from station.domain.core.types import Floats
from station.domain.recipe.recipe import Recipe
from station.model.effect import Effect, GoldEffect, PoseEffect, SensorEffect, StimulusEffect
from station.model.temperature_polynomial import TemperaturePolynomial

#: Causes that are part of the noise floor.
FLOOR_CAUSES = ("repeatability", "bias-walk")
#: A cause may be so many times as large as the largest met in practice.
AMPLITUDE_LIMIT_FACTOR = 20.0
#: Times of a jump that are scanned at most.
MAX_JUMP_TIMES = 32
#: Times between two of them that are tried at most.
MAX_REFINED_JUMP_TIMES = 12
#: Units whose columns are in memory at once; and units that are so few that the columns of all are held.
UNITS_AT_ONCE, FEW_UNITS = 16, 8
#: Over a smaller range of temperature than this, degC, a curve is a straight line.
MIN_BENT_RANGE_DEGC = 8.0
#: Levels whose groups belong to one unit each.
PER_UNIT_LEVELS = ("unit", "run", "power-on", "visit", "unit-position")


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A cause, or a generic kernel, at one shape and level.

    name: effect id or the kernel's name; effect: at its shape, None for a kernel; of: level; code (v) and names of
    the groups; columns at the visits, one object for all levels that share them; scale of the effect's sizes in this
    recipe; plain: the same without the columns that its covariate's error adds, if any;
    own: the effect of each group, where they differ in shape (`own_times.py`); axis_scale (a): how much larger each
    axis' coefficient usually is than the first one's, 1 where empty; stands_for: how many of its name, of which it is
    the best.
    """

    name: str
    effect: Effect | None
    of: str
    pattern: Pattern
    code: NDArray[np.int32]
    names: tuple[str, ...]
    columns: CauseColumns
    scale: float = 1.0
    plain: "Candidate | None" = None
    own: tuple[Effect, ...] = ()
    axis_scale: tuple[float, ...] = ()
    stands_for: int = 1

    @property
    def visit(self) -> Floats:
        """Columns (v, 3, a) of the visits' means."""
        return self.columns.visit()

    @property
    def dwell(self) -> Floats | None:
        """Columns (v, B−1, 3, a) of the contrasts, None of what stands still in a visit."""
        return self.columns.dwell()

    @property
    def moving(self) -> bool:
        """Whether it changes within a visit."""
        return self.columns.moving is not None

    @property
    def shapes(self) -> dict[Effect, NDArray[np.bool_]]:
        """Every shape it has, with the groups (groups) that have it; none of a kernel."""
        if self.effect is None:
            return {}
        of = self.own or (self.effect,) * len(self.names)
        return {e: np.array([x == e for x in of]) for e in dict.fromkeys(of)}

    @property
    def most(self) -> float:
        """The largest amplitude that is thinkable; infinite for a kernel."""
        return AMPLITUDE_LIMIT_FACTOR * self.usual_most

    @property
    def usual_most(self) -> float:
        """The largest amplitude met in practice; infinite for a kernel."""
        if self.effect is None:
            return np.inf
        p = self.effect.parameter
        return max(abs(p.low), abs(p.high)) * self.scale

    @property
    def scans_visits(self) -> bool:
        """Whether it hits single visits, and stands still in each."""
        return self.pattern == "scan" and self.of == "visit" and not self.moving

    @property
    def even(self) -> "Candidate":
        """The same with columns of coefficients that are usually as large as each other: of raw ones a cube's would
        hide a straight line's behind their rounding."""
        if not self.axis_scale:
            return self
        scale, dwell = np.array(self.axis_scale), self.dwell
        columns = CauseColumns.of(self.visit * scale, None if dwell is None else dwell * scale)
        return replace(self, columns=columns, axis_scale=())

    @property
    def axes(self) -> int:
        """Coefficients a group."""
        return self.columns.count

    def local_codes(self, layout: RowLayout) -> tuple[NDArray[np.int32], int]:
        """Group codes (v) counted within a unit where groups belong to one, and how many there are."""
        if self.of not in PER_UNIT_LEVELS:
            return self.code, len(self.names)
        first = np.full(layout.grid.units, len(self.names))
        np.minimum.at(first, layout.unit, self.code)
        code = (self.code - first[layout.unit]).astype(np.int32)
        return code, int(code.max()) + 1

    def where(self, layout: RowLayout) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Unit of each group, and its place among the unit's; (groups) each. For groups that belong to one unit."""
        unit, place = np.zeros(len(self.names), np.intp), np.zeros(len(self.names), np.intp)
        unit[self.code], place[self.code] = layout.unit, self.local_codes(layout)[0]
        return unit, place

    def rows(self, layout: RowLayout, chosen: NDArray[np.intp] | None = None) -> DataColumns:
        """Columns laid out by unit, one set a group; chosen: which groups alone, counted within a unit where they
        belong to one."""
        code, groups = self.local_codes(layout)
        if chosen is not None and len(chosen) < groups:
            # Those of all other groups go to a place of their own, which is cut off.
            place = np.full(groups, len(chosen))
            place[chosen] = np.arange(len(chosen))
            code, groups = place[code].astype(np.int32), len(chosen) + 1
        columns = None if chosen is None else len(chosen) * self.axes
        dwell = self.dwell
        inside = None if dwell is None else _by_group(dwell, code, groups)[..., :columns]
        return layout.rows(_by_group(self.visit, code, groups)[..., :columns], inside)

    def select_visits(self, chosen: NDArray[np.bool_]) -> "Candidate":
        """The same at some of the visits."""
        # The plain one is for what is accepted in the end.
        return replace(self, code=self.code[chosen], columns=self.columns.select_visits(chosen))


def candidate_in_view(candidate: Candidate, view: ResidualView) -> Candidate:
    """A candidate with the columns it has in a view; a kernel's stay."""
    if candidate.effect is None:
        return candidate
    parts = [(view.signature(e, candidate.of), at[candidate.code]) for e, at in candidate.shapes.items()]
    (visit, dwell), _ = parts[0]
    for (other, _), rows in parts[1:]:
        # Only what stands still during a visit has a shape of each group's own.
        visit = np.where(rows[:, None, None], other, visit)
    return replace(candidate, columns=CauseColumns.of(visit, dwell))


def _by_group(columns: Floats, code: NDArray[np.int32], groups: int) -> Floats:
    """Columns (v, …, a) as (v, …, groups · a), each row in its own group's columns."""
    if groups == 1:
        return columns
    out = np.zeros((*columns.shape[:-1], groups, columns.shape[-1]))
    np.moveaxis(out, -2, 1)[np.arange(len(code)), code] = columns
    return out.reshape(*columns.shape[:-1], -1)


def smooth_causes() -> tuple[str, ...]:
    """Ids of the causes whose signature is smooth, whether this recipe can show them or not."""
    kinds = (PoseEffect, StimulusEffect, SensorEffect, GoldEffect)
    found = plugins.load_all("station.model.effects").items()
    return tuple(n for n, c in found if issubclass(c, kinds) and n not in FLOOR_CAUSES and not _is_tone(c.example()))


def cause_library(recipe: Recipe) -> tuple[Effect, ...]:
    """Every cause that can act in this recipe and whose signature is smooth, at its typical size."""
    kinds = (PoseEffect, StimulusEffect, SensorEffect, GoldEffect)
    found = (c.example() for c in plugins.load_all("station.model.effects").values() if issubclass(c, kinds))
    return tuple(e for e in found if e.acts_on(recipe) and _acts_on_means(e, recipe))


def _acts_on_means(effect: Effect, recipe: Recipe) -> bool:
    """Whether a cause acts, and can be seen in the means of a visit's blocks."""
    return (
        effect.id not in FLOOR_CAUSES
        and not _is_tone(effect)
        and (not isinstance(effect, GoldEffect) or recipe.reference.source == "gold")
    )


def _is_tone(effect: Effect) -> bool:
    """Whether a cause makes many waves a dwell."""
    return any(p.name == "frequency" and p.typical > 0 for p in effect.forms)


def scanned_forms(effect: Effect, view: ResidualView) -> Iterator[Effect]:
    """The effect at every value of its shape that is scanned; times of a jump are those between the visits."""
    grid = {p.field: p.grid or (_thinned(candidate_jump_times(view)) if p.name == "at" else ()) for p in effect.forms}
    grid = {key: values for key, values in grid.items() if values}
    frequency = [p.field for p in effect.forms if p.name == "frequency" and view.reduced.ringing_hz]
    for values in product(*grid.values()):
        shaped = replace(effect, **dict(zip(grid, values, strict=True)))
        yield shaped
        yield from (replace(shaped, **{field: hz}) for field in frequency for hz in view.reduced.ringing_hz)
    T = view.scene.temperature_degC
    if isinstance(effect, TemperaturePolynomial) and T is not None and float(np.ptp(T)) > MIN_BENT_RANGE_DEGC:
        for degree in (2, 3):
            yield replace(effect, degree=degree, about_degC=float(np.round(T.mean(), 3)))


def candidate_jump_times(view: ResidualView) -> tuple[float, ...]:
    """Times between the visits of the longest run, s from its start."""
    longest = max((rows for rows in view.scene.visits.run_slices()), key=lambda rows: rows.stop - rows.start)
    return tuple(float(x) for x in visit_gaps.middles(view, longest))


def _thinned(gaps: tuple[float, ...]) -> tuple[float, ...]:
    """All of a few gaps, as many of more of them."""
    return gaps[:: max(1, -(-len(gaps) // MAX_JUMP_TIMES))]


def jump_times_between(view: ResidualView, low: float, high: float) -> tuple[float, ...]:
    """Times between any two visits of any runs within bounds: from one to the next another visit is before the jump.
    Of a fleet's many, some."""
    middle = visit_gaps.middles(view, slice(None))
    near = middle[(middle > low) & (middle < high)]
    return tuple(float(x) for x in near[:: max(1, -(-len(near) // MAX_REFINED_JUMP_TIMES))])


def is_testable(effect: Effect, view: ResidualView) -> bool:
    """Whether everything the cause depends on was recorded, and no other of the library looks the same: in one pose
    what changes a gain is what changes an offset."""
    of_gain = effect.drawn_over == "temperature-input"
    recorded = all(view.scene.is_recorded(name) for name in effect.needs)
    return recorded and not (of_gain and view.feels_one_stimulus)


def candidates(effect: Effect, view: ResidualView) -> list[Candidate]:
    """The cause at every shape and level."""
    return [c for shaped in scanned_forms(effect, view) for c in candidates_of_shape(shaped, view)]


def candidates_of_shape(shaped: Effect, view: ResidualView) -> list[Candidate]:
    """The cause at one shape, at every level."""
    columns = CauseColumns.in_bank(view, *view.signature(shaped))
    found = [_candidate(shaped, of, pattern, view, columns) for of, pattern in _levels(shaped, view)]
    return [with_covariate_error(_with_even_powers(c, view), view) for c in found]


def _with_even_powers(c: Candidate, view: ResidualView) -> Candidate:
    """The candidate of a polynomial with its columns brought to the length of the straight ones: a cube of degrees is a
    larger number than a degree, and its coefficient so much smaller."""
    if not isinstance(c.effect, TemperaturePolynomial) or c.effect.degree == 1:
        return c
    length = np.sqrt(np.mean(c.visit**2, axis=(0, 1)).reshape(c.effect.degree, -1).sum(1))
    scale = np.repeat(length[0] / np.maximum(length, 1e-300), c.axes // c.effect.degree)
    plain = replace(c, axis_scale=tuple(float(x) for x in scale))
    return replace(c, columns=CauseColumns.in_bank(view, c.visit * scale), plain=plain)


def with_covariate_error(c: Candidate, view: ResidualView) -> Candidate:
    """The candidate with what its covariate's error adds: c·(x + Σ z·mode) has the columns x and mode, of one variance.

    Without them a cause with a noisy covariate would lose to any that has nearly the same course and none of its noise.
    """
    errors = [] if c.effect is None or c.pattern != "own" else view.by_covariate_error(c.effect)
    if c.effect is None or not errors:
        return c
    run = view.scene.group("run")[0]
    first = np.full(view.grid.units, len(run))
    np.minimum.at(first, view.layout.unit, run)
    of_unit = run - first[view.layout.unit]
    columns = [c.visit]
    for error in errors:
        off = error.signature(c.effect, c.of)[0]
        columns += [off * (of_unit == r)[:, None, None] for r in range(int(of_unit.max()) + 1)]
    return replace(c, columns=CauseColumns.in_bank(view, np.concatenate(columns, axis=2)), plain=c)


def _levels(effect: Effect, view: ResidualView) -> list[tuple[str, Pattern]]:
    """Levels of sharing that differ in these data, with the pattern of each."""
    found: list[tuple[str, Pattern]] = []
    taken: list[tuple[bool, bytes]] = []
    for of in effect.of:
        code, names = view.scene.group(of)
        own = of in PER_UNIT_LEVELS
        key = (own and len(view.scene.visits.unit.names) > 1, code.tobytes())
        if key in taken or (of == "visit" and len(names) < 2):
            continue
        rare = of == "visit" or any(p.name == "at" for p in effect.forms)
        if not (rare and own and of != "unit"):
            found.append((of, "own" if own else "shared"))
        if of in ("visit", "run") and len(names) > 1:
            found.append((of, "scan"))
        # Of one run there is none to look for: what is rare is its unit's.
        if found and found[-1][0] == of:
            taken.append(key)
    return found


def _candidate(effect: Effect, of: str, pattern: Pattern, view: ResidualView, columns: CauseColumns) -> Candidate:
    code, names = view.scene.group(of)
    scale = effect.parameter.scale(view.scene.recipe)
    return Candidate(effect.id, effect, of, pattern, code, names, columns, scale)


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """Candidates and their columns. Levels that group alike within a unit share their columns; a scan of single visits
    has none, as it needs none (`visit_scan.py`).

    moving: whether the candidates change within a visit; codes (v) of each one's groups, and how many groups, within a
    unit; place of each among the columns; all_columns: of all units, None where they are laid out part by part.
    """

    moving: bool
    candidates: tuple[Candidate, ...]
    codes: tuple[NDArray[np.int32], ...]
    groups: tuple[int, ...]
    place: tuple[slice, ...]
    made: tuple[BankColumns, ...]
    all_columns: DataColumns | None = None

    def only(self, chosen: Sequence[int]) -> "Bank":
        """The same with some of the candidates."""
        if len(chosen) == len(self.candidates):
            return self
        bank = _assemble_bank([(self.candidates[i], self.codes[i], self.groups[i]) for i in chosen], moving=self.moving)
        if self.all_columns is None or not bank.made:
            return bank
        place = {(id(m.columns), m.code.tobytes()): m.at for m in self.made}
        columns = np.concatenate([np.r_[place[id(m.columns), m.code.tobytes()]] for m in bank.made])
        return replace(bank, all_columns=self.all_columns.only(columns))

    def standing_for(self, chosen: Mapping[int, int]) -> "Bank":
        """The same with some of the candidates, by place, each of which stands for so many."""
        bank = self.only(list(chosen))
        pairs = zip(bank.candidates, chosen.values(), strict=True)
        return replace(bank, candidates=tuple(replace(c, stands_for=many) for c, many in pairs))

    def named(self, names: Collection[str]) -> "Bank":
        """The same with the candidates of some names."""
        return self.only([i for i, c in enumerate(self.candidates) if c.name in names])

    def rows(self, layout: RowLayout, units: slice, made: Sequence[BankColumns] | None = None) -> DataColumns:
        """The columns of some units, all of them or some sets side by side."""
        made = self.made if made is None else made
        if self.all_columns is not None:
            return self.all_columns.of_units(units).only(places(made))
        visits = layout.grid.part(units)[1]
        visit = scattered(made, [m.columns.retained(layout.keep, visits) for m in made], visits)
        if not self.moving:
            return layout.columns(visit, None, units)
        inside = [layout.scaled(dwell, visits) for m in made if (dwell := m.columns.dwell(visits)) is not None]
        flat = [dwell.reshape(len(dwell), -1, dwell.shape[-1]) for dwell in inside]
        return layout.columns(visit, scattered(made, flat, visits), units)


def build_bank(items: Sequence[Candidate], layout: RowLayout, *, moving: bool) -> Bank:
    """The candidates that move within a visit, or those that do not."""
    chosen = [c for c in items if c.moving == moving]
    levels = {(c.of, id(c.code)): c for c in chosen}
    local = {level: c.local_codes(layout) for level, c in levels.items()}
    bank = _assemble_bank([(c, *local[c.of, id(c.code)]) for c in chosen], moving=moving)
    if not bank.made or layout.grid.units > FEW_UNITS or (layout.keeps_axes_apart and not moving):
        return bank
    # Few units are looked at under many floors: their rows are the same under each, and dear where they are long.
    return replace(bank, all_columns=bank.rows(layout, slice(0, layout.grid.units)))


def _assemble_bank(items: Sequence[tuple[Candidate, NDArray[np.int32], int]], *, moving: bool) -> Bank:
    """The bank of candidates, with the group of each visit within its unit and how many groups there are. Columns of
    one width stand side by side."""
    keys = [None if c.scans_visits else (id(c.columns), code.tobytes()) for c, code, _ in items]
    widths: dict[tuple[int, bytes], tuple[int, CauseColumns, NDArray[np.int32]]] = {}
    for key, (c, code, groups) in zip(keys, items, strict=True):
        if key is not None:
            widths.setdefault(key, (groups * c.axes, c.columns, code))
    made: dict[tuple[int, bytes] | None, BankColumns] = {}
    end = 0
    for key, (width, columns, code) in sorted(widths.items(), key=lambda pair: pair[1][0]):
        start, end = end, end + width
        made[key] = BankColumns(columns, code, slice(start, end))
    place = tuple(slice(0, 0) if key is None else made[key].at for key in keys)
    found, codes, lengths = (tuple(column) for column in zip(*items, strict=True)) if items else ((), (), ())
    return Bank(moving, found, codes, lengths, place, tuple(made.values()))
