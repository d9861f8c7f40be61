"""Which unit sits in a nest: the one that falls silent when a person takes the unit of this nest out."""

from collections.abc import Hashable
from collections.abc import Set as AbstractSet
from typing import TypeVar

Unit = TypeVar("Unit", bound=Hashable)


def unit_taken_out(silent: AbstractSet[Unit], elsewhere: AbstractSet[Unit]) -> Unit | None:
    """The unit of the emptied nest; None where the bus does not tell.

    silent: units that do not answer now; elsewhere: those that are known to sit in other nests. It tells only where
    exactly one unit is silent, and that one is not known to sit elsewhere.
    """
    if len(silent) != 1:
        return None
    (unit,) = silent
    return None if unit in elsewhere else unit


def unit_left_over(units: AbstractSet[Unit], elsewhere: AbstractSet[Unit]) -> Unit | None:
    """The unit of the last nest, once every other nest has its unit; None before that."""
    left = units - elsewhere
    return next(iter(left)) if len(left) == 1 else None
