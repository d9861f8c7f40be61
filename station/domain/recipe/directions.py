"""Directions on the sphere: the solids that make good tumble designs, and a dense set to choose from."""

from itertools import permutations, product

import numpy as np

from station.domain.core.types import Floats

GOLDEN = (1 + 5**0.5) / 2
#: Root of x³ − x² − x − 1, from which the snub cube is made.
TRIBONACCI = 1.8392867552141612


def _unit(points: list[tuple[float, ...]]) -> Floats:
    out = np.array(points, float)
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def _even_permutations(base: tuple[float, float, float]) -> list[tuple[float, ...]]:
    """Cyclic permutations of all sign changes of a point."""
    signed = {tuple(s * b for s, b in zip(signs, base, strict=True)) for signs in product((1, -1), repeat=3)}
    return sorted({tuple(np.roll(p, k)) for p in signed for k in range(3)}, reverse=True)


AXES = _unit([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])
CORNERS = _unit(list(product((1, -1), repeat=3)))
EDGES = _unit(_even_permutations((0, 1, 1)))
ICOSAHEDRON = _unit(_even_permutations((0, 1, GOLDEN)))
DODECAHEDRON = np.concatenate([CORNERS, _unit(_even_permutations((0, 1 / GOLDEN, GOLDEN)))])
TETRAHEDRON = _unit([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])


def _snub_cube() -> Floats:
    """Even permutations with an even number of plus signs, odd ones with an odd number, of (1, 1/t, t)."""
    base = (1.0, 1 / TRIBONACCI, TRIBONACCI)
    both = product(permutations(range(3)), product((1, -1), repeat=3))
    return _unit(
        [
            tuple(s * base[o] for s, o in zip(signs, order, strict=True))
            for order, signs in both
            if _in_snub_cube(order, signs)
        ]
    )


def _in_snub_cube(order: tuple[int, ...], signs: tuple[int, ...]) -> bool:
    odd = bool(np.linalg.det(np.eye(3)[list(order)]) < 0)
    return (sum(s > 0 for s in signs) % 2 == 1) == odd


#: Known good designs by their number of positions.
SOLIDS = {
    4: TETRAHEDRON,
    6: AXES,
    8: CORNERS,
    12: ICOSAHEDRON,
    14: np.concatenate([AXES, CORNERS]),
    18: np.concatenate([AXES, EDGES]),
    20: DODECAHEDRON,
    24: _snub_cube(),
    26: np.concatenate([AXES, CORNERS, EDGES]),
}


def spread(count: int) -> Floats:
    """`count` directions, nearly even (Fibonacci lattice; Swinbank & Purser 2006, Q. J. R. Meteorol. Soc. 132)."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    turn = 2 * np.pi * i / GOLDEN
    level = np.sqrt(1 - z**2)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


#: Directions to choose a position from: easy ones first, so that they win ties.
CANDIDATES = np.concatenate([AXES, EDGES, CORNERS, ICOSAHEDRON, spread(240)])
