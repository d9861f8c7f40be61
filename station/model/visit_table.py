"""The visits of a scene as arrays: who, where, in which order, and how the part stood."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Array, Floats, Labels
from station.domain.recipe.plan import seating_of_passes
from station.domain.recipe.recipe import Recipe
from station.errors import SamplesError
from station.messages import Message

#: Labels of a visit that group it with others.
GROUP_LABELS = ("station", "nest", "lot", "operator")


@dataclass(frozen=True, slots=True, eq=False)
class VisitTable:
    """Visits (v), sorted by unit, run and visit.

    unit, position, seating (Labels); run, visit (v); groups: those of station, nest, lot, operator that are known;
    nest_R (v, 3, 3) nest → station; seat_R (v, 3, 3) device → nest; stimulus (v, 3) in the station's frame (a
    rate: the nest's); previous (v) index of the previous visit of the same run, or −1; gold (v, 3) the stimulus in
    the nest's frame as the gold reference measured it, where the recipe takes it as the truth, or None.
    """

    unit: Labels
    run: NDArray[np.int32]
    visit: NDArray[np.int32]
    position: Labels
    seating: Labels
    groups: Mapping[str, Labels]
    nest_R: Floats
    seat_R: Floats
    stimulus: Floats
    previous: NDArray[np.intp]
    gold: Floats | None = None
    #: Groups of a level that were found already: every cause asks for them.
    _groups: dict[tuple[str, int], tuple[NDArray[np.int32], tuple[str, ...]]] = field(
        default_factory=dict, init=False, repr=False
    )

    def __len__(self) -> int:
        return len(self.run)

    def group(self, level: str, runs: int) -> tuple[NDArray[np.int32], tuple[str, ...]]:
        """Group codes (v) and names; see Scene.group."""
        if (level, runs) not in self._groups:
            self._groups[level, runs] = self.codes(level, runs), self._names(level, runs)
        return self._groups[level, runs]

    def codes(self, level: str, runs: int) -> NDArray[np.int32]:
        """Group codes (v) alone."""
        if level == "visit":
            return np.arange(len(self), dtype=np.int32)
        if level == "run":
            return np.cumsum(self.previous < 0, dtype=np.int32) - np.int32(1)
        if level == "run-of-recipe":
            return (self.run % runs).astype(np.int32)
        labels = self._labels(level)
        return np.zeros(len(self), np.int32) if labels is None else labels.code

    def _names(self, level: str, runs: int) -> tuple[str, ...]:
        if level == "visit":
            text = zip(self.unit.text(), self.run, self.visit, strict=True)
            return tuple(f"visit:{u}/{r}/{v}" for u, r, v in text)
        if level == "run":
            units = self.unit.text()
            return tuple(f"run:{units[i]}/{self.run[i]}" for i in np.flatnonzero(self.previous < 0))
        if level == "run-of-recipe":
            return tuple(f"run-of-recipe:{r}" for r in range(runs))
        labels = self._labels(level)
        return ("common",) if labels is None else tuple(f"{level}:{name}" for name in labels.names)

    def _labels(self, level: str) -> Labels | None:
        return {"unit": self.unit, "position": self.position, **self.groups}.get(level)

    def run_slices(self) -> "Iterator[slice[int, int, None]]":
        """The rows of each unit's each run, in order."""
        starts = np.flatnonzero(self.previous < 0)
        for a, b in zip(starts, [*starts[1:], len(self)], strict=True):
            yield slice(int(a), int(b), None)

    def of_runs(self, there: NDArray[np.bool_]) -> "VisitTable":
        """The visits of some whole runs, there (v), without the names of units and the like that have none of them."""
        place = np.cumsum(there) - 1
        previous = np.where(self.previous >= 0, place[self.previous], -1)[there]
        rows = {n: getattr(self, n)[there] for n in ("run", "visit", "nest_R", "seat_R", "stimulus")}
        labels = {n: getattr(self, n)[there].used() for n in ("unit", "position", "seating")}
        groups = {name: group[there].used() for name, group in self.groups.items()}
        gold = None if self.gold is None else self.gold[there]
        return VisitTable(**labels, **rows, groups=groups, previous=previous, gold=gold)

    def with_gold(self, recipe: Recipe, gold: Floats) -> "VisitTable":
        """The same, with the gold readings (v, 3) corrected by the gold's own calibration as the truth."""
        own = recipe.reference.gold
        if own is None:
            return replace(self, gold=gold)
        return replace(self, gold=np.linalg.solve(np.array(own.matrix), (gold - own.offset).T).T)


def visit_table(
    recipe: Recipe,
    unit: Labels,
    run: NDArray[np.int32],
    visit: NDArray[np.int32],
    labels: Mapping[str, Labels],
) -> VisitTable:
    """Visits with their orientations from the recipe; rows sorted by unit, run, visit. Poses not known are NaN.

    labels: position, and what is known of seating, station, nest, lot and operator.
    """
    position = labels["position"]
    seating = labels["seating"] if "seating" in labels else seating_of_passes(recipe, run)
    poses = [_pose(recipe, name) for name in position.names]
    same = (unit.code[1:] == unit.code[:-1]) & (run[1:] == run[:-1])
    previous = np.where(np.r_[False, same][: len(run)], np.arange(len(run)) - 1, -1)
    return VisitTable(
        unit=unit,
        run=run,
        visit=visit,
        position=position,
        seating=seating,
        groups={k: v for k, v in labels.items() if k in GROUP_LABELS},
        nest_R=on_turned_base(recipe, run, np.array([p[0] for p in poses])[position.code]),
        seat_R=np.array([_seat(recipe, name) for name in seating.names])[seating.code],
        stimulus=np.array([p[1] for p in poses])[position.code],
        previous=previous,
    )


def on_turned_base(recipe: Recipe, run: NDArray[np.int32], nest_R: Floats) -> Floats:
    """Nest → station rotations (v, 3, 3) in passes (v), from those where the rig stands as it usually does."""
    if not recipe.turns_base:
        return nest_R
    turns = np.array([recipe.base(i) for i in range(len(recipe.runs))])
    return np.asarray(turns[run % len(turns)] @ nest_R)


def _pose(recipe: Recipe, name: str) -> tuple[Array, Floats]:
    """Nest → station rotation and stimulus of a position."""
    if not recipe.pose_known:
        return np.full((3, 3), np.nan), np.array([0.0, 0.0, recipe.reference.strength()])
    try:
        position = recipe.position(name)
    except KeyError:
        raise SamplesError(_unknown("samples-position-unknown", name, [p.name for p in recipe.positions])) from None
    # A rate table turns about the nest's own axes, so its stimulus is given there.
    R = np.eye(3) if recipe.reference.source == "rate" else position.matrix()
    return R, recipe.stimulus(position)


def _seat(recipe: Recipe, name: str) -> Floats:
    try:
        return recipe.seating(name)
    except KeyError:
        raise SamplesError(_unknown("samples-seating-unknown", name, ["home", *recipe.seatings])) from None


def _unknown(id_: str, name: str, names: list[str]) -> Message:
    return Message(id_, name=name, nearest=get_close_matches(name, names, 1, 0)[0])
