"""The watch over a log: load after load goes into the bank of its station and recipe."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from station.domain.core.types import Floats
from station.domain.evaluation import reduced_visits_document
from station.domain.recipe.recipe import Recipe
from station.domain.recipe.references import Truths
from station.domain.watch.bank import Alert, WatchBank
from station.domain.watch.load import load_values
from station.domain.watch.signals import Projector, WatchedSignal, projector
from station.ports.log_reader import Attempt, LogReader, Query, ReducedAttempt
from station.service import containment
from station.service.containment import TouchedUnit

#: Loads whose pace tells when the next ones come.
_PACE_LOADS = 21
#: Attempts read together.
_PORTION = 512


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """One alert with the times of its loads, in ns since 1970; ended_ns: None while it lasts; newest_ns: of the newest
    load; load_ns: from load to load of late, the median."""

    station: str
    recipe: Recipe
    alert: Alert
    begin_ns: int
    raised_ns: int
    ended_ns: int | None
    newest_ns: int
    load_ns: int

    @property
    def query(self) -> Query:
        """The attempts that the change touched."""
        nest = self.alert.place.nest or None
        return Query(station=self.station, nest=nest, since_ns=self.begin_ns, until_ns=self.ended_ns)


@dataclass(slots=True, eq=False)
class _Line:
    """One station with one recipe."""

    recipe: Recipe
    bank: WatchBank
    truths: Truths = field(default_factory=dict)
    projectors: dict[tuple[tuple[str, ...], tuple[str, ...]], Projector | None] = field(default_factory=dict)
    nests: set[str] = field(default_factory=set)


class Watch:
    """run_length: loads on average between false alarms, for each station and recipe. Errors: LogError."""

    def __init__(self, log: LogReader, run_length: float) -> None:
        self._log, self._run_length = log, run_length
        self._lines: dict[tuple[str, str], _Line] = {}
        #: By station: when each load began; the load's number is its place, from 1.
        self._began: dict[str, list[int]] = {}
        self._newest_ns: dict[str, int] = {}
        self._alerts: list[tuple[tuple[str, str], Alert]] = []

    @property
    def loads(self) -> int:
        """Loads read."""
        return sum(map(len, self._began.values()))

    @property
    def learning(self) -> bool:
        """Whether no station and recipe has come to its first test yet."""
        return not any(line.bank.testing for line in self._lines.values())

    def read(self) -> list[Finding]:
        """Reads the loads that came to their end since the last call; the alerts that they raised, oldest first."""
        known = len(self._alerts)
        loads = self._finished_loads()
        for start in range(0, len(loads), _PORTION // 4):
            part = loads[start : start + _PORTION // 4]
            rows = {row.number: row for row in self._log.reduced([a.number for load in part for a in load])}
            for load in part:
                self._add(load, rows)
        return [self._finding(*pair) for pair in self._alerts[known:]]

    def findings(self) -> list[Finding]:
        """Every alert of all loads so far; what lasts is estimated anew from all of them."""
        for key, alert in self._alerts:
            if alert.ended is None:
                self._lines[key].bank.refresh(alert)
        return [self._finding(*pair) for pair in self._alerts]

    def touched(self, finding: Finding) -> list[TouchedUnit]:
        """The units that the change touched."""
        return containment.touched(self._log, finding.query)

    def _finished_loads(self) -> list[list[Attempt]]:
        """Loads that began after the newest read of their station, oldest first, up to its first that still runs."""
        known = dict(self._newest_ns)
        since = min(known.values()) + 1 if known else None
        found: dict[tuple[int, str, str], list[Attempt]] = {}
        for attempt in reversed(self._log.attempts(Query(since_ns=since))):
            if attempt.started_ns > known.get(attempt.station, -1):
                key = attempt.started_ns, attempt.station, attempt.recipe_hash
                found.setdefault(key, []).append(attempt)
        finished: list[list[Attempt]] = []
        running: set[str] = set()
        for key in sorted(found):
            if any(a.outcome is None for a in found[key]):
                running.add(key[1])
            if key[1] not in running:
                finished.append(found[key])
                self._newest_ns[key[1]] = key[0]
        return finished

    def _add(self, load: Sequence[Attempt], rows: dict[int, ReducedAttempt]) -> None:
        first = load[0]
        began = self._began.setdefault(first.station, [])
        began.append(first.started_ns)
        measured = [(a, rows[a.number]) for a in load if a.number in rows]
        if not measured:
            return
        key = first.station, first.recipe_hash
        if key not in self._lines:
            text = self._log.recipe_and_product(first)[0]
            if not text:  # kept by a version that stored no recipe: nothing says where the stimulus pointed
                return
            self._lines[key] = _Line(Recipe.model_validate_json(text), WatchBank(run_length=self._run_length))
        line = self._lines[key]
        line.nests |= {a.nest for a in load}
        nests = {a.nest: signals for a, row in measured if (signals := _signals(line, row))}
        if nests:
            raised, _ = line.bank.add(load_values(len(began), nests, len(line.nests)))
            self._alerts += [(key, alert) for alert in raised]

    def _finding(self, key: tuple[str, str], alert: Alert) -> Finding:
        began = self._began[key[0]]
        ended = None if alert.ended is None else began[alert.ended - 1]
        pace = sorted(later - earlier for earlier, later in pairwise(began[-_PACE_LOADS:]))
        times = began[alert.begin - 1], began[alert.raised - 1], ended, began[-1], pace[len(pace) // 2] if pace else 0
        return Finding(key[0], self._lines[key].recipe, alert, *times)


def _signals(line: _Line, row: ReducedAttempt) -> dict[WatchedSignal, Floats]:
    visits = reduced_visits_document.from_document(json.loads(row.stops), line.recipe, line.truths)
    order = visits.position, visits.seating
    if order not in line.projectors:
        line.projectors[order] = projector(line.recipe, visits)
    found = line.projectors[order]
    return {} if found is None else found.values(visits)
