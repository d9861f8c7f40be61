"""What the charts remember between two looks: finished attempts never change, and a whole day only when a unit of it
comes again or an attempt of it ends late. Nothing here is approximate: what may have changed is counted anew."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from threading import Lock

from station.ports.log_reader import Attempt, LogReader, Query, Yield
from station.reporting.line.statistics import AttemptValues, values_and_checks

DAY_NS = 86_400 * 10**9
#: So many attempts and so many questions are remembered.
MOST_ATTEMPTS, MOST_QUESTIONS = 4000, 16


@dataclass(slots=True)
class LineCache:
    """One log's. Safe to call from several threads."""

    _attempts: dict[int, tuple[AttemptValues, tuple[str, ...]]] = field(default_factory=dict)
    _days: dict[Query, dict[int, list[Yield]]] = field(default_factory=dict)
    _newest: int = 0
    _turn: Lock = field(default_factory=Lock)

    def measured(self, log: LogReader, attempt: Attempt) -> tuple[AttemptValues, tuple[str, ...]]:
        """A finished attempt's values, and the checks that speak against it. Errors: LogError."""
        known = self._attempts.get(attempt.number)
        if known is None:
            known = values_and_checks(log.attempt(attempt))
            with self._turn:
                self._attempts = dict([*self._attempts.items(), (attempt.number, known)][-MOST_ATTEMPTS:])
        return known

    def yields(self, log: LogReader, query: Query) -> list[Yield]:
        """Cells (station, nest, recipe, day) of the attempts that the query names, which spans whole days (UTC) from
        since_ns up to the newest. Errors: LogError."""
        assert query.since_ns is not None
        assert query.since_ns % DAY_NS == 0
        with self._turn:
            self._drop_changed_days(log)
            key = replace(query, since_ns=None)
            days = self._days.pop(key, {})
            self._days = dict([*self._days.items(), (key, days)][-MOST_QUESTIONS:])
            newest = log.attempts(query, 1)
            last = newest[0].started_ns // DAY_NS if newest else -1
            first = query.since_ns // DAY_NS
            for day in set(days) - set(range(first, last + 1)):
                del days[day]
            for day in range(first, last + 1):
                if day not in days:
                    one = replace(query, since_ns=day * DAY_NS, until_ns=(day + 1) * DAY_NS)
                    days[day] = log.yields(one, "cell")
            return list(_in_order(days))

    def _drop_changed_days(self, log: LogReader) -> None:
        """Read before anything is counted: what comes in between is looked at the next time."""
        newest = log.head().number
        if newest == self._newest:
            return
        if self._days:
            touched = log.changed_days(self._newest)
            self._days = {q: {d: y for d, y in days.items() if d not in touched} for q, days in self._days.items()}
        self._newest = newest


def _in_order(days: dict[int, list[Yield]]) -> Iterator[Yield]:
    for day in sorted(days):
        yield from days[day]
