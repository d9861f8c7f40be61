"""Foretells each number of a column from the ones before; what is left over is small, or zero.

Four models, each exactly reversible in whole numbers: LEVEL (noise about a mean), STEP (a walk), COUNT (a counter
that wraps), LINE (a steady clock). Columns are int64 and start at 0: they are differences from their first row.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.int64]

LEVEL, STEP, COUNT, LINE = 0, 1, 2, 3
MODELS = (LEVEL, STEP, COUNT, LINE)

#: Numbers of parameters that each model writes.
PARAMETERS = {LEVEL: 1, STEP: 0, COUNT: 3, LINE: 1}

_FINE = 16  # binary places of a clock's period


def residuals(column: Table, model: int) -> tuple[Table, list[int]]:
    """Residuals (n) of a column (n) and the model's parameters."""
    if model == LEVEL:
        level = round(float(column.mean()))
        return column - level, [level]
    change = np.diff(column, prepend=0)
    if model == STEP:
        return change, []
    if model == COUNT:
        return _counted(column, change)
    period = (int(column[-1]) << _FINE) // max(1, len(column) - 1)
    return column - _line(len(column), period), [period]


def backward(residual: Table, model: int, parameters: list[int]) -> Table:
    """The column from its residuals: the inverse of `forward`."""
    if model == LEVEL:
        return residual + parameters[0]
    if model == STEP:
        return np.asarray(np.cumsum(residual))
    if model == COUNT:
        low, step, modulus = parameters
        return np.asarray((np.cumsum(residual + step) - step - low) % modulus + low)
    return residual + _line(len(residual), parameters[0])


def zigzag(residual: Table) -> NDArray[np.uint64]:
    """0, −1, 1, −2 … → 0, 1, 2, 3 …"""
    return ((residual << 1) ^ (residual >> 63)).view(np.uint64)


def unzigzag(u: NDArray[np.uint64]) -> Table:
    """The inverse of `zigzag`."""
    return (u >> np.uint64(1)).view(np.int64) ^ -(u & np.uint64(1)).view(np.int64)


def cheapest(columns: Sequence[Table]) -> tuple[float, int]:
    """The model with the fewest bits for all columns together, the simplest of equals: bits, model."""
    return min((sum(_bits(residuals(column, model)[0]) for column in columns), model) for model in MODELS)


def _bits(residual: Table) -> float:
    """About how many bits residuals (n) take in Rice codes."""
    size = float(np.abs(residual).mean()) * 2
    return len(residual) * (math.log2(size * 0.72) + 2.0 if size > 1.4 else size * 1.5)


def _counted(column: Table, change: Table) -> tuple[Table, list[int]]:
    low = int(column.min())
    modulus = int(column.max()) - low + 1
    step = int(np.median(change[1:])) if len(change) > 1 else 0
    half = modulus // 2
    residual = (change - step + half) % modulus - half
    residual[0] = 0
    return residual, [low, step, modulus]


def _line(n: int, period: int) -> Table:
    return np.arange(n, dtype=np.int64) * period >> _FINE
