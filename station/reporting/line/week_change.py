"""What changed from one week to the next: means of every value in every nest, yields, and what is new in the record."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from station.domain.line_quality.comparison import compare
from station.messages import Message
from station.ports.log_reader import Attempt
from station.reporting.line.statistics import AttemptValues
from station.reporting.number_text import format_number
from station.reporting.words import term_message

#: Probability that anything is listed by chance where nothing changed, over all comparisons (Bonferroni).
_FAMILY_LEVEL = 0.01
#: A nest with fewer units in a week is not compared.
_FEWEST = 5
Week = tuple[Sequence[Attempt], Sequence[AttemptValues]]

#: Columns of an attempt of which a new entry is news.
_FACTS: dict[str, Callable[[Attempt], str]] = {
    "recipe": lambda a: f"{a.recipe_name} {a.recipe_version}",
    "software": lambda a: a.software,
    "configuration": lambda a: a.config_hash[:12],
    "operator": lambda a: a.operator,
    "lot": lambda a: a.lot,
}


@dataclass(frozen=True, slots=True)
class WeekChange:
    """before, after: attempts of each week; compared: means compared; messages: what changed, largest first."""

    before: int
    after: int
    compared: int
    messages: tuple[Message, ...]


def week_change(before: Week, after: Week) -> WeekChange:
    """Compares two weeks."""
    groups = [_values(values) for _, values in (before, after)]
    pairs = [key for key in groups[0] if min(len(groups[0][key]), len(groups[1].get(key, ()))) >= _FEWEST]
    found = []
    for key in pairs:
        change = compare(np.array(groups[0][key]), np.array(groups[1][key]), 1 - _FAMILY_LEVEL / len(pairs))
        if change is not None and abs(change.difference) > change.half_width > 0:
            found.append((abs(change.difference) / change.half_width, key, change))
    found.sort(key=lambda item: -item[0])
    moved = [
        Message(
            "week-mean",
            value=term_message(value),
            nest=nest,
            before=format_number(change.before.mean, 5),
            after=format_number(change.after.mean, 5),
            half=format_number(change.half_width, 2),
        )
        for _, (nest, value), change in found
    ]
    rows = (before[0], after[0])
    messages = (*_yield_change(rows[0], rows[1]), *moved, *_news(rows[0], rows[1]))
    return WeekChange(len(rows[0]), len(rows[1]), len(pairs), messages)


def _values(attempts: Sequence[AttemptValues]) -> dict[tuple[str, str], list[float]]:
    """Values by nest and name, of what was judged."""
    found: dict[tuple[str, str], list[float]] = {}
    for a in attempts:
        for name, value in a.values.items() if a.outcome in ("PASS", "FAIL") else ():
            found.setdefault((a.nest, name), []).append(value)
    return found


def _yield_change(before: Sequence[Attempt], after: Sequence[Attempt]) -> list[Message]:
    """The share that passed, where two standard errors of the difference say that it moved."""
    counts = [(sum(a.outcome == "PASS" for a in week), len(week)) for week in (before, after)]
    if min(n for _, n in counts) < _FEWEST:
        return []
    whole = sum(n for _, n in counts)
    pooled = sum(k for k, _ in counts) / whole
    error = (pooled * (1 - pooled) * sum(1 / n for _, n in counts)) ** 0.5
    shares = [k / n for k, n in counts]
    if abs(shares[1] - shares[0]) <= 2.58 * error:
        return []
    return [Message("week-yield", before=f"{100 * shares[0]:.1f}", after=f"{100 * shares[1]:.1f}")]


def _news(before: Sequence[Attempt], after: Sequence[Attempt]) -> list[Message]:
    if not before:
        return []
    messages = []
    for what, read in _FACTS.items():
        new = sorted({read(a) for a in after} - {read(a) for a in before} - {""})
        if new:
            messages.append(Message(f"week-new-{what}", names=tuple(new[:5]), count=len(new)))
    return messages
