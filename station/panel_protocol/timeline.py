"""The time line of a load: its cells from the recipe, which of them goes on, and how long each is expected to take."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from station.domain.planning import adaptive_dwell
from station.domain.recipe.blocks import Run
from station.domain.recipe.plan import PlannedVisit
from station.domain.recipe.recipe import Recipe
from station.domain.run.progress import Event, LoadDone, LoadStarted, Phase, PhaseEntered, VisitStarted, WarmUpStarted
from station.messages import Message
from station.service.itinerary import tumble_visits, verification_visits

#: What SDO traffic takes until a load of this recipe has been seen once, s.
_IDENTIFY_S, _WRITE_S, _HAND_S = 2.0, 6.0, 20.0
#: Messages that ask a person for something, and the kind of cell that they belong to.
_HAND_KINDS: Mapping[str, str] = {
    "turn-units": "turn",
    "turn-units-home": "turn",
    "turn-base": "base",
    "set-temperature": "temperature",
    "swing-temperature": "temperature",
    "switch-filter-on": "filter",
    "switch-filter-off": "filter",
    "switch-motors-off": "motors",
}
#: Kinds of cell in which a person is needed.
BY_HAND = frozenset(_HAND_KINDS.values())
Rows = Sequence[Sequence[float]]


@dataclass(frozen=True, slots=True)
class TimelineCell:
    """One cell. kind: identify, stop, turn, base, temperature, filter, motors, warm-up, write or verify; run: number of
    the pass.

    pose: device → station rotation there, None where it is not known; before: that of the seating before a turn.
    true: the stimulus that the device should read (3), recipe's unit. expected_s: how long it should take.
    """

    kind: str
    expected_s: float
    name: str = ""
    run: int = 0
    pose: Rows | None = None
    before: Rows | None = None
    true: tuple[float, ...] | None = None


def cells_of(recipe: Recipe) -> tuple[TimelineCell, ...]:
    """The cells of one load in order. Times are the data sheet's, without moves, until `learned` replaces them."""
    dwell_s = [float(d) for d in adaptive_dwell.dwells_by_sheet_s(recipe)]
    found, at, seating = [TimelineCell("identify", _IDENTIFY_S)], 0, "home"
    for number, run in enumerate(recipe.runs):
        found += _preparation(recipe, number, seating)
        seating = run.seating
        for planned in tumble_visits(recipe, number):
            found.append(_stop_cell(planned, recipe.settle.time_s + dwell_s[min(at, len(dwell_s) - 1)]))
            at += 1
    found.append(TimelineCell("write", _WRITE_S))
    verified = verification_visits(recipe)
    if verified:
        each_s = recipe.settle.time_s + sum(dwell_s) / max(len(dwell_s), 1)
        last = _stop_cell(verified[0], 0.0)
        found.append(replace(last, kind="verify", name="", expected_s=each_s * len(verified)))
    return tuple(found)


def cell_documents(cells: Sequence[TimelineCell]) -> list[dict[str, Any]]:
    """The cells as the live file and the page have them; their times stand beside, because they change."""
    keys = ("kind", "name", "run", "pose", "before", "true")
    return [{key: getattr(cell, key) for key in keys} for cell in cells]


def learned(cells: Sequence[TimelineCell], expected_s: Sequence[float]) -> tuple[TimelineCell, ...]:
    """The cells with the times that the last load of this recipe took; unchanged where those are of other cells."""
    if len(expected_s) != len(cells):
        return tuple(cells)
    return tuple(replace(c, expected_s=float(s)) for c, s in zip(cells, expected_s, strict=True))


def stops_of(cells: Sequence[TimelineCell]) -> list[int]:
    """Numbers of the cells that are stops: the stop of number n of a load is in the cell of number stops_of(cells)[n].
    Verification stops share one cell."""
    return [i for i, cell in enumerate(cells) if cell.kind == "stop"]


