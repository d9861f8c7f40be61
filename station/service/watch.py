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
#: Attempts looked at together for what is new.
_PAGE = 4096


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
        self._read_to = 0  # attempts with larger record numbers are new
        self._waiting: list[Attempt] = []  # for their load to end, or for one before it
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
        """Loads not read yet, in the order of the log, of each station up to its first that still runs."""
        found: dict[tuple[int, str, str], list[Attempt]] = {}
        for attempt in self._still_waiting() + self._new_attempts():
            found.setdefault((attempt.started_ns, attempt.station, attempt.recipe_hash), []).append(attempt)
        finished: list[list[Attempt]] = []
        running: set[str] = set()
        self._waiting = []
        for load in found.values():
            station = load[0].station
            if any(a.outcome is None for a in load):
                running.add(station)
            if station in running:
                self._waiting += load
            else:
                finished.append(load)
        return finished

    def _new_attempts(self) -> list[Attempt]:
        """Attempts begun since the last call, oldest first: by number, for a clock may be turned back, and because a
        station that is silent for a year must not have the others' year read again."""
        found: list[Attempt] = []
        before = None
        while page := self._log.attempts(Query(before=before), _PAGE):
            found += [a for a in page if a.number > self._read_to]
            before = page[-1].number
            if before <= self._read_to or len(page) < _PAGE:
                break
        if found:
            self._read_to = found[0].number
        return found[::-1]

    def _still_waiting(self) -> list[Attempt]:
        """Those that waited, as the log has them now."""
        numbers = {a.number for a in self._waiting}
        found: list[Attempt] = []
        for station in dict.fromkeys(a.station for a in self._waiting):
            times = [a.started_ns for a in self._waiting if a.station == station]
            query = Query(station=station, since_ns=min(times), until_ns=max(times) + 1)
            found += [a for a in self._log.attempts(query) if a.number in numbers]
        return sorted(found, key=lambda attempt: attempt.number)

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
