"""Figures of the line out of the log, gathered once for the page and for the report."""

from collections import Counter
from dataclasses import replace
from typing import Protocol

from station.domain.recipe.recipe import Recipe
from station.domain.records.stored_attempt import is_simulated
from station.ports.log_reader import Attempt, LogReader, Query, Yield
from station.reporting.line.statistics import (
    AttemptValues,
    LineStatistics,
    values_and_checks,
    values_of,
    yields_by_split,
)
from station.service.shift_effectiveness import shift_effectiveness


class StatisticsCache(Protocol):
    """What may be remembered of a log between two looks."""

    def measured(self, log: LogReader, attempt: Attempt) -> tuple[AttemptValues, tuple[str, ...]]:
        """A finished attempt's values, and the checks that speak against it."""

    def yields(self, log: LogReader, query: Query) -> list[Yield]:
        """Cells of the attempts that the query names."""


def gather_statistics(log: LogReader, query: Query, most: int, known: StatisticsCache | None = None) -> LineStatistics:
    """The newest `most` finished attempts that the query names, of one recipe: the named one, else the newest's; the
    yields are of all. known: what is remembered of the log, where the query spans whole days up to now.
    Errors: LogError."""
    newest = log.attempts(query, 1)
    one_recipe = query
    if newest and query.recipe_name is None:  # values of two recipes are no one process
        one_recipe = replace(query, recipe_name=newest[0].recipe_name, recipe_version=newest[0].recipe_version)
    found = _finished(log, one_recipe, most)
    everything = found if one_recipe is query else _finished(log, query, most)
    oldest_first = found[::-1]
    if known:
        lives = [known.measured(log, attempt) for attempt in oldest_first]
    else:
        lives = [values_and_checks(life) for life in log.lives(oldest_first)]
    reasons = Counter(check for _, checks in lives for check in checks)
    recipe = Recipe.model_validate_json(log.recipe_and_product(found[0])[0]) if found else None
    return LineStatistics(
        recipe=recipe,
        attempts=tuple(m for m, _ in lives),
        yields=yields_by_split(known.yields(log, query) if known else log.yields(query, "cell")),
        reasons=dict(reasons.most_common(12)),
        shifts=shift_effectiveness(log, query),
        simulated=sum(is_simulated(a.software) for a in everything),
    )


def attempt_values(log: LogReader, query: Query, most: int) -> list[AttemptValues]:
    """The newest `most` finished attempts that the query names, oldest first, without anything around them."""
    return [values_of(life) for life in log.lives(_finished(log, query, most)[::-1])]


def _finished(log: LogReader, query: Query, most: int) -> list[Attempt]:
    return [a for a in log.attempts(query, most) if a.outcome is not None]
