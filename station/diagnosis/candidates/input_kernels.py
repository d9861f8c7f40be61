"""Functions of what the axes feel, as kernels of the input have them."""

from collections.abc import Iterator
from itertools import combinations_with_replacement

import numpy as np

from station.diagnosis.candidates.kernel_columns import each_axis, own_axis
from station.domain.core.types import Floats

#: Whole waves of what an axis feels from one end to the other, in steps that none falls between.
INPUT_WAVES = (1.5, 2.2, 2.9, 3.6, 4.3, 5.0)
#: An axis is at its end from this share of the stimulus on.
END_SHARE = 0.8


def functions_of_input(a: Floats) -> Iterator[Floats]:
    """Products of two, three or four components of the true vector on every axis, some waves of its own, and what is
    there at one end of an axis alone; some columns after others, as a fleet's are large."""
    pairs = combinations_with_replacement(range(3), 2)
    yield each_axis(np.stack([np.prod(a[:, list(c)], axis=1) for c in pairs], axis=1))
    yield each_axis(np.prod(a, axis=1)[:, None])
    yield products_of_other_axes(a)[0]
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    # A gain by the size of the others, what an axis takes of the others by its own size or by theirs, products of two
    # squares.
    gains, taken = (a * one**2, a * two**2), (one * a**2, two * a**2)
    others = one**3, two**3, one * two**2, one**2 * two
    quartic = a**2 * one**2, a**2 * two**2, one**2 * two**2
    for some in (gains, taken, others, quartic):
        yield np.concatenate([own_axis(x) for x in some], axis=2)
    for m in INPUT_WAVES:
        yield np.concatenate([own_axis(f(m * np.pi * a)) for f in (np.sin, np.cos)], axis=2)
    for i in range(3):
        yield from (each_axis(1.0 * (end * a[:, [i]] > END_SHARE)) for end in (-1, 1))


def products_of_other_axes(a: Floats) -> tuple[Floats, Floats]:
    """On each axis the product of the two others (v, 3, 3), and its own with each of them (v, 3, 6)."""
    a = a / np.max(np.linalg.norm(a, axis=1), initial=1e-300)
    one, two = (np.roll(a, places, axis=1) for places in (1, 2))
    return own_axis(one * two), np.concatenate([own_axis(a * one), own_axis(a * two)], axis=2)
