"""Since when, and until when, a group of units has a cause: the contiguous run of units that it explains best."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats

#: The stretch and its size are found by turns.
_ROUNDS = 6
#: A beginning or an end inside the group must be worth so many times the logarithm of the number of units, in nats.
_PRICE = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class GroupUnits:
    """Units (n) of one group in the order of time: began_ns (n); projected (n, a): what each says of the cause's sizes,
    winsorised, all else known taken off; plain (n, a): the same as it was measured; row (n): of the time slices."""

    began_ns: NDArray[np.int64]
    projected: Floats
    plain: Floats
    row: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Units first to last − 1 of a group; begun, ended: whether the group began before, or goes on after."""

    first: int
    last: int
    begun: bool
    ended: bool


def best_stretch(units: GroupUnits, gram: Floats, dispersion: float, start: tuple[int, int] | None = None) -> Stretch:
    """gram (a, a): of one unit; dispersion: by how much chance is larger than the noise says; start: units among which
    the stretch is sought first, None: all."""
    n = len(units.projected)
    first, last = start or (0, n)
    inverse = np.linalg.pinv(gram)
    for _ in range(_ROUNDS):
        size = inverse @ units.projected[first:last].mean(axis=0)
        gains = (units.projected @ size - 0.5 * size @ gram @ size) / dispersion
        before = first, last
        first, last = _heaviest(gains)
        if (first, last) == before:
            break
    price = _PRICE * np.log(max(n, 2))
    begun = bool(-gains[:first].sum() > price)
    ended = bool(-gains[last:].sum() > price)
    return Stretch(first if begun else 0, last if ended else n, begun, ended)


def _heaviest(gains: Floats) -> tuple[int, int]:
    """The stretch with the largest sum (Kadane): where the sum of all before is lowest, to where it is highest."""
    total = np.concatenate([[0.0], np.cumsum(gains)])
    lowest = np.minimum.accumulate(total[:-1])
    last = int(np.argmax(total[1:] - lowest)) + 1
    return int(np.argmin(total[:last])), last
