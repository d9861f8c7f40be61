"""The bank: for each cause what it would look like in these data, got by switching it on in the simulation.

A candidate is a cause at one shape (a time constant, say) and at one level of sharing (one coefficient a unit, one
for all, one a position …). Derivatives of the simulation by its coefficients are its columns; groups act on their
own rows, so one derivative serves all groups and all levels.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from station import plugins
from station.diagnosis.evidence import Pattern, Sets, Spectrum, spectrum
from station.diagnosis.space import Rows, Space
from station.diagnosis.view import View
from station.domain.recipe import Recipe
from station.domain.types import Floats
from station.model.effect import Effect, GoldEffect, PoseEffect, SensorEffect, StimulusEffect

#: Causes that are part of the noise floor.
FLOOR = ("repeatability", "bias-walk")
#: A cause may be so many times as large as the largest met in practice.
THINKABLE = 20.0
#: Levels whose groups belong to one unit each.
OWN = ("unit", "run", "visit", "unit-position")


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A cause, or a generic kernel, at one shape and level.

    name: effect id or the kernel's name; effect: at its shape, None for a kernel; of: level; code (v) and names of
    the groups; stop (v, 3, a) columns of the stops' means; dwell (v, B−1, 3, a) of the contrasts, or None; scale of
    the effect's sizes in this recipe.
    """

    name: str
    effect: Effect | None
    of: str
    pattern: Pattern
    code: NDArray[np.int32]
    names: tuple[str, ...]
    stop: Floats
    dwell: Floats | None = None
    scale: float = 1.0

    @property
    def most(self) -> float:
        """The largest amplitude that is thinkable; infinite for a kernel."""
        if self.effect is None:
            return np.inf
        p = self.effect.parameter
        return THINKABLE * max(abs(p.low), abs(p.high)) * self.scale

    @property
    def axes(self) -> int:
        """Coefficients a group."""
        return int(self.stop.shape[-1])

    def local(self, view: View) -> tuple[NDArray[np.int32], int]:
        """Group codes (v) counted within a unit where groups belong to one, and how many there are."""
        if self.of not in OWN:
            return self.code, len(self.names)
        first = np.full(view.grid.units, len(self.names))
        np.minimum.at(first, view.scene.visits.unit.code, self.code)
        code = (self.code - first[view.scene.visits.unit.code]).astype(np.int32)
        return code, int(code.max()) + 1

    def where(self, view: View) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Unit of each group, and its place among the unit's; (groups) each. For groups that belong to one unit."""
        unit, place = np.zeros(len(self.names), np.intp), np.zeros(len(self.names), np.intp)
        unit[self.code], place[self.code] = view.scene.visits.unit.code, self.local(view)[0]
        return unit, place

    def rows(self, view: View) -> Rows:
        """Columns laid out by unit, one set a group."""
        code, groups = self.local(view)
        return view.rows(
            _by_group(self.stop, code, groups), None if self.dwell is None else _by_group(self.dwell, code, groups)
        )


def _by_group(columns: Floats, code: NDArray[np.int32], groups: int) -> Floats:
    """Columns (v, …, a) as (v, …, groups · a), each row in its own group's columns."""
    if groups == 1:
        return columns
    out = np.zeros((*columns.shape[:-1], groups, columns.shape[-1]))
    np.moveaxis(out, -2, 1)[np.arange(len(code)), code] = columns
    return out.reshape(*columns.shape[:-1], -1)


def smooth() -> tuple[str, ...]:
    """Ids of the causes whose signature is smooth, whether this recipe can show them or not."""
    kinds = (PoseEffect, StimulusEffect, SensorEffect, GoldEffect)
    found = plugins.load_all("station.model.effects").items()
    return tuple(n for n, c in found if issubclass(c, kinds) and n not in FLOOR and not _sounds(c.example()))