@dataclass(frozen=True, slots=True)
class Timeline:
    """Where a load is. at: number of the cell, -1 before; since_s: since when (epoch); warm_until_s: end of a warm-up
    (epoch), 0 without one. A cell that a load has left is expected to take as long the next time."""

    cells: tuple[TimelineCell, ...]
    at: int = -1
    since_s: float = 0.0
    warm_until_s: float = 0.0

    def after(self, event: Event, now_s: float) -> "Timeline":
        """The time line once `event` has happened at now_s (epoch)."""
        if isinstance(event, LoadStarted):
            return replace(self, at=0, since_s=now_s, cells=_with_moves(self.cells, event.estimate_s))
        if isinstance(event, WarmUpStarted):
            there = self._enter(self._find("warm-up", event.number - 1), now_s)
            return replace(there, warm_until_s=now_s + event.duration_s)
        if isinstance(event, VisitStarted) and self._kind() not in ("write", "verify"):
            stops = stops_of(self.cells)
            return self._enter(stops[min(event.number, len(stops)) - 1] if stops else self.at, now_s)
        if isinstance(event, PhaseEntered):
            wanted = {Phase.WRITE: "write", Phase.VERIFY: "verify"}.get(event.phase, "")
            return self._enter(self._find(wanted, 0), now_s) if wanted else self
        if isinstance(event, LoadDone):
            return self._enter(len(self.cells), now_s) if event.fault is None else self
        return self

    def waiting_for(self, action: Message, now_s: float) -> "Timeline":
        """The time line while a person is asked for something."""
        run = int(action.parameters.get("number", 1)) - 1  # type: ignore[arg-type]
        return self._enter(self._find(_HAND_KINDS.get(action.id, ""), run), now_s)

    def document(self) -> dict[str, Any]:
        """As the live file has it."""
        return {
            "cell": self.at,
            "cell_since_s": self.since_s,
            "warm_until_s": self.warm_until_s,
            "expected_s": [round(c.expected_s, 2) for c in self.cells],
        }

    def _kind(self) -> str:
        return self.cells[self.at].kind if 0 <= self.at < len(self.cells) else ""

    def _find(self, kind: str, run: int) -> int:
        """The cell of that kind in that pass; where the load is, when there is none."""
        return next((i for i, c in enumerate(self.cells) if (c.kind, c.run) == (kind, run)), self.at)

    def _enter(self, number: int, now_s: float) -> "Timeline":
        if number == self.at:
            return self
        cells = self.cells
        if number == self.at + 1 and 0 <= self.at < len(cells) and self._kind() not in BY_HAND:
            took = replace(cells[self.at], expected_s=max(now_s - self.since_s, 0.01))
            cells = (*cells[: self.at], took, *cells[self.at + 1 :])
        return replace(self, cells=cells, at=number, since_s=now_s, warm_until_s=0.0)


def _preparation(recipe: Recipe, number: int, seating: str) -> list[TimelineCell]:
    """What happens before the stops of a pass, in the order in which the load does it."""
    run, found = recipe.runs[number], []
    if run.seating != seating:
        before, pose = _seat(recipe, seating), _seat(recipe, run.seating)
        found.append(TimelineCell("turn", _HAND_S, run.seating, number, pose, before))
    if recipe.turns_base and (not number or run.base_turn_deg != recipe.runs[number - 1].base_turn_deg):
        found.append(TimelineCell("base", _HAND_S, f"{run.base_turn_deg:g}°", number))
    if run.temperature_offset_degC:
        found.append(TimelineCell("temperature", _HAND_S, f"{run.temperature_offset_degC:+g} °C", number))
    if run.temperature_swing_degC:
        found.append(TimelineCell("temperature", _HAND_S, f"0 … {run.temperature_swing_degC:+g} … 0 °C", number))
    if recipe.filters_off and (not number or run.filter != recipe.runs[number - 1].filter):
        found.append(TimelineCell("filter", _HAND_S, run.filter, number))
    if run.motors == "off":
        found.append(TimelineCell("motors", _HAND_S, "", number))
    return [*found, *_warm_up(run, number)]


def _warm_up(run: Run, number: int) -> list[TimelineCell]:
    return [TimelineCell("warm-up", float(run.prewarm_s), "", number)] if run.prewarm_s else []


def _seat(recipe: Recipe, seating: str) -> Rows:
    rows: Rows = recipe.seating(seating).tolist()
    return rows


def _stop_cell(planned: PlannedVisit, expected_s: float) -> TimelineCell:
    known = bool(np.isfinite(planned.true).all())
    pose: Rows | None = np.asarray(planned.nest @ planned.seat).round(6).tolist() if known else None
    true = tuple(round(float(v), 6) for v in planned.true) if known else None
    return TimelineCell("stop", expected_s, planned.position, planned.run, pose, None, true)


def _with_moves(cells: tuple[TimelineCell, ...], estimate_s: float) -> tuple[TimelineCell, ...]:
    """Shares what the estimate of a load holds beyond its stays, the moves, among the stops."""
    measuring = [c for c in cells if c.kind in ("stop", "verify", "warm-up")]
    stops = sum(c.kind == "stop" for c in cells)
    more_s = (estimate_s - sum(c.expected_s for c in measuring)) / max(stops, 1)
    if more_s <= 0:
        return cells
    return tuple(replace(c, expected_s=c.expected_s + more_s) if c.kind == "stop" else c for c in cells)
