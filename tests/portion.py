"""How much of its long lists every run of the suite tries; with `make test ALL=1` it tries all of them."""

import os
from collections.abc import Callable, Hashable, Iterable
from typing import TypeVar

T = TypeVar("T")
#: Set by `make test ALL=1`, `make blind` and `make torture`.
WHOLE = os.environ.get("STATION_TESTS") == "all"


def portion(names: Iterable[str], step: int = 5) -> list[str]:
    """Every fifth name, or as `step` says, in the order of the alphabet."""
    ordered = sorted(names)
    return ordered if WHOLE else ordered[::step]


def one_of_each(rows: Iterable[T], kind: Callable[[T], Hashable]) -> list[T]:
    """The first row of each kind."""
    whole = list(rows)
    first = {kind(row): row for row in reversed(whole)}
    return whole if WHOLE else [row for row in whole if first[kind(row)] is row]


def examples(count: int) -> int:
    """A third of so many examples drawn at random."""
    return count if WHOLE else -(-count // 3)