def library(recipe: Recipe) -> tuple[Effect, ...]:
    """Every cause that can act in this recipe and whose signature is smooth, at its typical size."""
    kinds = (PoseEffect, StimulusEffect, SensorEffect, GoldEffect)
    found = (c.example() for c in plugins.load_all("station.model.effects").values() if issubclass(c, kinds))
    return tuple(e for e in found if recipe.sensor in e.sensors and _at_work(e, recipe))


def _at_work(effect: Effect, recipe: Recipe) -> bool:
    """Whether a cause acts, and can be seen in the means of a stop's blocks."""
    return (
        effect.id not in FLOOR
        and not _sounds(effect)
        and (not isinstance(effect, GoldEffect) or recipe.reference.source == "gold")
    )


def _sounds(effect: Effect) -> bool:
    """Whether a cause makes many waves a dwell."""
    return any(p.name == "frequency" and p.typical > 0 for p in effect.forms)


def shapes(effect: Effect, view: View) -> Iterator[Effect]:
    """The effect at every value of its shape that is scanned; times of a jump are those between the stops."""
    grid = {p.field: p.grid or (_some(gaps_of(view)) if p.name == "at" else ()) for p in effect.forms}
    grid = {key: values for key, values in grid.items() if values}
    for values in product(*grid.values()):
        yield replace(effect, **dict(zip(grid, values, strict=True)))


def gaps_of(view: View) -> tuple[float, ...]:
    """Times between the stops of the longest run, s from its start."""
    longest = max((rows for rows in view.scene.visits.passes()), key=lambda rows: rows.stop - rows.start)
    t = view.scene.time_s[longest]
    return tuple(float(x) for x in (t[1:] + t[:-1]) / 2)


def _some(gaps: tuple[float, ...]) -> tuple[float, ...]:
    """All of a few gaps, every second one of many."""
    return gaps if len(gaps) <= 12 else gaps[1::2]


def testable(effect: Effect, view: View) -> bool:
    """Whether everything the cause depends on was recorded."""
    return all(view.scene.knows(name) for name in effect.needs)


def candidates(effect: Effect, view: View) -> list[Candidate]:
    """The cause at every shape and level."""
    found = []
    for shaped in shapes(effect, view):
        stop, dwell = view.signature(shaped)
        found += [_candidate(shaped, of, pattern, view, stop, dwell) for of, pattern in _levels(effect, view)]
    return found


def _levels(effect: Effect, view: View) -> list[tuple[str, Pattern]]:
    """Levels of sharing that differ in these data, with the pattern of each."""
    found: list[tuple[str, Pattern]] = []
    seen: list[tuple[bool, bytes]] = []
    for of in effect.of:
        code, names = view.scene.group(of)
        own = of in OWN
        key = (own and len(view.scene.visits.unit.names) > 1, code.tobytes())
        if key in seen or (of == "visit" and len(names) < 2):
            continue
        seen.append(key)
        rare = of == "visit" or any(p.name == "at" for p in effect.forms)
        if not (rare and own and of != "unit"):
            found.append((of, "own" if own else "shared"))
        if of in ("visit", "run") and len(names) > 1:
            found.append((of, "scan"))
    return found


def _candidate(effect: Effect, of: str, pattern: Pattern, view: View, stop: Floats, dwell: Floats | None) -> Candidate:
    code, names = view.scene.group(of)
    scale = effect.parameter.scale(view.scene.recipe)
    return Candidate(effect.id, effect, of, pattern, code, names, stop, dwell, scale)


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """Candidates with their columns side by side, and the slice of each. Levels that group alike within a unit share
    their columns. moving: whether the candidates change within a stop."""

    moving: bool
    candidates: tuple[Candidate, ...]
    groups: tuple[int, ...]
    rows: Rows
    place: tuple[slice, ...]

    def only(self, chosen: Sequence[int]) -> "Bank":
        """The same with some of the candidates."""
        candidates, groups, place = (tuple(x[i] for i in chosen) for x in (self.candidates, self.groups, self.place))
        return Bank(self.moving, candidates, groups, self.rows, place)  # type: ignore[arg-type]


