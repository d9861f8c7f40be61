"""A gross fault: found by looking, before any statistics."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from station.domain.core.types import Labels


@dataclass(frozen=True, slots=True)
class FaultParameter:
    """One number of a fault in the contracts' form; a mapping is text and has no deviation."""

    name: str
    axis: str | None
    of: str
    value: float | str
    std: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class GrossFault:
    """A cause that is plain to see.

    nats: how much likelier the data are with it; rms_before, rms_after: of what the simulation leaves, where the
    fault changes that, else None.
    """

    effect: str
    level: str
    numbers: tuple[FaultParameter, ...]
    sentence: str
    nats: float
    indistinguishable_from: tuple[str, ...] = ()
    rms_before: float | None = None
    rms_after: float | None = None


def rows_of_units(units: Labels) -> list[slice]:
    """The rows of each unit in a column that is sorted by unit."""
    ends = np.searchsorted(units.code, np.arange(len(units.names) + 1))
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def unit_label(units: Labels, code: int) -> str:
    """A unit as the contracts write it."""
    return f"unit:{units.names[code]}"
