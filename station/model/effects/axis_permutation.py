"""The axes are swapped or have the wrong sign: the part is mounted turned, or the decoding is wrong.

The coefficient is a number in MAPPINGS; the mapping -y,x,z means that −y stands on x, x on y, z on z.

>>> import numpy as np
>>> c = np.array([[float(MAPPINGS.index("-y,x,z"))]])
>>> AxisPermutation.example().apply(np.array([[1.0, 2.0, 3.0]]), c)
array([[-2.,  1.,  3.]])
"""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from station.domain.core.types import Floats
from station.errors import UsageError
from station.model.effect import SINGLE_COEFFICIENT, OutputEffect, Parameter

#: The 48 ways to read three axes; the first is right.
MAPPINGS = tuple(
    ",".join(sign + axis for sign, axis in zip(signs, axes, strict=True))
    for axes in permutations("xyz")
    for signs in product(("", "-"), repeat=3)
)


def matrix_of(mapping: str) -> Floats:
    """The signed permutation (3, 3) of a mapping such as -y,x,z: new = matrix · old."""
    matrix = np.zeros((3, 3))
    for row, part in enumerate(mapping.split(",")):
        matrix[row, "xyz".index(part[-1])] = -1.0 if part.startswith("-") else 1.0
    return matrix


MATRICES = np.array([matrix_of(mapping) for mapping in MAPPINGS])


@dataclass(frozen=True)
class AxisPermutation(OutputEffect):
    """What stands on x, y, z, per unit."""

    physics = "The axes are swapped or have the wrong sign: the part is mounted turned, or the decoding is wrong."
    remedy = "check how the unit sits in its nest, and the axes in the decoding, before anything else"
    shown_by = "state the orientation of every position in the recipe"
    drawn_over = "expected"
    level = "device"
    of = ("unit", "common")
    axes = SINGLE_COEFFICIENT
    place = 4
    parameter = Parameter(
        "mapping", "", float(MAPPINGS.index("-y,x,z")), 0.0, 47.0, "a part mounted a quarter turn off"
    )
    size: float = parameter.typical

    def apply(self, reading: Floats, c: Floats) -> Floats:
        """The axes as the mapping numbered c puts them."""
        return np.asarray(np.einsum("nij,nj->ni", MATRICES[c[:, 0].astype(int)], reading))

    @classmethod
    def read_size(cls, text: str, unit: str = "u") -> float:
        """The number of the mapping a person wrote; UsageError when it is none."""
        del unit
        mapping = text.replace(" ", "").replace("+", "")
        if mapping not in MAPPINGS:
            raise UsageError("effect-mapping", effect=cls.id, text=text[:40])
        return float(MAPPINGS.index(mapping))

    def value_of(self, coefficient: float) -> str:
        """The mapping's text."""
        return MAPPINGS[int(coefficient)]