def bank_of(items: Sequence[Candidate], view: View, *, moving: bool) -> Bank:
    """The candidates that move within a stop, or those that do not."""
    chosen = [c for c in items if (c.dwell is not None) == moving]
    parts: list[Rows] = [Rows(np.zeros((*view.grid.slot.shape[:2], view.grid.slot.shape[2] * view.grid.k, 0)))]
    end = 0
    place: dict[tuple[int, bytes], slice] = {}
    at, groups = [], []
    for c in chosen:
        code, count = c.local(view)
        key = (id(c.stop), code.tobytes())
        if key not in place:
            parts.append(c.rows(view))
            start, end = end, end + parts[-1].stop.shape[-1]
            place[key] = slice(start, end)
        at.append(place[key])
        groups.append(count)
    return Bank(moving, tuple(chosen), tuple(groups), Rows.beside(parts), tuple(at))


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A bank as a space sees it: what each candidate can show, and the axes (U, M, C) along which it shows it."""

    bank: Bank
    space: Space
    spectra: tuple[Spectrum, ...]
    axes: Floats
    place: tuple[slice, ...]

    def light(self) -> "Seen":
        """The same in single precision."""
        spectra = tuple(s.light() for s in self.spectra)
        return Seen(self.bank, self.space, spectra, self.axes.astype(np.float32), self.place)

    def components(self, sets: Sets) -> list[Floats]:
        """u of every candidate for the data sets."""
        products = (sets.data.transpose(1, 0, 2) @ self.axes).transpose(1, 0, 2)
        return [s.components(products[..., at], sets) for s, at in zip(self.spectra, self.place, strict=True)]

    def only(self, kept: Sequence[bool]) -> "Seen":
        """The same with some of the candidates; the columns of the others stay behind unused."""
        chosen = [i for i, k in enumerate(kept) if k]
        columns = np.concatenate(
            [np.arange(self.place[i].start, self.place[i].stop) for i in chosen] or [np.zeros(0, int)]
        )
        ends = np.cumsum([0, *(self.place[i].stop - self.place[i].start for i in chosen)])
        place = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
        spectra = tuple(self.spectra[i] for i in chosen)
        return Seen(self.bank.only(chosen), self.space, spectra, self.axes[:, :, columns], place)

    def evidence(self, sets: Sets) -> Floats:
        """Log evidence (n, candidates)."""
        found = [s.evidence(u, sets) for s, u in zip(self.spectra, self.components(sets), strict=True)]
        return np.stack(found, axis=1) if found else np.zeros((len(sets.rest), 0))


def see(bank: Bank, space: Space) -> Seen:
    """The bank in a space."""
    columns = space.see(bank.rows)
    each = zip(bank.candidates, bank.groups, bank.place, strict=True)
    found = [spectrum(space, columns[..., at], groups, c.pattern, c.most) for c, groups, at in each]
    ends = np.cumsum([0, *(turned.shape[2] for _, turned in found)])
    place = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
    axes = np.concatenate([columns[..., :0], *(turned for _, turned in found)], axis=2)
    return Seen(bank, space, tuple(s for s, _ in found), axes, place)


def visible(seen: Seen, swollen: float) -> tuple[bool, ...]:
    """Of each candidate, whether the largest amplitude met in practice would leave more than noise (d > 1).

    swollen: how many times the noise is larger than the samples' own, perhaps by what is yet to be found.
    """
    pairs = zip(seen.bank.candidates, seen.spectra, strict=True)
    return tuple(swollen * c.most / THINKABLE * float(np.sqrt(s.m.sum())) > 1.0 for c, s in pairs)


def form(effect: Effect) -> dict[str, float]:
    """The values of the shape, by field."""
    return {f.name: getattr(effect, f.name) for f in fields(effect) if f.name != "size"}
